"""
The interfaces of kinopt_interfaces: the state of each cycle, and a solver for any link lengths.

Importing this module needs that package; the node does without where it is not built.
"""

import math

from kinopt_interfaces.msg import KinetostaticState, PostureAlternative
from kinopt_interfaces.srv import SolveOptimalPosture
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.monitor.deferred_service import create_deferred_service
from kinopt_ros.monitor.optimum_services import completed, mapped

# The most joints of a request: the solver's time grows with them.
MOST_JOINTS = 50


class TypedInterfaces:
    """
    Offer `~/state` and `~/solve_optimal_posture` on a node.

    Parameters
    ----------
    node : rclpy.node.Node
    topics : OnDemandTopics
        Of each verdict.
    monitor : PostureMonitor
    optimum : OptimumServices
        Its solver is used.
    header : callable
        Gives the header of the JointState that was judged.
    """

    def __init__(self, node, topics, monitor, optimum, header):
        self._monitor = monitor
        self._optimum = optimum
        topics.add(node.create_publisher(KinetostaticState, '~/state', 10),
                   lambda *_: _state(monitor, header()))
        create_deferred_service(
            node, SolveOptimalPosture, '~/solve_optimal_posture', self._on_request)

    def _on_request(self, request):
        try:
            arguments, to_positions = self._judged(request)
        except ValueError as error:
            return completed(_refusal(str(error)))
        if self._optimum.is_busy:
            return completed(_refusal(self._optimum.busy_reason))
        return mapped(self._optimum.solve(*arguments),
                      lambda solved: _response(solved, to_positions))

    def _judged(self, request):
        """Arguments for the solver, and the way back to the coordinates of the answer."""
        n = len(request.link_lengths)
        if n > MOST_JOINTS:
            raise ValueError(f'link_lengths holds {n} values: must be at most {MOST_JOINTS}')
        arm = self._monitor.configuration.arm
        if n == 0:
            lower = request.joint_lower or arm.joint_lower
            upper = request.joint_upper or arm.joint_upper
            reference = request.reference or self._monitor.reference_positions
            _check(arm.n_joints, lower, upper, reference)
            limits = arm.angles_between(lower, upper)
            return ((arm.planar_arm.link_lengths, *limits, arm.joint_angles(reference)),
                    arm.joint_positions)
        planar_arm = PlanarArm(request.link_lengths)
        lower, upper = request.joint_lower or None, request.joint_upper or None
        reference = request.reference or None
        if reference is None and n == arm.n_joints and self._monitor.knows_posture:
            reference = self._monitor.joint_angles
        _check(n, lower, upper, reference)
        return (planar_arm.link_lengths, lower, upper, reference), list


def _check(n, lower, upper, reference):
    """
    Judge limits and reference before the solver is asked.

    Raises
    ------
    ValueError
        Names the field, its value and the rule.
    """
    for name, values in (('joint_lower', lower), ('joint_upper', upper),
                         ('reference', reference)):
        if values is None:
            continue
        if len(values) != n:
            raise ValueError(f'{name} holds {len(values)} values: must be empty or hold '
                             f'{n}, one per joint')
        for i, value in enumerate(values):
            if math.isnan(value) or (name == 'reference' and math.isinf(value)):
                raise ValueError(f'{name}[{i}] = {value}: must be '
                                 f'{"finite" if name == "reference" else "a number"}')
    for i in range(n):
        least, most = lower[i] if lower else -math.inf, upper[i] if upper else math.inf
        if least > most:
            raise ValueError(f'joint_lower[{i}] = {least}: must not be above '
                             f'joint_upper[{i}] = {most}')
        if least == math.inf or most == -math.inf:
            name, value = ('joint_lower', least) if least > 0.0 else ('joint_upper', most)
            raise ValueError(f'{name}[{i}] = {value}: must leave some positions')


def _refusal(message):
    return SolveOptimalPosture.Response(
        success=False, message=message, z=math.nan, characteristic_length=math.nan,
        margin=math.nan)


def _response(solved, to_positions):
    if solved.exception() is not None:
        return _refusal(str(solved.exception()))
    posture = solved.result()
    return SolveOptimalPosture.Response(
        success=True, joint_positions=to_positions(posture.joint_angles), z=posture.z,
        characteristic_length=posture.characteristic_length, margin=posture.margin,
        isotropic=posture.isotropic,
        alternatives=[
            PostureAlternative(joint_positions=to_positions(other.joint_angles), z=other.z,
                               margin=other.margin) for other in posture.alternatives])


def _state(monitor, header):
    verdict, motion = monitor.verdict, monitor.motion()
    known = monitor.knows_posture
    return KinetostaticState(
        header=header, z=verdict.index.z,
        conditioning_length=verdict.index.conditioning_length, margin=verdict.index.margin,
        near_singularity=verdict.near_singularity, level=bytes([verdict.level]),
        message=verdict.message, joint_names=monitor.configuration.arm.joint_names,
        joint_positions=monitor.positions if known else [],
        gradient=monitor.gradient().z.tolist() if known else [],
        z_rate=motion.z_rate, margin_rate=motion.margin_rate, trend=int(motion.trend),
        time_to_threshold=motion.time_to_threshold)
