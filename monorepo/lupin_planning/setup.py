from setuptools import setup

package_name = 'lupin_planning'

setup(
    name=package_name,
    version='2.0.0',
    packages=[package_name],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    python_requires='>=3.10',
    install_requires=['setuptools', 'numpy', 'PyYAML', 'scipy'],
    extras_require={'test': ['hypothesis', 'pytest']},
    zip_safe=True,
    maintainer='Lupin team',
    maintainer_email='lupin.team@example.org',
    description='Computes where the robot must stand to see each tag, and the route along these poses.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'approach_poses = lupin_planning.approach_poses:main',
            'register_layout = lupin_planning.register_layout:main',
        ],
    },
)
