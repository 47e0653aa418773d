"""Domains of one's own: never shared, and free again when the process has ended."""

import os
from pathlib import Path
import subprocess
import sys
import tempfile

import pytest

from kinopt_ros.tools import private_domain

HOLD = ('import sys; from kinopt_ros.tools.private_domain import reserve_domain; '
        'print(reserve_domain(), flush=True); sys.stdin.read()')


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Keep the locks of a test away from those of the run."""
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    monkeypatch.setattr(private_domain, '_locks', [])
    yield tmp_path
    for lock in private_domain._locks:
        os.close(lock)


def start(folder):
    root = Path(private_domain.__file__).parents[2]
    return subprocess.Popen(
        [sys.executable, '-c', HOLD], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        cwd=root, env={**os.environ, 'TMPDIR': str(folder)})


def test_domains_are_different_within_a_process(folder):
    domains = [private_domain.reserve_domain() for _ in range(5)]
    assert len(set(domains)) == 5
    assert all(1 <= domain <= 101 for domain in domains)


def test_domains_are_different_among_processes_and_free_again_after_a_kill(folder):
    processes = [start(folder) for _ in range(3)]
    held = [int(process.stdout.readline()) for process in processes]
    assert len({*held, private_domain.reserve_domain()}) == 4
    for process in processes:
        process.kill()
        process.communicate()
    assert set(held) & {private_domain.reserve_domain() for _ in range(3)} == set(held)


def test_none_left(folder):
    for _ in private_domain.DOMAINS:
        private_domain.reserve_domain()
    with pytest.raises(RuntimeError, match='reserved'):
        private_domain.reserve_domain()


def test_this_run_has_its_own():
    assert 1 <= int(os.environ['ROS_DOMAIN_ID']) <= 101
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
