from setuptools import setup

package_name = 'lupin_simulation'

setup(
    name=package_name,
    version='2.0.0',
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
    description='Simulations of the SDF world, a camera, and a navigator with a robot, and a demo.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'fake_camera = lupin_simulation.fake_camera:main',
            'fake_navigator = lupin_simulation.fake_navigator:main',
            'generate_world = lupin_simulation.generate_world:main',
            'inspection = lupin_simulation.inspection:main',
        ],
    },
)
