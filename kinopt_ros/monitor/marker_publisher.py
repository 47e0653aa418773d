"""The topic of the markers: how often, in which frame, and only for somebody."""

import math

from geometry_msgs.msg import Pose
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from kinopt_ros.monitor.markers import marker_array, plane_pose_of
from kinopt_ros.monitor.on_demand import OnDemandPublisher


class MarkerPublisher:
    """
    Publish `~/markers` on a node.

    Parameters
    ----------
    node : rclpy.node.Node
    monitor : PostureMonitor
    optimum : OptimumServices
        Knows the radius of the conditioning circle.
    subchain : PlanarSubchain or None
        Tells frame and plane where the arm comes from a robot description.
    """

    def __init__(self, node, monitor, optimum, subchain):
        self._monitor = monitor
        self._optimum = optimum
        self._frame, self._pose = 'base_link', Pose()
        if subchain is not None:
            self._frame = subchain.parent_link
            self._pose = plane_pose_of(subchain.plane_frame_in_parent)
        self._last = -math.inf
        self._publisher = OnDemandPublisher(
            node.create_publisher(MarkerArray, '~/markers', 10), self._markers_of)

    def publish(self, header, now):
        """
        Publish the latest verdict, if somebody listens and the rate permits.

        Parameters
        ----------
        header : callable
            Gives the header of the JointState that was judged.
        now : float
            Time in s.
        """
        period = 1.0 / self._monitor.configuration.marker_rate
        # A posture that was lost is shown at once.
        if now - self._last >= period or not self._monitor.knows_posture:
            self._publisher.publish(header, now)

    def _markers_of(self, header, now):
        self._last = now
        frame, pose = self._frame, self._pose
        base_frame = self._monitor.configuration.base_frame
        if base_frame:
            frame, pose = base_frame, Pose()
        return marker_array(
            self._monitor, Header(stamp=header().stamp, frame_id=frame), pose,
            self._optimum.circle_radius)
