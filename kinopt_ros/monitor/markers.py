"""The arm, its closest isotropic set and its conditioning circle as RViz markers."""

import math

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

# Okabe and Ito's colours, which colour-blind people can tell apart: from vermilion at a
# singularity (margin 0) to blue at isotropy (margin 1).
_SINGULAR = np.array([0.835, 0.369, 0.0])
_ISOTROPIC = np.array([0.0, 0.447, 0.698])
_SET = ColorRGBA(r=0.0, g=0.62, b=0.451, a=0.9)
_GREY = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.8)
_CIRCLE_CORNERS = 72


def marker_array(monitor, header, plane_pose, circle_radius):
    """
    Draw a monitor's latest verdict.

    Parameters
    ----------
    monitor : PostureMonitor
    header : std_msgs.msg.Header
        Frame and stamp.
    plane_pose : geometry_msgs.msg.Pose
        Pose of the arm's plane in that frame: origin at the first joint, z along its axis.
    circle_radius : float or None
        Radius in m of the conditioning circle; None while it is not known.

    Returns
    -------
    array : visualization_msgs.msg.MarkerArray
        It replaces what an earlier one has drawn.
    """
    reach = sum(monitor.configuration.arm.planar_arm.link_lengths)
    canvas = _Canvas(header, plane_pose, reach)
    if circle_radius is not None:
        corners = circle_radius * np.exp(
            2j * math.pi * np.arange(_CIRCLE_CORNERS + 1) / _CIRCLE_CORNERS)
        canvas.lines('conditioning circle', Marker.LINE_STRIP, corners, 0.005, _GREY)
    if monitor.knows_posture:
        _draw_arm(canvas, monitor)
    else:
        canvas.text(f'UNKNOWN: {monitor.verdict.message}', 0.0, _GREY)
    return canvas.array


def plane_pose_of(frame):
    """Pose message of a displacement (4 x 4 array)."""
    rotation = frame[:3, :3]
    # The quaternion of least trouble: no component is divided by a small one.
    w, x, y, z = (0.5 * math.sqrt(max(0.0, 1.0 + trace)) for trace in (
        rotation.trace(), *(2.0 * rotation[i, i] - rotation.trace() for i in range(3))))
    x = math.copysign(x, rotation[2, 1] - rotation[1, 2])
    y = math.copysign(y, rotation[0, 2] - rotation[2, 0])
    z = math.copysign(z, rotation[1, 0] - rotation[0, 1])
    if w < 1e-6:
        x, y, z = _axis_of_half_turn(rotation)
    position = Point(x=float(frame[0, 3]), y=float(frame[1, 3]), z=float(frame[2, 3]))
    return Pose(position=position,
                orientation=Quaternion(x=float(x), y=float(y), z=float(z), w=float(w)))


def _axis_of_half_turn(rotation):
    """Axis of a rotation by pi, which is (R + 1) / 2 = axis axis^T; any of the two signs."""
    square = 0.5 * (rotation + np.eye(3))
    column = square[:, np.argmax(np.diag(square))]
    return column / np.linalg.norm(column)


def _draw_arm(canvas, monitor):
    verdict = monitor.verdict
    planar_arm, angles = monitor.configuration.arm.planar_arm, monitor.joint_angles
    vectors = planar_arm.operation_point_vectors(angles)
    tip = vectors[0]
    joints = tip - vectors
    colour = _colour_of_margin(verdict.index.margin)
    canvas.lines('links', Marker.LINE_STRIP, [*joints, tip], 0.03, colour)
    canvas.points('joints', joints, 0.05, colour)
    canvas.points('operation point', [tip], 0.06, ColorRGBA(r=0.1, g=0.1, b=0.1, a=1.0))
    if math.isfinite(verdict.index.conditioning_length):
        model_set = monitor.configuration.attained_model_set(monitor.positions, verdict.index)
        ideal = tip - verdict.index.conditioning_length * model_set
        spokes = [point for centre in ideal for point in (tip, centre)]
        canvas.points('isotropic set', ideal, 0.04, _SET)
        canvas.lines('isotropic set spokes', Marker.LINE_LIST, spokes, 0.008, _SET)
    canvas.text(f'z {verdict.index.z:.3f}   l_P {verdict.index.conditioning_length:.3g} m   '
                f'margin {verdict.index.margin:.3f}', tip, colour)


def _colour_of_margin(margin):
    r, g, b = (_SINGULAR + min(max(margin, 0.0), 1.0) * (_ISOTROPIC - _SINGULAR)).tolist()
    return ColorRGBA(r=r, g=g, b=b, a=1.0)


class _Canvas:
    """Markers in the arm's plane, sized by its reach."""

    def __init__(self, header, pose, reach):
        self._header = header
        self._pose = pose
        self._reach = reach
        self.array = MarkerArray(markers=[
            Marker(header=header, action=Marker.DELETEALL)])

    def lines(self, namespace, kind, points, width, colour):
        """Add lines through points of the plane, of a width in fractions of the reach."""
        self._add(namespace, kind, colour, points=_points(points),
                  scale=Vector3(x=width * self._reach))

    def points(self, namespace, points, size, colour):
        """Add a ball at each of the points of the plane."""
        size *= self._reach
        self._add(namespace, Marker.SPHERE_LIST, colour, points=_points(points),
                  scale=Vector3(x=size, y=size, z=size))

    def text(self, text, point, colour):
        """Add a text above a point of the plane."""
        marker = self._add('text', Marker.TEXT_VIEW_FACING, colour, text=text,
                           scale=Vector3(z=0.06 * self._reach))
        marker.pose = _moved(self._pose, _point(point, 0.12 * self._reach))

    def _add(self, namespace, kind, colour, **fields):
        marker = Marker(header=self._header, ns=namespace, type=kind, action=Marker.ADD,
                        pose=self._pose, color=colour, **fields)
        self.array.markers.append(marker)
        return marker


def _points(values):
    return [_point(value, 0.0) for value in values]


def _point(value, height):
    value = complex(value)
    return Point(x=value.real, y=value.imag, z=float(height))


def _moved(pose, point):
    """Pose at a point given in the pose's own axes."""
    q = pose.orientation
    axis, vector = np.array([q.x, q.y, q.z]), np.array([point.x, point.y, point.z])
    turned = vector + 2.0 * np.cross(axis, np.cross(axis, vector) + q.w * vector)
    x, y, z = (turned + [pose.position.x, pose.position.y, pose.position.z]).tolist()
    return Pose(position=Point(x=x, y=y, z=z), orientation=q)
