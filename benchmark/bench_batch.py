"""
Batch evaluation: z, l_P and margin over a grid of a 3R arm, against a loop over postures.

    python3 benchmark/bench_batch.py [--samples 1000] [--json FILE]

Prints the seconds of the best of five runs, points per second, the ratio to the loop, and the
peak memory that NumPy and Python allocate on top of the grid of angles itself.
"""

import argparse
import json
import platform
import time
import tracemalloc

import numpy as np

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

ARM = PlanarArm((1.0, 1.0, 1.0))
TARGET_SECONDS = 1.5
RUNS = 5
LOOP_POSTURES = 20000


def main(args=None):
    """Run the benchmark; the exit status is 1 if a 1000 x 1000 grid misses its target."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--samples', type=int, default=1000, help='grid points per angle')
    parser.add_argument('--json', metavar='FILE', help='also write the figures to FILE')
    options = parser.parse_args(args)
    figures = measure(options.samples)
    for name, value in figures.items():
        print(f'{name:24s}{value}')
    if options.json:
        with open(options.json, 'w', encoding='utf-8') as file:
            json.dump(figures, file, indent=2)
    return int(options.samples == 1000 and figures['seconds'] > TARGET_SECONDS)


def measure(samples):
    """Give the figures as a dictionary of names with units to numbers."""
    angles = grid_of_angles(samples)
    seconds = min(timed(lambda: kinetostatic_index(ARM, angles)) for _ in range(RUNS))
    postures = angles.reshape(-1, 3)[:LOOP_POSTURES].tolist()
    loop = min(timed(lambda: [kinetostatic_index(ARM, posture) for posture in postures])
               for _ in range(RUNS))
    loop_per_second = len(postures) / loop
    per_second = samples * samples / seconds
    return {
        'grid': f'{samples} x {samples}, n = 3',
        'seconds': round(seconds, 4),
        'points_per_second': round(per_second),
        'loop_points_per_second': round(loop_per_second),
        'ratio_to_loop': round(per_second / loop_per_second, 1),
        'angles_megabytes': round(angles.nbytes / 1e6, 1),
        'peak_megabytes': round(peak_bytes(angles) / 1e6, 1),
        'result_megabytes': round(3 * samples * samples * 8 / 1e6, 1),
        'python': platform.python_version(),
        'numpy': np.__version__,
        'machine': platform.machine(),
    }


def grid_of_angles(samples):
    """Give the angles of the whole torus of theta_2 and theta_3, shape (samples, samples, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, samples)
    angles = np.zeros((samples, samples, 3))
    angles[..., 1] = turn[:, np.newaxis]
    angles[..., 2] = turn
    return angles


def timed(call):
    """Seconds of wall time that a call takes."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def peak_bytes(angles):
    """Peak of the memory allocated during one batch, its result included."""
    tracemalloc.start()
    kinetostatic_index(ARM, angles)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


if __name__ == '__main__':
    raise SystemExit(main())
