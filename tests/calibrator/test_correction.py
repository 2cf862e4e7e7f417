"""The parts of the node that need no ROS: correction, live buffer, training process."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrator import model_file
from calibrator.correction import Correction
from calibrator.live_buffer import LiveBuffer, load_session, save_session
from calibrator.models import make_model
from calibrator.prepare import prepare
from calibrator.ring import Ring
from calibrator.samples import Gathered, concatenate
from calibrator.temperatures import LiveTemperatures
from calibrator.trainer import Trainer
from calibrator.training_job import Job, read, run_job
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session, by_topic

from ..patience import PATIENCE, wait
from .hearing import hear


def stored(method='structured', size=4e-5, **options):
    generator = np.random.default_rng(0)
    command = generator.uniform(0, 0.1, (200, 2))
    direction = generator.choice([-1.0, 1.0], (200, 2))
    measured = command + size * np.sin(40 * command) + 0.5 * direction * 1e-5
    model = make_model(method, **options).fit(command, measured, direction)
    return model_file.StoredModel(model)


def test_correction_is_the_inverse_with_the_direction_of_approach():
    correction = Correction(1e-3)
    np.testing.assert_array_equal(correction.apply(np.array([0.01, 0.02])), [0.01, 0.02])
    with pytest.raises(StageError, match='no model to activate'):
        correction.activate(True)
    correction.stored = stored(degree=9)
    correction.activate(True)
    correction.apply(np.array([0.02, 0.02]))
    command = correction.apply(np.array([0.03, 0.01]))
    reached = command + 4e-5 * np.sin(40 * command) + 0.5 * np.array([1, -1]) * 1e-5
    np.testing.assert_allclose(reached, [0.03, 0.01], atol=1e-7)
    assert not correction.beyond
    correction.apply(np.array([0.2, 0.01]))
    assert '(200.000, 10.000) mm lies beyond the calibrated places' in correction.beyond
    correction.activate(False)
    np.testing.assert_array_equal(correction.apply(np.array([0.01, 0.02])), [0.01, 0.02])


def test_direction_is_that_of_the_move_that_the_stage_will_make():
    """Play of 10 µm: half of it to either side, whatever became of the targets before."""
    model = stored(size=0.0)

    def signs(correction, target, standing=None):
        target = np.array(target)
        command = correction.apply(target, standing=standing)
        return list(np.rint((target - command) / 5e-6)), command

    correction = Correction(1e-3)
    correction.stored = model
    correction.activate(True)
    assert signs(correction, (0.02, 0.02))[0] == [0, 0]
    assert signs(correction, (0.03, 0.03))[0] == [1, 1]
    correction.max_correction = 1e-6
    with pytest.raises(StageError, match='beyond max_correction'):
        correction.apply(np.array([0.09, 0.01]))
    correction.max_correction = 1e-3
    # The stage never went to the refused target: it comes from 30 mm.
    found, command = signs(correction, (0.04, 0.03))
    assert found == [1, 1]
    # It stands where it was sent: the same target again is no move.
    arrived = command, np.ones(2)
    assert signs(correction, (0.04, 0.03), arrived)[0] == [1, 1]
    # Others moved it home and then along y to 60 mm; the target is beyond x and where y stands.
    home = np.array([0.0, 0.06]), np.array([-1.0, 1.0])
    assert signs(correction, (0.02, 0.02), home)[0] == [1, -1]
    # The node heard the stage before its first target.
    fresh = Correction(1e-3)
    fresh.stored = model
    fresh.activate(True)
    assert signs(fresh, (0.02, 0.02), home)[0] == [1, -1]


def test_live_buffer_tells_where_the_stage_stands_and_where_it_came_from():
    buffer = LiveBuffer(3)
    assert buffer.standing(('x',)) is None
    for k, x in enumerate((0.0, 0.1, 0.1, float('nan'), 0.05, 0.05, 0.05)):
        buffer.add_reference(k, ('x', 'y'), (x, 0.02))
    buffer.add_point(6, (0.0, 0.0, 0.0))
    position, direction = buffer.standing(('y', 'x'))
    assert list(position) == [0.02, 0.05] and list(direction) == [0.0, 1.0]
    assert buffer.standing(('z',)) is None
    # The ring holds the standstill alone, and the direction of the move before it.
    held = buffer.session().series[topics.REFERENCE].columns('direction', ('x', 'y'))
    assert held.tolist() == [[1.0, 0.0]] * 3


def test_correction_refuses_what_is_too_large_or_no_number():
    correction = Correction(2e-5)
    correction.stored = stored()
    correction.activate(True)
    with pytest.raises(StageError, match='beyond max_correction 20.0 µm'):
        correction.apply(np.array([0.04, 0.04]))
    with pytest.raises(StageError, match='not finite'):
        correction.apply(np.array([np.nan, 0.0]))
    with pytest.raises(StageError, match='trained for 2 axes'):
        correction.apply(np.array([0.01]))


def test_correction_by_temperature_needs_every_sensor_it_was_trained_with():
    generator = np.random.default_rng(0)
    command = generator.uniform(0.0, 0.1, (200, 2))
    heat = generator.uniform(18.0, 24.0, (200, 2))
    measured = command * (1.0 + 1e-5 * (heat - 20.0))
    model = make_model('thermal').fit(command, measured, None, heat)
    correction = Correction(1e-3)
    correction.stored = model_file.StoredModel(model, sensors=('screw_x', 'screw_y'))
    heard = LiveTemperatures()
    heard.hear('screw_x', 22.0, 0, 0)
    heard.hear('screw_y', 19.0, 0, 0)
    goal = np.array([0.05, 0.05])
    # Without the correction nothing needs a temperature.
    np.testing.assert_array_equal(correction.apply(goal), goal)
    correction.activate(True)
    command = correction.apply(goal, heard.fresh(50 * 10**9, 60.0))
    np.testing.assert_allclose(command * (1.0 + 1e-5 * np.array([2.0, -1.0])), goal, atol=1e-9)
    heard.hear('screw_x', 21.0, 40 * 10**9, 40 * 10**9)
    heard.hear('screw_y', np.nan, 40 * 10**9, 40 * 10**9)
    late = heard.fresh(70 * 10**9, 60.0)
    assert late == {'screw_x': 21.0}
    with pytest.raises(StageError, match='sensor screw_y is silent'):
        correction.apply(goal, late)
    # A simulated clock that starts anew: screw_x was not heard in its time.
    assert 'screw_x' not in heard.fresh(10**9, 60.0)
    heard.hear('screw_y', 20.0, 71 * 10**9, 71 * 10**9)
    correction.apply(goal, heard.fresh(72 * 10**9, 60.0))


def test_ring_keeps_the_newest_in_order():
    ring = Ring(4, 1)
    for stamp in (5, 1, 7, 9, 8, 10):
        ring.add(stamp, (float(stamp),))
    stamps, rows = ring.content()
    assert list(stamps) == [7, 8, 9, 10] and list(rows[:, 0]) == [7.0, 8.0, 9.0, 10.0]


def test_live_buffer_gives_the_same_samples_as_the_session(grid_session, tmp_path):
    session = grid_session(20)
    buffer = LiveBuffer(100_000)
    with pytest.raises(StageError, match='live buffer holds no pair'):
        buffer.session()
    for _ in hear(buffer, session):
        pass
    buffer.temperatures.hear('air', 21.0, session.start_ns, 0)
    save_session(buffer.session(), tmp_path / 'live.npz')
    loaded = load_session(tmp_path / 'live.npz')
    expected = prepare(session)
    np.testing.assert_array_equal(prepare(loaded).measured, expected.measured)
    assert prepare(loaded).sensors == ('air',)


def job(tmp_path, session, **changes):
    save_session(session, tmp_path / 'live.npz')
    settings = {'out': str(tmp_path / 'models' / 'm.json'), 'live': str(tmp_path / 'live.npz')}
    return Job(**{**settings, 'version': 3, 'machine': 'm1', **changes})


def test_a_model_that_is_worse_than_none_is_refused(grid_session, tmp_path):
    # Ten random positions cannot carry a polynomial in two axes beyond themselves.
    session = grid_session(16, noise=3e-5)
    wanted = job(tmp_path, session, method='polynomial', options={'degree': 3})
    with pytest.raises(StageError, match='not proven to be better than none.* gain -'):
        run_job(wanted)
    result, forced = run_job(replace(wanted, force=True))
    assert result.gain.low <= 0.0
    path = tmp_path / 'forced.json'
    model_file.save(forced, path)
    correction = Correction(1e-3)
    correction.stored = model_file.load(path)
    with pytest.raises(StageError, match='must not correct.*held-out RMS'):
        correction.activate(True)
    assert not correction.active


@pytest.mark.parametrize(
    ('linear', 'said'),
    [
        ([[1e3, 0.0], [0.0, 1e3]], 'the tracker moves 1000 times as far as the reference'),
        ([[0.0, 1.0], [1.0, 0.0]], 'x and y look exchanged.*align'),
        ([[0.8, -0.6], [0.6, 0.8]], 'the frame is turned.*align'),
    ],
)
def test_a_tracker_in_another_unit_or_frame_is_named(grid_session, tmp_path, linear, said):
    session = grid_session(30)
    points = session.series[topics.TRACKER_POINT]
    x, y = np.array(linear) @ [points.values['x'], points.values['y']]
    points.values.update(x=x, y=y)
    with pytest.raises(StageError, match=f'beyond max_correction.*{said}'):
        run_job(job(tmp_path, session))


def test_the_remedy_of_a_refused_model_fits_what_was_left_out(grid_session, tmp_path):
    wanted = job(tmp_path, grid_session(40), method='affine')
    samples = read(wanted).samples
    noise = np.random.default_rng(0).normal(0.0, 3e-7, samples.command.shape)

    def said(samples):
        with pytest.raises(StageError, match='not proven') as refused:
            run_job(wanted, Gathered(samples))
        return str(refused.value)

    still = replace(samples, measured=samples.command + noise)
    assert 'there is nothing to correct' in said(still)
    # The zero moves by 20 µm between two visits of the same places.
    twice = [np.arange(40)] * 2
    moved = np.repeat([1e-5, -1e-5], 40)[:, None] + np.vstack([noise, noise])
    again = still.take(np.concatenate(twice))
    again = replace(again, measured=again.command + moved, times=np.arange(80.0))
    assert 'drifted: let them settle' in said(again)
    other = replace(samples, measured=2.0 * samples.command - samples.measured)
    assert 'the sessions disagree' in said(concatenate([samples, other]))


@pytest.mark.parametrize(
    ('source', 'target', 'words'),
    [
        ('reference', 'encoder', 'learned a moving stage'),
        ('encoder', 'reference', 'predicts the reference'),
    ],
)
def test_a_model_of_the_servo_is_written_and_corrects_nothing(tmp_path, source, target, words):
    times = np.arange(0.0, 20.0, 0.01)

    def circle(at):
        return 0.03 * np.column_stack([np.cos(0.5 * at), np.sin(0.5 * at)])

    stamps = 10**18 + (1e9 * times).astype(np.int64)
    series = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=circle(times)),
        Series.per_axis(topics.JOINT_STATES, stamps, position=circle(times - 0.024)),
    )
    job_of = Job(out='', method='affine', source=source, target=target)
    lag = prepare(Session('servo', series), source, target)
    result, model = run_job(job_of, Gathered(lag))
    assert result.gain.proven and result.before.rms > 1e-4
    model_file.save(model, tmp_path / 'servo.json')
    correction = Correction(1e-3)
    correction.stored = model_file.load(tmp_path / 'servo.json')
    with pytest.raises(StageError, match=f'must not correct: .*{words}'):
        correction.activate(True)


def test_a_contour_is_no_calibration(grid_session, tmp_path):
    with pytest.raises(StageError, match='no calibration.*record a grid of rests'):
        run_job(job(tmp_path, grid_session(40, rest=0.0)))


def test_rests_at_few_places_are_refused(grid_session, tmp_path):
    with pytest.raises(StageError, match='distinct places'):
        run_job(job(tmp_path, grid_session(40, places=3)))


def test_training_process_writes_the_model_or_says_why_not(grid_session, tmp_path):
    trainer = Trainer()
    wanted = job(tmp_path, grid_session(40))
    message = trainer.start(wanted, tmp_path / 'job.json').result(PATIENCE)
    assert message.startswith('structured: held-out RMS')
    loaded = model_file.load(wanted.out, 'm1')
    assert loaded.version == 3
    direct = run_job(wanted)[1]
    points = np.random.default_rng(0).uniform(0, 0.05, (5, 2))
    np.testing.assert_array_equal(loaded.model.predict(points), direct.model.predict(points))
    with pytest.raises(StageError, match='fits 36 parameters|fits 28 parameters'):
        trainer.start(
            job(tmp_path, grid_session(20), method='polynomial', options={'degree': 6}),
            tmp_path / 'job.json',
        ).result(PATIENCE)
    assert not trainer.running


def test_training_reports_progress_and_is_aborted(grid_session, tmp_path):
    trainer = Trainer()
    assert not trainer.abort()
    long = job(
        tmp_path,
        grid_session(40),
        method='it2fls',
        options={'particles': 50, 'iterations': 1_000_000},
    )
    future = trainer.start(long, tmp_path / 'job.json')
    with pytest.raises(StageError, match='under way'):
        trainer.start(long, tmp_path / 'job2.json')
    wait(lambda: trainer.progress is not None)
    assert trainer.abort()
    with pytest.raises(StageError, match='aborted'):
        future.result(PATIENCE)
    assert not trainer.running and not json.loads((tmp_path / 'job.json').read_text())['bags']


def test_training_ends_when_its_parent_is_killed(grid_session, tmp_path):
    job(
        tmp_path,
        grid_session(40),
        method='it2fls',
        options={'particles': 50, 'iterations': 1_000_000},
    ).save(tmp_path / 'wanted.json')
    parent = subprocess.Popen(
        [
            sys.executable,
            '-c',
            'import sys, time; from pathlib import Path\n'
            'from calibrator.trainer import Trainer; from calibrator.training_job import Job\n'
            'folder = Path(sys.argv[1]); trainer = Trainer()\n'
            'done = trainer.start(Job.load(folder / "wanted.json"), folder / "job.json")\n'
            'while trainer.progress is None: time.sleep(0.05)\n'
            'print(trainer._process.pid, flush=True)\n'
            'done.result()',
            str(tmp_path),
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert parent.stdout is not None
    training = Path('/proc') / parent.stdout.readline().strip()
    assert _runs(training)
    parent.kill()
    parent.communicate()
    wait(lambda: not _runs(training))


def _runs(process):
    """Whether a process of /proc runs: a zombie, which nobody may ever fetch, does not."""
    try:
        return (process / 'stat').read_text().rsplit(')', 1)[1].split()[0] not in 'ZX'
    except (FileNotFoundError, ProcessLookupError):
        return False
