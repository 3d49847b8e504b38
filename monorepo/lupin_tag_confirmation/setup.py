from setuptools import setup

package_name = 'lupin_tag_confirmation'

setup(
    name=package_name,
    version='2.0.0',
    packages=[package_name],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/config', ['config/confirm_tag.yaml']),
        (f'share/{package_name}/launch', ['launch/confirm_tag.launch.py']),
    ],
    python_requires='>=3.10',
    # AprilTag 3 comes from apt (python3-apriltag) or pip (apriltag-python), not from both. So does OpenCV.
    install_requires=['setuptools', 'numpy', 'pillow'],
    extras_require={'test': ['hypothesis', 'pytest']},
    zip_safe=True,
    maintainer='Lupin team',
    maintainer_email='lupin.team@example.org',
    description='Confirms that the camera sees the AprilTag that the robot expects.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'confirm_tag = lupin_tag_confirmation.confirm_tag:main',
        ],
    },
)
