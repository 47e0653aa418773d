"""Minimise z from many starting postures at once: Newton's method within joint limits."""

from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.hessian import index_expansion

_MAX_ITERATIONS = 100
# The step after one that promised less than this is below rounding, as convergence is quadratic.
_FINAL_DECREASE = 1e-13
# Curvatures below this fraction of the largest are taken for it: flat families of optima.
_LEAST_CURVATURE = 1e-10
_LONGEST_STEP = 1.0
_SHORTEST_FRACTION = 1e-6
# Against division by zero.
_TINY = 1e-300


class Descent(NamedTuple):
    """
    Where the starts ended.

    Attributes
    ----------
    angles : array, shape (k, n - 1)
        theta_2 ... theta_n in rad.
    converged : array of bool, shape (k,)
        Whether the last step promised less than rounding.
    iterations : int
        Evaluations of the batch.
    """

    angles: np.ndarray
    converged: np.ndarray
    iterations: int


def descend(arm, starts, lower, upper, weight=0.0, reference=None):
    """
    Minimise z, or z + weight |theta - reference|^2, from every start.

    Newton's method with the absolute values of the curvatures, so that every step descends and
    saddles repel; backtracking; joints at a limit that the gradient holds there are left out.

    Parameters
    ----------
    arm : PlanarArm
    starts : array, shape (k, n - 1)
        theta_2 ... theta_n in rad, within the limits.
    lower, upper : array, shape (n - 1,)
        Joint limits in rad, may be infinite.
    weight : float
        In 1/rad^2.
    reference : array, shape (n - 1,), optional
        Needed where the weight is not 0.

    Returns
    -------
    descent : Descent
    """
    angles = starts.copy()
    converged = np.zeros(len(starts), dtype=bool)
    rows = np.arange(len(starts))
    here, step = starts, np.zeros_like(starts)
    value = np.full(len(starts), np.inf)
    fraction, promise = np.ones(len(starts)), np.zeros(len(starts))
    iterations = 0
    while len(rows) and iterations < _MAX_ITERATIONS:
        iterations += 1
        trial = np.clip(here + fraction[:, None] * step, lower, upper)
        z, gradient, hessian = _expansion(arm, trial, weight, reference)
        better = z <= value - 1e-4 * fraction * promise + 1e-16
        here = np.where(better[:, None], trial, here)
        value = np.where(better, z, value)
        new_step, new_promise = _newton_step(here, gradient, hessian, lower, upper)
        step = np.where(better[:, None], new_step, step)
        promise = np.where(better, new_promise, promise)
        fraction = np.where(better, 1.0, 0.5 * fraction)
        done = better & (promise < _FINAL_DECREASE)
        angles[rows] = np.where(done[:, None], np.clip(here + step, lower, upper), here)
        converged[rows[done]] = True
        going = ~done & (fraction > _SHORTEST_FRACTION)
        rows, here, step, value, fraction, promise = (
            values[going] for values in (rows, here, step, value, fraction, promise))
    return Descent(angles, converged, iterations)


def _expansion(arm, angles, weight, reference):
    z, gradient, hessian = index_expansion(arm, angles)
    if weight:
        offset = angles - reference
        z = z + weight * (offset * offset).sum(axis=1)
        gradient = gradient + 2.0 * weight * offset
        hessian = hessian + 2.0 * weight * np.eye(angles.shape[1])
    return z, gradient, hessian


def _newton_step(angles, gradient, hessian, lower, upper):
    """Step and the decrease of z that it promises, joints held at their limits left out."""
    at_lower, at_upper = angles <= lower, angles >= upper
    held = (at_lower & (gradient > 0.0)) | (at_upper & (gradient < 0.0))
    step, promise = _free_step(gradient, hessian, held)
    # A coupled step can push a joint beyond its limit against that joint's own gradient.
    pushed = (at_lower & (step < 0.0)) | (at_upper & (step > 0.0))
    if pushed.any():
        step, promise = _free_step(gradient, hessian, held | pushed)
    return step, promise


def _free_step(gradient, hessian, held):
    if held.any():
        gradient = np.where(held, 0.0, gradient)
        hessian = np.where(held[:, :, None] | held[:, None, :], 0.0, hessian)
    curvatures, axes = np.linalg.eigh(hessian)
    curvatures = np.abs(curvatures)
    curvatures = np.maximum(
        curvatures, _LEAST_CURVATURE * curvatures.max(axis=1, keepdims=True) + _TINY)
    along = (axes.transpose(0, 2, 1) @ gradient[:, :, None])[:, :, 0]
    step = -(axes @ (along / curvatures)[:, :, None])[:, :, 0]
    if held.any():
        step = np.where(held, 0.0, step)
    longest = np.abs(step).max(axis=1)
    shrink = np.minimum(1.0, _LONGEST_STEP / np.maximum(longest, _TINY))
    step = step * shrink[:, None]
    return step, -(step * gradient).sum(axis=1)
