"""The topic of the markers: how often, in which frame, and only for somebody."""

import math

from geometry_msgs.msg import Pose
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from kinopt_ros.monitor.markers import marker_array, plane_pose_of


class MarkerPublisher:
    """
    Publish `~/markers` on a node, as often as its parameter permits.

    Parameters
    ----------
    node : rclpy.node.Node
    topics : OnDemandTopics
        Of each verdict.
    monitor : PostureMonitor
    optimum : OptimumServices
        Knows the radius of the conditioning circle.
    subchain : PlanarSubchain or None
        Tells frame and plane where the arm comes from a robot description.
    header : callable
        Gives the header of the JointState that was judged.
    """

    def __init__(self, node, topics, monitor, optimum, subchain, header):
        self._monitor = monitor
        self._optimum = optimum
        self._header = header
        self._frame, self._pose = 'base_link', Pose()
        if subchain is not None:
            self._frame = subchain.parent_link
            self._pose = plane_pose_of(subchain.plane_frame_in_parent)
        self._last = -math.inf
        topics.add(node.create_publisher(MarkerArray, '~/markers', 10), self._markers)

    def _markers(self, _, now):
        """Markers of the latest verdict at time now (s); None if they would be too many."""
        period = 1.0 / self._monitor.configuration.marker_rate
        # A posture that was lost is shown at once.
        if now - self._last < period and self._monitor.knows_posture:
            return None
        self._last = now
        frame, pose = self._frame, self._pose
        base_frame = self._monitor.configuration.base_frame
        if base_frame:
            frame, pose = base_frame, Pose()
        return marker_array(
            self._monitor, Header(stamp=self._header().stamp, frame_id=frame), pose,
            self._optimum.circle_radius)
