"""
The optimal posture: time per answer, and the ratio to a plain multi-start with SciPy.

    OPENBLAS_NUM_THREADS=1 python3 benchmark/bench_solver.py [--arms 100] [--json FILE]

The arms are random, link lengths over two decades. The plain multi-start runs
scipy.optimize.minimize with its defaults on z from 30 random postures, as many as it takes to
miss less than one arm in a thousand where one start in five leads to the optimum. "until hit"
is the time until one of its starts came within 1e-7 of the optimum: what it would take somebody
who knew the answer and stopped there. "missed" counts the arms where no start did.
"""

import argparse
import json
import math
import platform
import time

import numpy as np
import scipy
from scipy.optimize import minimize

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

TARGET_MILLISECONDS = {3: 5.0, 4: 10.0, 5: 10.0, 6: 10.0, 8: math.inf, 12: 50.0}
REPEATS = 3
PLAIN_ARMS = 10
PLAIN_STARTS = 30


def main(args=None):
    """Run the benchmark; the exit status is 1 if a median misses its target."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--arms', type=int, default=100, help='random arms per n')
    parser.add_argument('--json', metavar='FILE', help='also write the figures to FILE')
    options = parser.parse_args(args)
    print('  n   median      p99  without certificate  plain multi-start   ratio  until hit  '
          'missed')
    print('        [ms]     [ms]                 [ms]               [ms]              [ms]')
    rows = []
    for n in TARGET_MILLISECONDS:
        row = measure(n, options.arms)
        rows.append(row)
        print(f'{n:3d} {row["median_ms"]:8.2f} {row["p99_ms"]:8.2f} '
              f'{row["uncertified_median_ms"]:20.2f} {row["plain_median_ms"]:18.1f} '
              f'{row["ratio"]:7.1f} {row["plain_until_hit_median_ms"]:10.1f} '
              f'{row["plain_missed"]:7d}', flush=True)
    if options.json:
        figures = {'python': platform.python_version(), 'numpy': np.__version__,
                   'scipy': scipy.__version__, 'arms': options.arms, 'solver': rows}
        with open(options.json, 'w', encoding='utf-8') as file:
            json.dump(figures, file, indent=2)
    return int(any(row['median_ms'] > TARGET_MILLISECONDS[row['n']] for row in rows))


def measure(n, arms):
    """Give the figures for one number of joints as a dictionary."""
    rng = np.random.default_rng(n)
    lengths = 10.0 ** rng.uniform(-1.0, 1.0, (arms, n))
    optimal_posture(np.ones(n))
    # All arms, then all again: of the last few the solver remembers what it has found.
    times = [timed(lambda a=a: optimal_posture(a)) for _ in range(REPEATS) for a in lengths]
    uncertified = [timed(lambda a=a: optimal_posture(a, certify=False)) for a in lengths]
    plain = [plain_multi_start(rng, a, optimal_posture(a).z) for a in lengths[:PLAIN_ARMS]]
    seconds, until_hit = map(list, zip(*plain))
    return {
        'n': n,
        'median_ms': 1e3 * float(np.median(times)),
        'p99_ms': 1e3 * float(np.quantile(times, 0.99)),
        'uncertified_median_ms': 1e3 * float(np.median(uncertified)),
        'plain_median_ms': 1e3 * float(np.median(seconds)),
        'ratio': float(np.median(seconds) / np.median(times)),
        'plain_until_hit_median_ms': 1e3 * float(np.median(until_hit)),
        'plain_missed': until_hit.count(math.inf),
    }


def plain_multi_start(rng, lengths, z):
    """Seconds that a plain multi-start takes, and until it first reached z; inf if never."""
    arm = PlanarArm(lengths)
    until_hit = math.inf

    def objective(angles):
        return kinetostatic_index(arm, [0.0, *angles.tolist()]).z

    started = time.perf_counter()
    for _ in range(PLAIN_STARTS):
        found = minimize(objective, rng.uniform(-math.pi, math.pi, arm.n_joints - 1))
        if found.fun < z + 1e-7:
            until_hit = min(until_hit, time.perf_counter() - started)
    return time.perf_counter() - started, until_hit


def timed(call):
    """Seconds that a call takes."""
    started = time.perf_counter()
    call()
    return time.perf_counter() - started


if __name__ == '__main__':
    raise SystemExit(main())
