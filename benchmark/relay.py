"""
A bare relay: what rclpy takes for one subscription and four publishers, and nothing between.

    python3 relay.py single|events
"""

import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64

# As the monitor subscribes.
QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def main():
    """Relay until the context ends."""
    rclpy.init()
    node = Node('relay')
    publishers = [node.create_publisher(Float64, f'~/{name}', 10)
                  for name in ('z', 'conditioning_length', 'margin')]
    flag = node.create_publisher(Bool, '~/near_singularity', 10)

    def relay(message):
        for publisher in publishers:
            publisher.publish(Float64(data=message.position[1]))
        flag.publish(Bool(data=True))

    node.create_subscription(JointState, 'joint_states', relay, QOS)
    executor = {'single': SingleThreadedExecutor, 'events': EventsExecutor}[sys.argv[1]]()
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.5)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
