"""Start the monitor beside a simulated arm that passes its best posture and a singularity."""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    """Give the monitor of `monitor.launch.py` and the simulated arm, with the same parameters."""
    share = FindPackageShare('kinopt_ros')
    arguments = [
        DeclareLaunchArgument(
            'params_file',
            default_value=PathJoinSubstitution([share, 'config', 'paper_isotropic.yaml']),
            description='parameter file of both nodes'),
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of both nodes'),
        DeclareLaunchArgument(
            'rviz', default_value='false', description='whether to start RViz too'),
    ]
    monitor = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(
            PathJoinSubstitution([share, 'launch', 'monitor.launch.py'])),
        launch_arguments={name: LaunchConfiguration(name)
                          for name in ('params_file', 'namespace', 'rviz')}.items())
    simulated_arm = Node(
        package='kinopt_ros', executable='simulated_arm', output='screen',
        namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration('params_file')])
    return LaunchDescription([*arguments, monitor, simulated_arm])
