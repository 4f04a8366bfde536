"""How colcon installs the node."""

from setuptools import setup

setup(
    name="tbmslam_ros",
    version="0.1.0",
    packages=["tbmslam_ros"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tbmslam_ros"]),
        ("share/tbmslam_ros", ["package.xml"]),
    ],
    install_requires=["setuptools", "tbmslam"],
    entry_points={"console_scripts": ["mapper = tbmslam_ros.mapper:main"]},
)
