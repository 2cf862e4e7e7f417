from __future__ import annotations

import numpy as np
import yaml
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from benchmarks.generators import handmade, worth
from benchmarks.generators.cases import also_right, draw_cases, write_case
from benchmarks.generators.machine import draw_machine
from benchmarks.generators.record import Planted
from benchmarks.generators.references import draw_reference
from benchmarks.generators.score import judged, read_truth, summary


def test_paths_start_at_rest_and_keep_the_stages_bounds():
    for seed in range(12):
        rng = np.random.default_rng(seed)
        machine = draw_machine(rng)
        path = draw_reference(rng, machine, 20.0)
        assert len(path.position) == round(20.0 / machine.control_period)
        assert np.abs(path.velocity[:20]).max() < 1e-9
        assert np.all(np.abs(path.velocity).max(axis=0) < 1.15 * np.array(machine.speed))
        moved = np.diff(path.position, axis=0) / machine.control_period
        middle = 0.5 * (path.velocity[1:] + path.velocity[:-1])
        assert np.abs(moved - middle).max() < 2e-3


def test_a_case_is_the_same_for_its_seed_and_rosbags_reads_it(tmp_path):
    first, again = (next(draw_cases(handmade, 5, 1, 'backlash')) for _ in range(2))
    assert first.name == again.name
    np.testing.assert_array_equal(first.record.tracker, again.record.tracker)
    write_case(first, tmp_path / 'case')
    record, stamps, efforts = first.record, [], []
    with AnyReader(
        [tmp_path / 'case' / 'bag'], default_typestore=get_typestore(Stores.ROS2_JAZZY)
    ) as reader:
        topics = {c.topic: c.msgcount for c in reader.connections}
        for connection, _, raw in reader.messages():
            if connection.topic == '/stage/command':
                message = reader.deserialize(raw, connection.msgtype)
                stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
                efforts.append(message.effort[0])
    assert set(topics) == {
        '/stage/reference', '/stage/command', '/stage/joint_states', '/tracker/point',
        '/stage/temperature',
    }  # fmt: skip
    assert topics['/tracker/point'] == len(record.tracker)
    np.testing.assert_allclose(np.array(stamps) - stamps[0], 1e9 * record.stamps, atol=1.0)
    np.testing.assert_array_equal(efforts, record.effort[:, 0])
    twin = yaml.safe_load((tmp_path / 'case' / 'twin.yaml').read_text())
    assert twin['axes']['x']['mass'] == first.machine.axes[0].mass


def test_two_levels_beside_a_constant_force_are_one_level():
    friction = Planted('asymmetric_friction', 'x')
    for axis, right in (('x', [['coulomb_friction.x', 'position_force.x']]), ('y', [])):
        assert also_right([friction, Planted('position_force', axis)], 'pair') == right


def test_the_scorer_knows_right_also_right_and_false_names():
    truth = {
        'kind': 'single', 'truth': ['backlash.x'], 'also_right': [['backlash.x', 'scale_error.x']],
        'planted': [{'name': 'backlash.x', 'parameters': {'width': 1e-5}}],
    }  # fmt: skip
    width = {'width': {'value': 1.3e-5, 'std': 1e-6, 'unit': 'm'}}

    def report(*verdict: str) -> dict[str, object]:
        causes = [
            {'effect': name, 'probability': 0.95, 'status': 'accepted', 'parameters': width}
            for name in verdict
        ]
        return {'verdict': list(verdict), 'causes': causes}

    right = judged('a', truth, report('backlash.x'))
    assert right['exact'] and right['top'] and not right['false']
    assert right['intervals'][0][2] > 1.96
    assert judged('b', truth, report('backlash.x', 'scale_error.x'))['exact']
    wrong = judged('c', truth, report('cable_force.x', 'backlash.x'))
    assert not wrong['exact'] and not wrong['top'] and wrong['false'] == ['cable_force.x']
    refused = judged('d', truth, None, 'exit 2')
    assert any('0.50' in line for line in summary([right, wrong]))
    assert 'no report: 1' in summary([refused])


def test_the_scorer_reads_the_truths_of_other_simulators():
    names = ['cyclic_pitch_error.x', 'straightness.y']
    cyclic = {'amplitude': 5e-6, 'period': 0.0, 'phase': 6.1}
    effects = [(names[0], cyclic), (names[1], {'quadratic': 1e-5})]
    planted = [{'name': name, 'params': params} for name, params in effects]
    truth = read_truth({'names': names, 'effects': planted, 'instead': [names[:1]]})
    found = {'amplitude': 5e-6, 'period': 0.005, 'phase': 6.1 - 2.0 * np.pi, 'quadratic': 3e-5}
    values = {key: {'value': value, 'std': 1e-7} for key, value in found.items()}
    said = {'probability': 0.9, 'status': 'accepted', 'parameters': values}
    row = judged('a', truth, {'verdict': names, 'causes': [{'effect': n} | said for n in names]})
    assert row['exact']
    # A phase but for whole turns; the lead is no period, and a coefficient of a curve is left out.
    assert [(key, abs(sigmas) < 1.0) for _, key, sigmas, _ in row['intervals']] == [
        ('amplitude', True),
        ('phase', True),
    ]


def test_the_scorer_counts_what_statements_were_worth():
    def cause(effect: str, probability: float, *alternatives: str) -> dict[str, object]:
        said = {'effect': effect, 'probability': probability, 'status': 'accepted'}
        return said | {'alternatives': list(alternatives)}

    def said(known: set[str], *causes: dict[str, object], gap: float = 3e-6) -> list[object]:
        names = [str(c['effect']) for c in causes]
        report = {'gap': {'before': gap, 'noise_floor': 1e-6}, 'causes': list(causes)}
        return list(worth.statements(report | {'verdict': names}, known))

    sure, lag = cause('sample_jitter.x', 0.95), cause('actuation_delay.x', 0.9, 'drive_gain.x')
    assert said({'sample_jitter'}, sure, lag) == [(worth.SURE_NAME, True), (worth.OTHERS, False)]
    assert said({'unknown'}, lag, cause('unknown', 0.5)) == [
        (worth.BESIDE, False),
        (worth.UNKNOWN, True),
    ]
    assert said(set(), cause('backlash.x', 0.8)) == []
    assert said({'backlash.x'}) == [(worth.NOTHING, False)] and said(set(), gap=1e-6) == []
    line = next(own for own in worth.lines([(worth.BESIDE, True)]) if worth.BESIDE in own)
    assert line.split()[-3:] == ['1', '1', '1.000']


def test_a_path_that_never_turns_back_is_bent():
    machine = draw_machine(np.random.default_rng(1))
    found = 0
    for seed in range(60):
        path = draw_reference(np.random.default_rng(seed), machine, 20.0)
        span = np.ptp(path.position, axis=0)
        if path.kinds == ('one_way',) and span.min() > 1e-3:
            found += 1
            assert np.diff(path.position, axis=0).min() > -1e-11
            x, y = ((path.position - path.position[0]) / span).T
            assert np.abs(x - y).max() > 0.1
    assert found > 2
