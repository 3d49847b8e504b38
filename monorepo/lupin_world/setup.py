from setuptools import setup

package_name = 'lupin_world'

setup(
    name=package_name,
    version='1.2.0',
    packages=[package_name],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    python_requires='>=3.10',
    install_requires=['setuptools', 'numpy', 'pillow'],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Lupin team',
    maintainer_email='lupin.team@example.org',
    description='An SDF world of the greenhouse, with the AprilTags of its layout.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'check_world = lupin_world.check_world:main',
            'generate_world = lupin_world.generate_world:main',
            'world_camera = lupin_world.executables:world_camera',
        ],
    },
)
