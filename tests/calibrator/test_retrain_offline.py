"""The command that trains from bags alone."""

from dataclasses import replace

import numpy as np

from calibrator import model_file
from calibrator.retrain_offline import main
from session_bags.writer import write_session
from stage_core import topics
from stage_core.session import Series


def test_offline_command_trains_from_a_bag_and_writes_the_model(tmp_path, capsys, grid_session):
    bag = tmp_path / 'bag'
    write_session(bag, grid_session(60))
    out = tmp_path / 'model.json'
    arguments = ['--bag', str(bag), '--out', str(out), '--machine', 'm1', '--seed', '2']
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert '60 rests of 1 bag(s)' in printed and 'servo lag included' in printed
    loaded = model_file.load(out, 'm1')
    assert loaded.seed == 2 and loaded.training == {'bag': model_file.bag_hash(bag)}
    assert loaded.metrics['after']['rms'] < 0.1 * loaded.metrics['before']['rms']
    assert main(['--bag', str(tmp_path / 'absent')]) == 2
    assert 'there is no bag' in capsys.readouterr().err
    assert main([*arguments, '--options', '[1]']) == 2
    assert main(['--bag', str(bag), '--out', str(tmp_path / 'typo' / 'm.json')]) == 2
    assert 'there is no folder' in capsys.readouterr().err and not (tmp_path / 'typo').exists()


def test_offline_command_judges_held_out_bags_beside_the_phase_table(
    tmp_path, capsys, grid_session
):
    bags = []
    for seed in (1, 2):
        bags.append(str(write_session(tmp_path / f'bag{seed}', grid_session(60, seed=seed))))
    assert main(['--bag', bags[0], '--holdout', bags[1], '--phase-table']) == 0
    printed = capsys.readouterr().out
    assert 'judged by 2 sessions' in printed
    rows = [line for line in printed.splitlines() if line.startswith('bag2')]
    for row, axis in zip(rows, 'xy', strict=True):
        name, found_axis, before, table, after = row.split()
        assert (name, found_axis) == ('bag2', axis)
        assert float(after) < 0.2 * float(before) and float(after) < float(table)


def test_offline_command_refuses_a_held_out_bag_of_other_axes(tmp_path, capsys, grid_session):
    session = grid_session(10, seed=2)
    both = session.series[topics.REFERENCE]
    alone = Series(topics.REFERENCE, both.stamps, {'position.x': both.values['position.x']})
    other = replace(session, series={**session.series, topics.REFERENCE: alone})
    held = write_session(tmp_path / 'held', other)
    bag = write_session(tmp_path / 'bag', grid_session(10))
    assert main(['--bag', str(bag), '--holdout', str(held)]) == 2
    assert 'held has the axes x, the training xy: hold out' in capsys.readouterr().err


def test_offline_command_refuses_a_model_that_makes_another_session_worse(
    tmp_path, capsys, grid_session
):
    def mirrored(session):
        """The session of a stage with the opposite error."""
        points = session.series[topics.TRACKER_POINT]
        stands = session.series[topics.REFERENCE].columns('position', ('x', 'y'))[::5]
        turned = {a: 2.0 * stands[:, i] - points.values[a] for i, a in enumerate('xy')}
        found = Series(topics.TRACKER_POINT, points.stamps, {**points.values, **turned})
        return replace(session, series={**session.series, topics.TRACKER_POINT: found})

    bag = str(write_session(tmp_path / 'bag', grid_session(60, seed=1)))
    other = str(write_session(tmp_path / 'other', mirrored(grid_session(60, seed=2))))
    model = tmp_path / 'model.json'
    arguments = ['--bag', bag, '--holdout', other, '--out', str(model)]
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert 'other x' in said.out and 'where whole sessions are left out' in said.err
    assert not model.exists()
    assert main([*arguments, '--force']) == 0
    forced = model_file.load(model)
    assert 'where whole sessions are left out' in forced.refusal
    # The interval holds what the other session errs by: twice the error of the stage.
    before = forced.metrics['before']['rms']
    assert 1.96 * np.sqrt(np.mean(forced.model.spread**2)) > before
