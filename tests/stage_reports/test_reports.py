"""The page, the pictures, finding the tests in a session, the command, the layouts."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.quiver import QuiverKey

from calibrator.model_file import StoredModel
from calibrator.models import make_model
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session, by_topic
from stage_reports import circular, positioning
from stage_reports.command import main, session_page
from stage_reports.contour_page import _more_runs
from stage_reports.extract import circular_paths, positioning_runs
from stage_reports.intervals import distance_rms, path_interval, rms_interval
from stage_reports.tracking import places, runs, tracking_errors
from stage_reports.trials_page import trials_page
from stage_reports.uncertainty import positioning_uncertainty

from .reading import words
from .sessions import START, circle_session, rest_session, staircase


def test_rests_and_positioning_runs_are_found() -> None:
    targets = [0.02, 0.05, 0.08, 0.11, 0.14]
    reference = staircase(targets)
    time = 0.01 * np.arange(reference.size)
    direction = np.sign(np.diff(reference, prepend=reference[0] - 1.0))
    last = np.zeros_like(direction)
    sign = 1.0
    for k, value in enumerate(direction):
        sign = value or sign
        last[k] = sign
    measured = reference + 1e-4 * reference + 1e-6 * last
    runs = positioning_runs(time, reference, measured)
    assert runs is not None
    np.testing.assert_allclose(runs.targets, targets)
    assert runs.up.shape == runs.down.shape == (5, 3)
    result = positioning(runs.targets, runs.up, runs.down)
    assert pytest.approx(2e-6, rel=1e-6) == result.B
    assert pytest.approx(1e-4 * 0.12, rel=1e-6) == result.M
    assert result.R_up == pytest.approx(0.0, abs=1e-15)
    assert positioning_runs(time, np.sin(time), np.sin(time)) is None


def test_circles_are_found_and_other_paths_are_not() -> None:
    session = circle_session()
    (tracking,) = tracking_errors(session)
    paths = circular_paths(tracking.reference, tracking.measured)
    assert paths is not None
    assert paths.radius == pytest.approx(0.01, rel=1e-6)
    assert paths.counter_clockwise is not None
    assert paths.clockwise is not None
    result = circular(paths.counter_clockwise, paths.clockwise, paths.radius, paths.centre)
    assert pytest.approx(4e-6, rel=0.01) == result.H
    half = tracking.reference[:500]
    assert circular_paths(half, half) is None
    line = np.column_stack([np.linspace(0, 1, 50), np.linspace(0, 1, 50)])
    assert circular_paths(line, line) is None
    assert circular_paths(line * 0.0, line) is None


def test_a_calibration_page_counts_rests_and_not_the_way_between_them() -> None:
    session = rest_session()
    rests = places(session)
    assert rests is not None
    # The first rest counts too: both axes have moved before it.
    assert len(rests.errors) == 12
    np.testing.assert_allclose(rests.errors.mean(axis=0), [3e-6, 0.0], atol=1e-7)
    page = session_page(session)
    assert page.brief.startswith('3.0')
    assert '12 rests' in words(page.render())
    (moving,) = tracking_errors(session)
    assert distance_rms(moving.errors) > 100.0 * distance_rms(rests.errors)
    model = StoredModel(make_model('identity').fit(rests.wanted, rests.wanted + rests.errors))
    told = words(session_page(session, model).render())
    assert model.domain_line() in told and 'beyond it the model holds its edge' in told


def test_a_contour_page_leaves_out_approach_and_pauses() -> None:
    whole = circle_session(2e-6)
    contour = whole.series[topics.CONTOUR_ERROR]
    # The first 300 ticks are the approach, with a large error; 200 ticks of pause in the middle.
    kept = np.r_[300:1100, 1300:2400]
    z = np.where(np.arange(len(contour)) < 1200, 4e-6, 1e-6)
    inside = Series(
        topics.CONTOUR_ERROR, contour.stamps[kept], dict.fromkeys(('x', 'y', 'z'), z[kept])
    )
    session = Session('contour', {**whole.series, topics.CONTOUR_ERROR: inside})
    found = runs(session)
    assert [run.number for run in found] == [1, 2]
    assert [len(run.contour) for run in found] == [800, 1100]
    assert [run.errors.shape for run in found] == [(800, 2), (1100, 2)]
    page = session_page(session)
    assert page.brief.startswith('1.000 µm (95 %: 1.000 to 1.000 µm)')
    told = words(page.render())
    assert 'In the first run it was 4.0 µm' in told
    assert 'The last run lowered the RMS by 75 %' in told
    assert 'The largest error is 1.0' in told


def test_a_contour_page_says_whether_more_runs_help() -> None:
    assert 'may lower it further' in _more_runs([4e-6, 2e-6])[0]
    assert 'more runs hardly help' in _more_runs([2e-6, 1.98e-6])[0]
    assert 'Run 2 was the best' in _more_runs([4e-6, 1e-6, 3e-6])[0]


def two_ways() -> dict[str, Series]:
    """A run of a circle, a pause, a run the other way; the table is 3 µm off in x."""
    series = {
        name: replace(s, stamps=START + 4 * (s.stamps - START))
        for name, s in circle_session(2e-6).series.items()
    }
    kept = np.r_[0:1185, 1215:2400]
    contour = series[topics.CONTOUR_ERROR]
    values = {name: column[kept] for name, column in contour.values.items()}
    series[topics.CONTOUR_ERROR] = replace(contour, stamps=contour.stamps[kept], values=values)
    encoder = series[topics.JOINT_STATES]
    points = encoder.columns('position', ('x', 'y')) + [3e-6, 0.0]
    series[topics.TRACKER_POINT] = Series.points(topics.TRACKER_POINT, encoder.stamps, points)
    return series


def test_both_ways_round_are_one_circular_test() -> None:
    told = words(session_page(Session('circle', two_ways())).render())
    assert 'in run 1 of 1' in told and '1 the other way round' in told
    assert 'first run of each direction' in told
    # 2 µm too large one way, too small the other.
    for figure in ('G(b) the same of both directions together', 'H largest difference of the two'):
        assert re.search(re.escape(figure) + r'\D*4\.0 ', told), figure


def test_the_nominal_circle_is_where_the_table_was_to_be() -> None:
    grid = np.random.default_rng(0).uniform(-0.01, 0.01, (50, 2))
    model = StoredModel(make_model('affine').fit(grid, grid + [3e-6, 0.0]))
    told = [words(session_page(Session('circle', two_ways()), m).render()) for m in (None, model)]
    # The correction was meant to move the table by 3 µm: what is left is the radius.
    largest = [re.findall(r'largest radial deviation ([\d.]+)', text)[0] for text in told]
    assert [float(value) for value in largest] == pytest.approx([5.0, 2.0], abs=0.02)


def test_the_interval_of_an_rms_covers_it() -> None:
    rng = np.random.default_rng(3)
    truth = np.hypot(0.8, 0.4)
    drawn = (rng.standard_normal((10, 2)) * [0.8, 0.4] for _ in range(2000))
    inside = [low <= truth <= high for low, high in map(rms_interval, drawn)]
    # 2000 draws of a share of 0.95 scatter by 0.005; the approximation costs another 0.01.
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    with pytest.raises(StageError, match='two positions'):
        rms_interval([[1.0, 1.0]])


def test_the_interval_of_a_path_covers_the_rms_of_correlated_errors() -> None:
    rng = np.random.default_rng(4)
    # 200 independent errors, each held for 20 ticks; then spikes in a quiet path.
    held = (np.repeat(rng.standard_normal(200), 20) for _ in range(300))
    inside = [low <= 1.0 <= high for low, high in map(path_interval, held)]
    assert np.mean(inside) == pytest.approx(0.92, abs=0.04)
    spikes = np.zeros(4000)
    spikes[[100, 2100]] = 10.0
    low, high = path_interval(spikes)
    assert low == 0.0 and high > 1.5 * np.sqrt(np.mean(spikes**2))


def test_the_uncertainty_of_a_positioning_test_is_that_of_its_means() -> None:
    reference = staircase([0.02, 0.05, 0.08, 0.11, 0.14], cycles=5)
    time = 0.01 * np.arange(reference.size)
    noise = 1e-6 * np.random.default_rng(0).standard_normal(reference.size)
    runs_found = positioning_runs(time, reference, reference + noise)
    assert runs_found is not None
    # 25 readings make the mean of a rest.
    assert runs_found.noise == pytest.approx(1e-6 / 5.0, rel=0.15)
    uncertain = positioning_uncertainty(runs_found)
    # The mean reversal of five targets: ten means of five rests.
    expected = 2.0 * runs_found.noise * np.sqrt(2.0 / 25.0)
    assert uncertain['B_mean'] == pytest.approx(expected, rel=0.15)


def test_a_positioning_test_gets_a_page_of_its_own() -> None:
    reference = staircase([0.02, 0.05, 0.08, 0.11, 0.14], cycles=5)
    stamps = START + np.arange(reference.size, dtype=np.int64) * 10_000_000
    noise = 1e-6 * np.random.default_rng(0).standard_normal(reference.size)
    points = (1.001 * reference + noise)[:, None]
    series = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=reference[:, None]),
        Series.points(topics.TRACKER_POINT, stamps, points),
    )
    page = session_page(Session('test', series))
    # A scale of 1 mm/m over 0.12 m, and 2 s of 0.2 µm of noise at either end.
    accuracy = float(page.brief.split()[2])
    assert 120.0 < accuracy < 122.0
    assert '5 with 5 approaches' in words(page.render())


def test_friction_and_play_are_the_branches_of_a_contour() -> None:
    whole = circle_session()
    stamps = whole.series[topics.REFERENCE].stamps
    path = whole.series[topics.REFERENCE].columns('position', ('x', 'y'))
    way = np.sign(np.gradient(path[:, :1], axis=0))
    series = by_topic(
        Series.per_axis(topics.JOINT_STATES, stamps, position=path),
        Series.points(topics.TRACKER_POINT, stamps, path - [4e-6, 0.0] * way),
        Series.per_axis(topics.COMMAND, stamps, effort=[6.0, 0.0] * way),
    )
    page = session_page(Session('contour', {**whole.series, **series}))
    (figure,) = (f for title, f in page.figures if title.startswith('What each axis does'))
    for panel, forwards in zip(figure.axes, (-4.0, 0.0, 6.0, 0.0), strict=True):
        medians = [np.median(line.get_ydata()) for line in panel.lines]
        np.testing.assert_allclose(medians, [forwards, -forwards], atol=1e-6)


def test_trials_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sessions = [circle_session(error) for error in (4e-6, 2e-6, 1e-6)]
    page = trials_page(sessions)
    lines = page.figures[0][1].axes[0].lines
    np.testing.assert_allclose(lines[0].get_ydata(), [4.0, 2.0, 1.0], rtol=1e-3)
    assert [line.get_label() for line in lines] == ['contour']
    assert 'In the first it was 4.0 µm' in words(page.render())
    # The lag between the rests, 1 mm, is no error of theirs.
    assert trials_page([rest_session(), rest_session()]).brief.startswith('3.0 µm')
    bags = [write_session(tmp_path / f'trial_{k}', s) for k, s in enumerate(sessions[:2])]
    arguments = [part for bag in bags for part in ('--bag', str(bag))]
    assert main([*arguments, '--out', str(tmp_path / 'out')]) == 0
    assert 'pictures' in capsys.readouterr().out
    with pytest.raises(StageError, match='share no error'):
        trials_page([Session('empty', {})])


def test_one_axis_and_motor_steps() -> None:
    session = circle_session()
    reference = session.series[topics.REFERENCE]
    stamps, x = reference.stamps, reference.columns('position', ('x',))
    one = Series.per_axis(topics.REFERENCE, stamps, position=x)
    steps = Series.per_axis(topics.JOINT_STATES, stamps, position=1e6 * x)
    stepper = Session('steps', by_topic(one, steps))
    assert tracking_errors(stepper) == []
    assert 'no error can be stated' in session_page(stepper).render()
    tracker = Series.points(topics.TRACKER_POINT, stamps, x + 3e-6)
    measured = Session('one', by_topic(one, tracker))
    (tracking,) = tracking_errors(measured)
    np.testing.assert_allclose(tracking.errors, -3e-6, atol=1e-15)
    assert 'Tracking error, tracker' in session_page(measured).render()


@pytest.mark.parametrize(
    ('error', 'unit', 'drawn'), [(3e-6, 'µm', 3.0), (2e-3, 'mm', 2.0), (20.0, 'm', 20.0)]
)
def test_a_motion_page_shows_deviations_in_the_unit_of_their_size(
    error: float, unit: str, drawn: float
) -> None:
    """The tracker is off by `error` in y; the encoder is 1 µm off in both axes."""
    whole = circle_session()
    reference = whole.series[topics.REFERENCE]
    path = reference.columns('position', ('x', 'y'))
    series = by_topic(
        reference,
        Series.per_axis(topics.JOINT_STATES, reference.stamps, position=path + 1e-6),
        Series.points(topics.TRACKER_POINT, reference.stamps, path + [0.0, error]),
    )
    page = session_page(Session('motion', series))
    (figure,) = (f for title, f in page.figures if title.startswith('Measured minus reference'))
    labels = [panel.get_ylabel() for panel in figure.axes]
    assert labels == ['x − reference (µm)', f'y − reference ({unit})']
    for panel, expected in zip(figure.axes, ([1.0, 0.0], [None, drawn]), strict=True):
        for line, value in zip(panel.lines, expected, strict=True):
            if value is not None:
                np.testing.assert_allclose(line.get_ydata(), value, atol=1e-6)
    told = words(page.render())
    assert f'RMS ({unit})' in told and not re.search(r'\d{6}\.', told)
    (arrows,) = (f for title, f in page.figures if title.startswith('Where the tracker'))
    (key,) = (a for a in arrows.axes[0].artists if isinstance(a, QuiverKey))
    assert key.text.get_text() == f'{2 if error != 20.0 else 20:g} {unit}'


def test_a_missing_bag_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['--bag', str(tmp_path / 'none'), '--out', str(tmp_path)]) == 2
    assert capsys.readouterr().err.count('\n') == 1
