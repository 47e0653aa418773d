"""The flag on its topic: thresholds and hysteresis at exact numbers."""

import pytest
from support import expected_numbers, ISOTROPIC, LENGTHS, REGULAR, STRETCHED

WARN = 1


def posture_of(number, value):
    """Give the elbow angle at which z or the margin of this arm takes a value, by bisection."""
    inside, outside = ISOTROPIC[1], 0.0
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        numbers = expected_numbers(LENGTHS, [0.0, middle, ISOTROPIC[2]])
        if number == 'margin':
            inside, outside = ((middle, outside) if numbers.margin > value
                               else (inside, middle))
        else:
            inside, outside = (middle, outside) if numbers.z < value else (inside, middle)
    return [0.0, inside, ISOTROPIC[2]]


def test_margin_raises_and_clears_with_hysteresis(make_bench):
    bench = make_bench({'z_max': 1.0, 'margin_min': 0.3, 'hysteresis': 0.2})
    steps = [(0.37, False), (0.3001, False), (0.2999, True), (0.3001, True), (0.3599, True),
             (0.3601, False), (0.3001, False), (0.0, True), (0.9, False)]
    for margin, flag in steps:
        posture = STRETCHED if margin == 0.0 else posture_of('margin', margin)
        assert bench.cycle(posture)[1] is flag, margin


def test_z_raises_and_clears_with_hysteresis(make_bench):
    bench = make_bench({'z_max': 0.5, 'margin_min': 0.0, 'hysteresis': 0.2})
    # Clears at 1 - z > 0.5 * 1.2, that is below z = 0.4.
    steps = [(0.4999, False), (0.5001, True), (0.4999, True), (0.4001, True), (0.3999, False),
             (0.4999, False)]
    for z, flag in steps:
        assert bench.cycle(posture_of('z', z))[1] is flag, z


def test_flag_clears_only_when_both_are_clear(make_bench):
    margin = expected_numbers(LENGTHS, posture_of('z', 0.45)).margin
    bench = make_bench({'z_max': 0.5, 'margin_min': margin - 0.01, 'hysteresis': 0.001})
    assert bench.cycle(posture_of('z', 0.45))[1] is False
    assert bench.cycle(STRETCHED)[1] is True
    assert bench.cycle(posture_of('z', 0.45))[1] is False
    assert bench.set_atomically(margin_min=margin - 0.01, hysteresis=0.12).successful
    assert bench.cycle(STRETCHED)[1] is True
    # Here z alone has not cleared: 1 - z = 0.55 < 0.56.
    assert bench.cycle(posture_of('z', 0.45))[1] is True


@pytest.mark.parametrize('positions', [[0.0, 0.0, 1.0], [0.0, 3.141592653589793, -2.0]])
@pytest.mark.parametrize('margin_min, z_max', [(0.05, 1.0), (0.0001, 0.9), (0.05, 0.9)])
def test_singular_postures_are_flagged(make_bench, positions, margin_min, z_max):
    bench = make_bench({'margin_min': margin_min, 'z_max': z_max})
    assert bench.cycle(positions)[1] is True
    bench.wait_for_level(WARN)


def test_message_says_which_threshold_and_the_value(make_bench):
    bench = make_bench({'z_max': 1.0, 'margin_min': 0.3})
    bench.cycle(posture_of('margin', 0.25))
    status = bench.wait_for_level(WARN)
    assert 'margin_min' in status.message
    assert '0.25' in status.message and '0.3' in status.message
    assert 'z_max' not in status.message
    assert bench.set_atomically(z_max=0.5, margin_min=0.0).successful
    heard = len(bench.diagnostics)
    bench.cycle(posture_of('z', 0.625))
    status = bench.wait_for_level(WARN, since=heard)
    bench.wait(lambda: 'z_max' in bench.status.message, 'the other threshold')
    assert '0.625' in bench.status.message and '0.5' in bench.status.message
    assert 'margin_min' not in bench.status.message


def test_both_thresholds_are_named(make_bench):
    bench = make_bench({'z_max': 0.5})
    bench.cycle(STRETCHED)
    status = bench.wait_for_level(WARN)
    assert 'z_max' in status.message and 'margin_min' in status.message


def test_message_of_a_flag_held_up_by_the_hysteresis(make_bench):
    bench = make_bench({'z_max': 1.0, 'margin_min': 0.3, 'hysteresis': 0.2})
    bench.cycle(posture_of('margin', 0.25))
    bench.wait_for_level(WARN)
    heard = len(bench.diagnostics)
    assert bench.cycle(posture_of('margin', 0.32))[1] is True
    status = bench.wait_for_level(WARN, since=heard)
    assert 'hysteresis' in status.message and '0.32' in status.message


def test_regular_posture_is_clear(bench):
    assert bench.cycle(REGULAR)[1] is False
