"""
The index z with its gradient and Hessian by theta_2 ... theta_n, for batches of postures.

With the link vectors l_k = a_k exp(i phi_k), phi_k the absolute angles, all three sums behind z
are quadratic forms with fixed real matrices,

    R = conj(l) M l,    P = conj(l) G l,    Q = l G l,
    M_jk = min(j, k),   G_jk = min(j, k) - j k / n,

so that every second derivative is an entry of M or G times a product of two link vectors.
"""

from typing import NamedTuple

import numpy as np


class IndexExpansion(NamedTuple):
    """
    Second-order expansion of z at many postures.

    Attributes
    ----------
    z : array, shape (k,)
    gradient : array, shape (k, n - 1)
        dz/dtheta_j in 1/rad, j = 2 ... n.
    hessian : array, shape (k, n - 1, n - 1)
        Second derivatives in 1/rad^2.
    """

    z: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray


def index_expansion(arm, conditioning_angles):
    """
    Expand z to second order at many postures.

    On the singular set, where z has a crease, the result is finite but is no derivative.

    Parameters
    ----------
    arm : PlanarArm
    conditioning_angles : array, shape (k, n - 1)
        Joint angles theta_2 ... theta_n in rad; not validated.

    Returns
    -------
    expansion : IndexExpansion
    """
    n = arm.n_joints
    counts = np.arange(1.0, n + 1.0)
    about_tip = np.minimum.outer(counts, counts)
    about_centroid = about_tip - np.outer(counts, counts) / n
    links = _links_in_principal_axes(arm, conditioning_angles, about_centroid)
    x, y = links.real, links.imag
    gx, gy, mx, my = x @ about_centroid, y @ about_centroid, x @ about_tip, y @ about_tip
    s1 = np.sqrt(_dot(x, gx))
    # The floor keeps the quotients finite at a singular posture.
    s2 = np.maximum(np.sqrt(np.maximum(_dot(y, gy), 0.0)), 1e-14 * s1)
    total = s1 + s2
    r_squared = _dot(x, mx) + _dot(y, my)
    closeness = total * total / (2.0 * r_squared)

    # By phi_k, with F = (s1 + s2)^2 = P + D and D = 2 s1 s2. In principal axes Q is real.
    up, down, f_over_r = ((total / s2)[:, None], (total / s1)[:, None],
                          (2.0 * closeness)[:, None])
    r_k = 2.0 * (x * my - y * mx)
    p_k = 2.0 * (x * gy - y * gx)
    f_k = 2.0 * (up * x * gy - down * y * gx)
    gradient = (f_over_r * r_k - f_k) / (2.0 * r_squared)[:, None]

    xx, yy = _outer(x, x), _outer(y, y)
    second = about_centroid * (up[:, :, None] * xx + down[:, :, None] * yy)
    second -= about_tip * (f_over_r[:, :, None] * (xx + yy))
    second[:, np.arange(n), np.arange(n)] += (
        f_over_r * (x * mx + y * my) - down * x * gx - up * y * gy)
    gradient_r = _outer(gradient, r_k)
    second += gradient_r + gradient_r.transpose(0, 2, 1)
    # What is left of D'': (P_k P_m - Re(conj(Q_k) Q_m) - D_k D_m) / (2 D).
    second += _outer_sum(
        (p_k, -2.0 * (x * gy + y * gx), 2.0 * (x * gx - y * gy), f_k - p_k),
        (1.0, -1.0, -1.0, -1.0)) / (4.0 * s1 * s2)[:, None, None]
    second /= -r_squared[:, None, None]
    return IndexExpansion(1.0 - closeness, *_by_relative_angles(gradient, second))


def _links_in_principal_axes(arm, conditioning_angles, about_centroid):
    """Link vectors, in the unit of the longest, with sum c_i^2 turned to be real."""
    absolute = np.zeros((len(conditioning_angles), arm.n_joints))
    np.cumsum(conditioning_angles, axis=1, out=absolute[:, 1:])
    links = np.asarray(arm.unit_lengths) * np.exp(1j * absolute)
    q = ((links @ about_centroid) * links).sum(axis=1)
    return links * np.exp(-0.5j * np.angle(q))[:, None]


def _by_relative_angles(gradient, hessian):
    """Pass from phi_k to theta_j, which turns all links k >= j, and drop theta_1."""
    return (_tail_sums(gradient, 1)[:, 1:],
            _tail_sums(_tail_sums(hessian, 1), 2)[:, 1:, 1:])


def _tail_sums(values, axis):
    return np.flip(np.cumsum(np.flip(values, axis), axis=axis), axis)


def _dot(u, v):
    return np.einsum('ij,ij->i', u, v)


def _outer(u, v):
    return u[:, :, None] * v[:, None, :]


def _outer_sum(vectors, signs):
    """Sum of signs times v v^T."""
    stacked = np.stack(vectors, axis=2)
    return (stacked * np.asarray(signs)) @ stacked.transpose(0, 2, 1)
