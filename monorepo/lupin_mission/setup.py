from setuptools import setup

package_name = 'lupin_mission'

setup(
    name=package_name,
    version='2.0.0',
    packages=[package_name],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', ['launch/inspection.launch.py', 'launch/mission.launch.py']),
        (f'share/{package_name}/config', ['config/mission_orchestrator.yaml']),
    ],
    python_requires='>=3.10',
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=True,
    maintainer='Lupin team',
    maintainer_email='lupin.team@example.org',
    description='Visits the tags of the greenhouse, reads the climate at each, and writes a report.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'mission_orchestrator = lupin_mission.mission_orchestrator:main',
            'mission_node = lupin_mission.mission_orchestrator:main',
            'passive_observer = lupin_mission.passive_observer:main',
            'register_discovered_tags = lupin_mission.register_discovered_tags:main',
        ],
    },
)
