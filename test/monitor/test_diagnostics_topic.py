"""The diagnostics: content, stamp, and when they come."""

import math
import time

import pytest
from support import expected_numbers, ISOTROPIC, LENGTHS, NAMES, REGULAR, STRETCHED

OK, WARN, ERROR, STALE = range(4)


def levels(bench):
    return [int.from_bytes(a.status[0].level, 'little') for a in bench.diagnostics]


@pytest.fixture
def quiet(make_bench):
    """A bench with diagnostics only where something changes."""
    return make_bench({'diagnostics_period': 3600.0})


def test_content(make_bench):
    offsets, directions = [0.1, 0.2, 0.3], [1, -1, 1]
    bench = make_bench({'joint_offsets': offsets, 'joint_directions': directions,
                        'z_max': 0.8, 'margin_min': 0.07, 'diagnostics_period': 0.0})
    bench.cycle(REGULAR, stamp=(12, 345))
    bench.wait_for_level(OK)
    array = bench.diagnostics[-1]
    assert len(array.status) == 1
    assert (array.header.stamp.sec, array.header.stamp.nanosec) == (12, 345)
    assert bench.status.name == 'singularity_monitor: posture'
    assert bench.status.hardware_id == 'singularity_monitor'
    assert bench.status.message
    angles = [d * p + o for d, p, o in zip(directions, REGULAR, offsets)]
    z, length, margin = expected_numbers(LENGTHS, angles)
    values = bench.values
    assert len(values) == len(bench.status.values)
    assert float(values['z']) == pytest.approx(z, abs=1e-9)
    assert float(values['conditioning length (m)']) == pytest.approx(length, abs=1e-9)
    assert float(values['margin']) == pytest.approx(margin, abs=1e-9)
    assert float(values['z_max']) == 0.8
    assert float(values['margin_min']) == 0.07
    for name, angle in zip(NAMES, angles):
        key, = (key for key in values if name in key)
        assert 'rad' in key
        assert float(values[key]) == pytest.approx(angle, abs=1e-9)
    assert float(values['input rate (Hz)']) >= 0.0
    assert values['messages accepted'] == '1'
    assert values['messages rejected'] == '0'


def test_at_once_when_the_level_changes(quiet):
    for positions, level in [(ISOTROPIC, OK), (STRETCHED, WARN), (ISOTROPIC, OK),
                             ([math.nan] * 3, ERROR), (REGULAR, OK)]:
        heard = len(quiet.diagnostics)
        quiet.cycle(positions)
        quiet.wait_for_level(level, since=heard)
    assert levels(quiet)[-5:] == [OK, WARN, OK, ERROR, OK]


def test_at_once_when_the_reason_changes(quiet):
    for positions, word in [([math.nan, 0.0, 0.0], 'shoulder'), ([0.0, math.nan, 0.0], 'elbow'),
                            ([0.0, 0.0], '2 positions')]:
        heard = len(quiet.diagnostics)
        quiet.cycle(positions)
        quiet.wait_for_level(ERROR, since=heard)
        assert word in quiet.status.message


def test_no_diagnostics_while_nothing_changes(quiet):
    quiet.cycle(ISOTROPIC)
    quiet.wait_for_level(OK)
    heard = len(quiet.diagnostics)
    for i in range(20):
        quiet.cycle([0.1 * i, *ISOTROPIC[1:]])
    quiet.cycle(STRETCHED)
    quiet.wait_for_level(WARN)
    # Of the cycles between these two there was nothing to tell.
    assert len(quiet.diagnostics) == heard + 1


def test_periodic_while_nothing_changes(make_bench):
    bench = make_bench({'diagnostics_period': 0.1})
    heard = len(bench.diagnostics)
    bench.wait(lambda: len(bench.diagnostics) >= heard + 6, 'five periods')
    # By the stamps, which are the node's own before the first JointState: several may have
    # waited for this process to look.
    first, last = (bench.diagnostics[i].header.stamp for i in (heard, heard + 5))
    assert (last.sec - first.sec) + 1e-9 * (last.nanosec - first.nanosec) > 0.35
    assert set(levels(bench)) == {STALE}
    for name in NAMES:
        assert name in bench.status.message


def test_period_0_is_each_cycle(make_bench):
    bench = make_bench({'diagnostics_period': 0.0})
    for i in range(12):
        heard = len(bench.diagnostics)
        bench.cycle([0.0, 1.0 + 0.01 * i, 2.0], stamp=(i + 1, 0))
        bench.wait(lambda heard=heard: len(bench.diagnostics) > heard, 'diagnostics')
        assert bench.diagnostics[-1].header.stamp.sec == i + 1
    assert len(bench.diagnostics) == 12


def test_period_changes_at_run_time(make_bench):
    bench = make_bench({'diagnostics_period': 3600.0})
    bench.cycle(ISOTROPIC)
    bench.wait_for_level(OK)
    assert bench.set(diagnostics_period=0.05)[0].successful
    heard = len(bench.diagnostics)
    bench.wait(lambda: len(bench.diagnostics) >= heard + 3, 'short periods')
    assert bench.set(diagnostics_period=0.0)[0].successful
    bench.cycle(ISOTROPIC)
    bench.linger(0.05)
    heard = len(bench.diagnostics)
    for _ in range(3):
        bench.cycle(ISOTROPIC)
    bench.linger(0.3)
    assert len(bench.diagnostics) == heard + 3
    assert bench.set(diagnostics_period=0.05)[0].successful
    bench.wait(lambda: len(bench.diagnostics) >= heard + 6, 'short periods again')


def test_stamp_is_that_of_the_joint_state(make_bench):
    bench = make_bench({'diagnostics_period': 0.05})
    bench.cycle(REGULAR, stamp=(1, 2))
    heard = len(bench.diagnostics)
    bench.wait(lambda: len(bench.diagnostics) > heard + 2, 'periodic diagnostics')
    for array in bench.diagnostics[heard + 1:]:
        assert (array.header.stamp.sec, array.header.stamp.nanosec) == (1, 2)


def test_input_rate(make_bench):
    bench = make_bench({'diagnostics_period': 0.0})
    times = []
    for _ in range(21):
        bench.cycle(REGULAR)
        times.append(time.monotonic())
        bench.linger(0.01)
    bench.wait(lambda: len(bench.diagnostics) >= 21, 'diagnostics')
    rate = 20.0 / (times[-1] - times[0])
    assert float(bench.values['input rate (Hz)']) == pytest.approx(rate, rel=0.25)


def test_input_rate_counts_no_bad_messages(make_bench):
    bench = make_bench({'diagnostics_period': 0.0})
    for _ in range(10):
        bench.cycle([math.nan] * 3)
    bench.wait(lambda: len(bench.diagnostics) >= 10, 'diagnostics')
    # Whatever the rate is of, a rate without an accepted message or with bad ones alone
    # must not look like a healthy input.
    assert float(bench.values['input rate (Hz)']) == 0.0


def test_values_are_of_one_configuration(make_bench):
    """A change between two messages must not mix its angles or thresholds with old numbers."""
    bench = make_bench({'diagnostics_period': 0.05})
    bench.cycle(REGULAR)
    bench.wait_for_level(OK)
    assert bench.set(joint_offsets=[0.0, 0.5, 0.0])[0].successful
    heard = len(bench.diagnostics)
    bench.wait(lambda: len(bench.diagnostics) > heard + 2, 'periodic diagnostics')
    values = bench.values
    angles = [float(value) for key, value in values.items() if 'rad' in key]
    expected = expected_numbers(LENGTHS, angles)
    assert float(values['z']) == pytest.approx(expected.z, abs=1e-9)


def test_threshold_set_below_the_known_z_does_not_stay_ok(make_bench):
    bench = make_bench({'diagnostics_period': 0.05})
    bench.cycle(REGULAR)
    bench.wait_for_level(OK)
    assert bench.set(z_max=0.2)[0].successful
    assert expected_numbers(LENGTHS, REGULAR).z > 0.2
    heard = len(bench.diagnostics)
    bench.wait(lambda: len(bench.diagnostics) > heard + 2, 'periodic diagnostics')
    values = bench.values
    assert not (bench.level == OK and float(values['z']) > float(values['z_max']))
