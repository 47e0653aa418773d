"""
All benchmarks: one command, plain text on standard output and JSON in a file.

    python3 benchmark/run.py [--short] [--json output/benchmark.json]

The short form is for breakage, not for time: its figures mean little.
"""

import argparse
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile

from timing import machine

from kinopt_ros.tools.private_domain import reserve_domain

HERE = Path(__file__).parent
MEASURED = ('index', 'node', 'endurance', 'load', 'startup', 'solver', 'batch')


def main(args=None):
    """Run the benchmarks; the exit status is 1 if one of them breaks."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--short', action='store_true', help='run everything, briefly')
    parser.add_argument('--only', choices=MEASURED, nargs='+', default=MEASURED)
    parser.add_argument('--json', type=Path, default=Path('output/benchmark.json'))
    options = parser.parse_args(args)
    # Nobody else hears the benchmark, and it hears nobody else.
    os.environ.update(ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST',
                      ROS_DOMAIN_ID=str(reserve_domain()))
    figures = {'machine': machine(), 'short': options.short}
    for name, value in figures['machine'].items():
        print(f'{name:28s}{value}')
    for name in options.only:
        print(f'\n{name}', flush=True)
        figures[name] = globals()[f'_{name}'](options.short)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    print(f'\nwritten to {options.json}')
    return 0


def _index(short):
    import bench_index
    rows, absent = bench_index.measure(20 if short else 200)
    print(f'{"":54s}  median[us]  p99[us]  ratio to svd')
    for row in rows:
        print(f'{row["name"]:54s}{row["median_us"]:12.2f}{row["p99_us"]:9.2f}'
              f'{row["ratio"]:14.2f}')
    for library, reason in absent.items():
        print(f'without {library}: {reason}')
    per_joint = bench_index.growth(rows)
    print('us per further joint:', ', '.join(f'{k}: {v:.2f}' for k, v in per_joint.items()))
    return {'rows': rows, 'absent': absent, 'us_per_further_joint': per_joint}


def _node(short):
    rows = _over_dds('measure', *(0.5, 1, 1, (1000,)) if short else (1.0, 6, 2))
    print(f'{"":26s}{"rate[Hz]":>8s}{"CPU[us]":>9s}{"ratio":>7s}{"(95 %)":>13s}'
          f'{"median[us]":>12s}{"ratio":>7s}{"p99[us]":>9s}{"ratio":>7s}{"(95 %)":>13s}'
          '  lost/sent')
    for row in rows:
        print(f'{row["system"]:26s}{row["rate_hz"]:8d}{row["cpu_us_per_message"]:9.0f}'
              f'{_ratio_with_interval(row, "cpu_us_per_message")}'
              f'{row["latency_median_us"]:12.0f}{row["latency_median_us_ratio"]:7.2f}'
              f'{row["latency_p99_us"]:9.0f}{_ratio_with_interval(row, "latency_p99_us")}'
              f'  {row["lost"]}/{row["sent"]}')
    return rows


def _ratio_with_interval(row, key):
    least, most = row[f'{key}_ratio_interval']
    return f'{row[f"{key}_ratio"]:7.2f}  {least:5.2f}-{most:4.2f}'


def _endurance(short):
    figures = _over_dds('endurance', 5.0 if short else 60.0)
    for name, row in figures.items():
        print(f'{name:18s}{row["lost"]} of {row["sent"]} messages lost ({row["wanted"]} instants '
              f'of 1000 Hz), longest latency {row["latency_longest_us"] / 1e3:.1f} ms, memory '
              f'{row["memory_mb"]:.1f} MB, grown by {row["memory_growth_mb"]:.2f} MB')
    return figures


def _load(short):
    figures = _over_dds('under_load', 1.0 if short else 15.0)
    for priority, rows in figures.items():
        if 'skipped' in rows:
            print(f'{priority}: left out, {rows["skipped"]}')
            continue
        for name in ('idle', 'loaded'):
            run = rows[name]
            print(f'{priority:12s} {name:8s}{run["answers"]:6d} answers, {run["lost"]} of '
                  f'{run["sent"]} cycles lost, latency median {run["latency_median_us"]:.0f} us, '
                  f'p99 {run["latency_p99_us"]:.0f} us')
        print(f'{priority:12s} ratio of the p99: {rows["latency_p99_ratio"]:.2f}')
    return figures


def _startup(short):
    figures = _over_dds('startup', 1 if short else 10)
    for name, times in figures.items():
        print(f'{name:18s} median {times["median_s"]:.2f} s, worst {times["worst_s"]:.2f} s')
    return figures


def _over_dds(function, *arguments):
    import bench_node
    bench_node.begin()
    try:
        return getattr(bench_node, function)(*arguments)
    finally:
        bench_node.end()


def _solver(short):
    return _script('bench_solver.py', '--arms', '3' if short else '100')


def _batch(short):
    return _script('bench_batch.py', '--samples', '100' if short else '1000')


def _script(name, *arguments):
    """Run a benchmark that is a script of its own; a target missed is no breakage."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'figures.json'
        subprocess.run([sys.executable, HERE / name, *arguments, '--json', path],
                       env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'}, check=False)
        return json.loads(path.read_text())


if __name__ == '__main__':
    sys.exit(main())
