"""The index of one posture against the singular values of a 3 x 3 matrix and other libraries."""

import math

import numpy as np
from timing import median, p99, side_by_side

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

JOINTS = (3, 6, 12, 25, 50)
LENGTHS = (1.0, 1.0, math.sqrt(3.0) / 3.0)
ANGLES = (0.3, 1.5, 2.0)


def measure(rounds=200):
    """
    Give the rows of the table and the reasons why libraries are missing.

    Returns
    -------
    rows : list of dict
        name, median_us, p99_us (over samples of 200 calls) and ratio to the svd.
    absent : dict of str to str
    """
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(3, 3))
    calls = {'numpy.linalg.svd of a 3 x 3': lambda: np.linalg.svd(matrix)}
    for n in JOINTS:
        arm = PlanarArm(LENGTHS if n == 3 else tuple(rng.uniform(0.2, 1.0, n)))
        angles = ANGLES if n == 3 else tuple(rng.uniform(-3.0, 3.0, n).tolist())
        calls[f'kinetostatic_index, n = {n}'] = (
            lambda arm=arm, angles=angles: kinetostatic_index(arm, angles))
    absent = {}
    for library, make in (('pin', _pinocchio_calls), ('roboticstoolbox-python', _toolbox_calls)):
        try:
            calls.update(make())
        except ImportError as error:
            absent[library] = str(error)
    samples = side_by_side(calls, rounds)
    base = samples['numpy.linalg.svd of a 3 x 3']
    rows = [{'name': name, 'median_us': median(values), 'p99_us': p99(values),
             'ratio': median(np.divide(values, base))} for name, values in samples.items()]
    return rows, absent


def growth(rows):
    """Time per further joint (us) between neighbouring n: constant where growth is linear."""
    times = {n: row['median_us'] for n in JOINTS for row in rows
             if row['name'] == f'kinetostatic_index, n = {n}'}
    return {f'{a}..{b}': (times[b] - times[a]) / (b - a) for a, b in zip(JOINTS, JOINTS[1:])}


def _pinocchio_calls():
    import pinocchio
    model, parent, placement = pinocchio.Model(), 0, pinocchio.SE3.Identity()
    for i, length in enumerate(LENGTHS):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f'joint_{i}')
        placement = pinocchio.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
    frame = model.addFrame(
        pinocchio.Frame('tip', parent, placement, pinocchio.FrameType.OP_FRAME))
    data, angles = model.createData(), np.array(ANGLES)
    world = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def jacobian_and_svd():
        jacobian = pinocchio.computeFrameJacobian(model, data, angles, frame, world)
        return np.linalg.svd(jacobian[[0, 1, 5]], compute_uv=False)

    return {'Pinocchio: Jacobian and its singular values, n = 3': jacobian_and_svd}


def _toolbox_calls():
    from roboticstoolbox import ET, ETS, Robot
    # Its quickest form: the Jacobian of elementary transforms is compiled, that of DH is not.
    robot = Robot(ETS([transform for a in LENGTHS for transform in (ET.Rz(), ET.tx(a))]))
    angles, axes = np.array(ANGLES), [True, True, False, False, False, True]
    return {f'Robotics Toolbox: {method}, n = 3':
            lambda method=method: robot.manipulability(angles, method=method, axes=axes)
            for method in ('yoshikawa', 'invcondition')}
