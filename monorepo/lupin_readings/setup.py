from setuptools import setup

package_name = 'lupin_readings'

setup(
    name=package_name,
    version='2.0.0',
    packages=[package_name],
    package_data={package_name: ['page/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/config', ['config/readings.yaml']),
        (f'share/{package_name}/rviz', ['rviz/greenhouse.rviz']),
        (f'share/{package_name}/foxglove', ['foxglove/greenhouse.json']),
    ],
    python_requires='>=3.10',
    install_requires=['setuptools', 'numpy'],
    extras_require={'test': ['hypothesis', 'pytest']},
    zip_safe=True,
    maintainer='Lupin team',
    maintainer_email='lupin.team@example.org',
    description='Reads tags on sight, and records and shows readings in RViz, in Foxglove and on a page.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'read_on_sight = lupin_readings.read_on_sight:main',
            'readings_page = lupin_readings.readings_page:main',
            'record_readings = lupin_readings.record_readings:main',
            'show_readings = lupin_readings.show_readings:main',
        ],
    },
)
