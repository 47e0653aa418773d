"""Start the singularity monitor: from a parameter file, or from a robot description."""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    """Give the monitor and, on request, RViz."""
    config = PathJoinSubstitution([FindPackageShare('kinopt_ros'), 'config'])
    arguments = [
        DeclareLaunchArgument(
            'params_file', default_value=PathJoinSubstitution([config, 'described_arm.yaml']),
            description='parameter file of the monitor'),
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of the monitor'),
        DeclareLaunchArgument(
            'robot_description', default_value='',
            description='URDF text; empty: the topic robot_description where the parameter file '
                        'names base_link and tip_link'),
        DeclareLaunchArgument(
            'rviz', default_value='false', description='whether to start RViz too'),
    ]
    rviz = Node(
        package='rviz2', executable='rviz2',
        arguments=['-d', PathJoinSubstitution([config, 'monitor.rviz'])],
        namespace=LaunchConfiguration('namespace'),
        condition=IfCondition(LaunchConfiguration('rviz')))
    return LaunchDescription([*arguments, OpaqueFunction(function=start_monitor), rviz])


def start_monitor(context):
    """Give the monitor; an argument that is empty leaves the parameter file its say."""
    parameters = [ParameterFile(LaunchConfiguration('params_file'), allow_substs=True)]
    robot_description = LaunchConfiguration('robot_description')
    if robot_description.perform(context):
        parameters.append(
            {'robot_description': ParameterValue(robot_description, value_type=str)})
    return [Node(
        package='kinopt_ros', executable='singularity_monitor', output='screen',
        namespace=LaunchConfiguration('namespace'), parameters=parameters)]
