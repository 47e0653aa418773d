"""The command line optimal_posture: its table, its JSON and how it refuses."""

import json
import math

import pytest

from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.tools.optimal_posture import main


def answer(capsys, *arguments):
    assert main([*arguments, '--json']) == 0
    output = capsys.readouterr()
    assert output.err == ''
    return json.loads(output.out)


def test_json_has_exactly_the_documented_keys_and_the_paper_values(capsys):
    record = answer(capsys, '1.0', '1.0', repr(math.sqrt(3.0) / 3.0))
    assert set(record) == {'joint_names', 'joint_positions', 'link_lengths', 'z',
                           'characteristic_length', 'margin', 'isotropic', 'alternatives'}
    assert record['joint_names'] == ['joint_1', 'joint_2', 'joint_3']
    assert record['joint_positions'] == pytest.approx(
        [0.0, math.radians(120.0), math.radians(150.0)], abs=1e-6)
    assert record['link_lengths'] == [1.0, 1.0, math.sqrt(3.0) / 3.0]
    assert record['z'] == pytest.approx(0.0, abs=1e-12)
    assert record['characteristic_length'] == pytest.approx(math.sqrt(6.0) / 6.0, abs=1e-7)
    assert record['isotropic'] is True
    mirror, = record['alternatives']
    assert set(mirror) == {'joint_positions', 'z'}
    assert mirror['joint_positions'] == pytest.approx(
        [0.0, -math.radians(120.0), -math.radians(150.0)], abs=1e-6)


def test_table_is_for_people(capsys):
    assert main(['1', '1', '1']) == 0
    table = capsys.readouterr().out
    for text in ('0.178425', '0.563398', '81.83', '155.198', '-81.83', 'characteristic length',
                 'proven lower bound'):
        assert text in table
    assert max(map(len, table.splitlines())) < 100


def test_numbers_below_zero_in_any_notation(capsys):
    record = answer(capsys, '1', '1', '1', '--lower', '-1', '-2.5', '-inf',
                    '--upper', '1', '-1e-1', 'inf', '--reference', '-.5', '-1', '-1e0')
    expected = optimal_posture((1.0, 1.0, 1.0), [-1.0, -2.5, -math.inf],
                               [1.0, -0.1, math.inf], [-0.5, -1.0, -1.0])
    assert record['joint_positions'] == list(expected.joint_angles)
    assert record['joint_positions'][0] == -0.5
    assert -2.5 <= record['joint_positions'][1] <= -0.1


@pytest.mark.parametrize('arguments, reason', [
    ([], 'LENGTH'),
    (['1', '1'], 'n >= 3'),
    (['1', '-1', '1'], 'link_lengths[1] = -1.0'),
    (['1', 'nan', '1'], 'link_lengths[1] = nan'),
    (['1', 'one', '1'], "'one'"),
    (['1', '1', '1', '--lower', '0', '0'], 'lower has shape (2,)'),
    (['1', '1', '1', '--lower', '0', '2', '0', '--upper', '1', '1', '1'], 'joint 2'),
    (['1', '1', '1', '--reference', '0', 'inf', '0'], 'reference[1] = inf'),
])
def test_bad_arguments_give_usage_reason_and_status_2(capsys, arguments, reason):
    with pytest.raises(SystemExit) as exit_info:
        main(arguments)
    assert exit_info.value.code == 2
    output = capsys.readouterr()
    assert output.out == ''
    assert output.err.startswith('usage: optimal_posture')
    assert reason in output.err
