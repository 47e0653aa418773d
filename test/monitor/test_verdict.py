"""Thresholds, the flag with its hysteresis, and the verdicts made of them."""

import itertools
import math

import numpy as np
import pytest

from kinopt_ros.kinetostatics.index import KinetostaticIndex
from kinopt_ros.monitor.posture import BadJointStateError
from kinopt_ros.monitor.verdict import (
    Level,
    ProximityFlag,
    Thresholds,
    verdict_on_bad_message,
    verdict_on_index,
    verdict_on_silence,
)


def index(z, margin):
    return KinetostaticIndex(z, 0.5, margin)


def test_defaults():
    assert Thresholds() == Thresholds(0.9, 0.05, 0.1, 0.0)


@pytest.mark.parametrize('changes, words', [
    ({'z_max': -0.01}, ['z_max', '-0.01']), ({'z_max': 1.01}, ['z_max', '1.01']),
    ({'z_max': math.nan}, ['z_max', 'nan']), ({'margin_min': -1.0}, ['margin_min', '-1.0']),
    ({'margin_min': 1.01}, ['margin_min', '1.01']),
    ({'margin_min': math.nan}, ['margin_min', 'nan']),
    ({'hysteresis': -0.1}, ['hysteresis', '-0.1']),
    ({'hysteresis': math.inf}, ['hysteresis', 'inf']),
    ({'hysteresis': math.nan}, ['hysteresis', 'nan']),
    ({'margin_min': 0.95}, ['margin_min', '0.95', 'hysteresis', '0.1', 'never clear']),
    ({'z_max': 0.05}, ['z_max', '0.05', 'hysteresis', '0.1', 'never clear']),
    ({'hysteresis': 19.1}, ['hysteresis', '19.1', 'never clear']),
])
def test_bad_thresholds(changes, words):
    with pytest.raises(ValueError) as error:
        Thresholds(**changes)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize('z, margin, raised', [
    (0.89, 0.051, False), (0.9, 0.05, False), (0.9000001, 0.5, True), (0.2, 0.0499999, True),
    (0.95, 0.01, True), (0.0, 1.0, False), (0.5, 0.0, True)])
def test_flag_rises_beyond_a_threshold_and_not_at_it(z, margin, raised):
    assert ProximityFlag().update(index(z, margin), Thresholds(), 0.0) is raised


def test_flag_against_the_rule_of_the_contract():
    """A random walk through thresholds, with and without hysteresis."""
    rng = np.random.default_rng(5)
    for h, (z_max, margin_min) in itertools.product(
            (0.0, 0.1, 1.0), [(0.9, 0.05), (0.6, 0.2), (1.0, 0.3), (0.7, 0.0)]):
        thresholds, flag, expected = Thresholds(z_max, margin_min, h), ProximityFlag(), False
        seen = set()
        for step in range(2000):
            z = rng.uniform(0.0, 1.0)
            margin = rng.uniform(0.0, 1.0 - z)
            if z > z_max or margin < margin_min:
                expected = True
            elif margin > margin_min * (1 + h) and 1 - z > (1 - z_max) * (1 + h):
                expected = False
            assert flag.update(index(z, margin), thresholds, float(step)) is expected
            seen.add(expected)
        assert seen == {True, False}


def test_unknown_posture_raises_the_flag():
    flag = ProximityFlag()
    flag.raise_at(0.0)
    assert flag.raised
    assert flag.update(index(0.5, 0.052), Thresholds(), 1.0) is True
    assert flag.update(index(0.5, 0.06), Thresholds(), 2.0) is False


def verdict_of(z, margin):
    flag, thresholds = ProximityFlag(), Thresholds()
    flag.update(index(z, margin), thresholds, 0.0)
    return verdict_on_index(index(z, margin), flag, thresholds)


def test_verdict_on_a_clear_posture():
    verdict = verdict_of(0.5, 0.4)
    assert verdict.level == Level.OK
    assert verdict.near_singularity is False
    assert verdict.index == index(0.5, 0.4)


@pytest.mark.parametrize('z, margin, words, absent', [
    (0.925, 0.07, ['z_max', '0.925', '0.9'], 'margin_min'),
    (0.8, 0.0321, ['margin_min', '0.0321', '0.05'], 'z_max'),
])
def test_verdict_names_threshold_and_value(z, margin, words, absent):
    verdict = verdict_of(z, margin)
    assert verdict.level == Level.WARN
    assert verdict.near_singularity is True
    for word in words:
        assert word in verdict.message
    assert absent not in verdict.message


def test_reason_changes_with_the_threshold_and_not_with_the_numbers():
    assert verdict_of(0.8, 0.03).reason == verdict_of(0.7, 0.01).reason
    reasons = {verdict_of(z, m).reason for z, m in [(0.8, 0.03), (0.95, 0.05), (0.95, 0.01)]}
    assert len(reasons) == 3


def test_verdict_on_a_bad_message():
    verdict = verdict_on_bad_message(BadJointStateError('elbow', 'must be finite', math.nan))
    assert verdict.level == Level.ERROR
    assert verdict.near_singularity is True
    assert 'elbow' in verdict.message and 'finite' in verdict.message
    assert all(math.isnan(value) for value in verdict.index)


def test_verdict_on_silence():
    verdict = verdict_on_silence(['elbow', 'wrist'], 0.5, waiting=False)
    assert verdict.level == Level.STALE
    assert verdict.near_singularity is True
    for word in ('elbow', 'wrist', '0.5 s'):
        assert word in verdict.message
    assert all(math.isnan(value) for value in verdict.index)
    assert verdict.reason != verdict_on_silence(['elbow'], 0.5, waiting=False).reason
