# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
from setuptools import find_packages, setup

package_name = 'lupin_greenhouse_bridge'

setup(
    name=package_name,
    version='2.0.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={
        package_name: ['schema/*.json'],
        f'{package_name}.testing': ['*.xml'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/security', ['security/policy.xml']),
        (f'share/{package_name}/launch', ['launch/greenhouse_bridge.launch.py']),
        (f'share/{package_name}/config', ['config/greenhouse_bridge.yaml']),
        (
            f'share/{package_name}/schema',
            [
                f'{package_name}/schema/greenhouse_config.schema.json',
                f'{package_name}/schema/tag_locations.schema.json',
            ],
        ),
    ],
    python_requires='>=3.10',
    # mdp-greenhouse is not in rosdistro: pip brings it. Before 1.0.7 its clock is wrong.
    install_requires=[
        'setuptools',
        'jsonschema>=3.2',
        'mdp-greenhouse>=1.0.7',
        'packaging',
        'PyYAML',
    ],
    extras_require={
        'test': ['hypothesis', 'pytest'],
    },
    zip_safe=True,
    maintainer='Lupin team',
    maintainer_email='lupin.team@example.org',
    description='A ROS 2 service that returns simulated climate readings for a greenhouse AprilTag.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'bridge_node = lupin_greenhouse_bridge.bridge_node:main',
            'read_tag = lupin_greenhouse_bridge.reading.read_tag:main',
        ],
    },
)
