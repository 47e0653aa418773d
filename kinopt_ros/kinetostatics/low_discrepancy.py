"""Points that fill a cube evenly, the same on every machine."""

import numpy as np


def kronecker_sequence(count, dimensions):
    """
    Give points of the unit cube: multiples, modulo 1, of powers of the generalised golden ratio.

    Parameters
    ----------
    count, dimensions : int

    Returns
    -------
    points : array, shape (count, dimensions)
        Within [0, 1).

    References
    ----------
    The ratio is the root of x^(d + 1) = x + 1.
    """
    ratio = 2.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return np.arange(1, count + 1)[:, np.newaxis] * steps % 1.0
