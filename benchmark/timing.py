"""What the benchmarks share: timing side by side, percentiles, and the machine's description."""

import os
import platform
import time

import numpy as np


def side_by_side(calls, rounds=200, repeats=200):
    """
    Time calls in turn, so that whatever disturbs the machine disturbs all of them.

    Parameters
    ----------
    calls : dict of str to callable
    rounds : int
        Samples of each.
    repeats : int
        Calls per sample.

    Returns
    -------
    samples : dict of str to list of float
        Microseconds per call.
    """
    samples = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            for _ in range(repeats):
                call()
            samples[name].append((time.perf_counter() - start) / repeats * 1e6)
    return samples


def median(values):
    """Median, a float."""
    return float(np.median(values))


def p99(values):
    """99th percentile, a float."""
    return float(np.percentile(values, 99))


def interval(samples, figure, resamplings=300):
    """95 % interval of a figure of a list of samples, by resampling them; two floats."""
    rng = np.random.default_rng(0)
    figures = [figure([samples[i] for i in rng.integers(len(samples), size=len(samples))])
               for _ in range(resamplings)]
    return np.percentile(figures, (2.5, 97.5)).tolist()


def machine():
    """Describe the machine and the software that it runs."""
    from importlib.metadata import PackageNotFoundError, version
    description = {
        'processor': _processor(), 'cores': os.cpu_count(), 'system': platform.platform(),
        'load': [round(load, 2) for load in os.getloadavg()],
        'python': platform.python_version(), 'numpy': np.__version__}
    for package in ('ros-jazzy-rclpy', 'ros-jazzy-rmw-fastrtps-cpp', 'pin',
                    'roboticstoolbox-python'):
        try:
            description[package] = version(package)
        except PackageNotFoundError:
            pass
    return description


def _processor():
    try:
        with open('/proc/cpuinfo') as file:
            return next(line.split(':', 1)[1].strip() for line in file
                        if line.startswith('model name'))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
