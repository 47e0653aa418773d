"""The solver's process by itself; what becomes of it on a node: test_optimal_posture_service."""

import os
import pickle
import subprocess
import sys
import time

import pytest
from support import DEADLINE, LENGTHS

from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.monitor.solver_process import main, SolverProcess, SPACING


@pytest.fixture
def solver():
    solver = SolverProcess()
    yield solver
    solver.close()


def test_answers_are_those_of_the_solver_in_their_order(solver):
    arms = [LENGTHS, (1.0, 1.0, 1.0), (1.0, 0.5, 0.25, 0.2)]
    asked = [solver.submit(arm) for arm in arms]
    for arm, future in zip(arms, asked):
        expected = optimal_posture(arm)
        assert future.result(DEADLINE).joint_angles == pytest.approx(expected.joint_angles)
    assert solver.waiting == 0


def test_whoever_asks_without_pause_is_served_at_intervals(solver):
    """Answered from memory, each of these takes a small part of the interval."""
    solver.submit(LENGTHS).result(DEADLINE)
    begun = time.monotonic()
    for _ in range(10):
        solver.submit(LENGTHS).result(DEADLINE)
    assert time.monotonic() - begun > 9 * SPACING


def test_closing_does_not_leave_anybody_waiting(solver):
    asked = [solver.submit(LENGTHS) for _ in range(8)]
    solver.close()
    assert all(future.done() for future in asked)
    assert any(future.cancelled() or future.exception() for future in asked)


def test_goes_quietly_when_nobody_waits_for_its_answer():
    """As when the node was killed while it solved."""
    nobody, answers = os.pipe()
    os.close(nobody)
    process = subprocess.Popen(
        [sys.executable, '-c', f'from {main.__module__} import main; main()'],
        stdin=subprocess.PIPE, stdout=answers, stderr=subprocess.PIPE)
    os.close(answers)
    _, error = process.communicate(pickle.dumps((LENGTHS,)), timeout=DEADLINE)
    assert (process.returncode, error) == (0, b'')
