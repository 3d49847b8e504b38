# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
from setuptools import find_packages, setup

package_name = 'lupin_greenhouse_bridge'

setup(
    name=package_name,
    version='2.0.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={f'{package_name}.display': ['page/*'], f'{package_name}.testing': ['*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/security', ['security/policy.xml']),
        (f'share/{package_name}/launch', ['launch/greenhouse_bridge.launch.py']),
        (f'share/{package_name}/config', ['config/greenhouse_bridge.yaml']),
        (
            f'share/{package_name}/schema',
            ['schema/greenhouse_config.schema.json', 'schema/tag_locations.schema.json'],
        ),
        (f'share/{package_name}/rviz', ['rviz/greenhouse.rviz']),
        (f'share/{package_name}/foxglove', ['foxglove/greenhouse.json']),
    ],
    python_requires='>=3.10',
    # mdp-greenhouse is not in rosdistro: pip brings it. Before 1.0.7 its clock is wrong.
    install_requires=['setuptools', 'mdp-greenhouse>=1.0.7', 'numpy', 'packaging', 'PyYAML', 'scipy'],
    extras_require={
        'test': ['argcomplete', 'hypothesis', 'matplotlib', 'pillow', 'pytest'],
    },
    zip_safe=True,
    maintainer='Lupin team',
    maintainer_email='lupin.team@example.org',
    description='A ROS 2 service that returns simulated climate readings for a greenhouse AprilTag.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'approach_poses = lupin_greenhouse_bridge.executables:approach_poses',
            'bridge_node = lupin_greenhouse_bridge.executables:bridge_node',
            'read_tag = lupin_greenhouse_bridge.executables:read_tag',
            'register_layout = lupin_greenhouse_bridge.executables:register_layout',
            'read_on_sight = lupin_greenhouse_bridge.executables:read_on_sight',
            'record_readings = lupin_greenhouse_bridge.executables:record_readings',
            'readings_page = lupin_greenhouse_bridge.executables:readings_page',
            'show_readings = lupin_greenhouse_bridge.executables:show_readings',
        ],
    },
)
