"""The blind suite's runner, its scorer and the page of results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import baselines, run, suites
from benchmarks.blind.cases import draw_single
from benchmarks.blind.results import markdown
from benchmarks.blind.score import interval, suite_scores
from benchmarks.blind.session import run_machine, visible


def test_report_seeds_are_apart_from_development_seeds_and_from_one_another() -> None:
    seeds = [
        suites.case(suite, number, which).seed
        for which in ('development', 'report')
        for suite in suites.SIZES
        for number in (0, suites.SIZES[suite] - 1)
    ]
    assert len(set(seeds)) == len(seeds)
    assert suites.SIZES['main'] >= 200


def test_every_effect_is_left_out_once_with_what_is_the_same() -> None:
    cases = [
        suites.case('leave_one_out', n, 'development')
        for n in range(suites.SIZES['leave_one_out'])
    ]
    assert len({c.without[0] for c in cases}) == len(cases)
    for one in cases:
        assert one.planted[0].partition('.')[0] == one.without[0]
        assert one.expected == ('unknown',)


def test_a_case_says_what_its_session_can_show() -> None:
    warm = draw_single(0, 5, 'thermal_expansion')
    assert warm.expected == warm.planted
    assert replace(warm, temperature=False).expected == ('unknown',)
    play = replace(draw_single(0, 5, 'backlash'), duration=8.0)
    assert visible(play).expected == play.planted
    # Without a tracker nothing shows where the table is.
    assert visible(replace(play, tracker=False)).expected == ()


def test_the_baselines_answer_without_the_diagnosis() -> None:
    one = replace(draw_single(0, 5, 'scale_error'), duration=12.0)
    found = baselines.answers(one, run_machine(one))
    assert found['largest amplitude'] == [*one.planted]
    assert set(one.planted) < set(found['fit everything'])
    assert found['always unknown'] == ['unknown']


def row(
    expected: list[str], verdict: list[str], probability: dict[str, float]
) -> dict[str, object]:
    named = [e for e in expected if e != 'unknown']
    return {
        'suite': 'main', 'number': 0, 'kind': 'single', 'named': named, 'expected': expected,
        'verdict': verdict, 'exact': set(expected) == set(verdict), 'top1': True,
        'false': [v for v in verdict if v not in (*expected, 'unknown')],
        'probability_of_true': [probability.get(e, 0.0) for e in expected],
        'probability': probability, 'difference': None, 'seconds': 1.0,
        'baselines': {'always unknown': ['unknown']}, 'planted': named, 'without': [],
    }  # fmt: skip


def test_scores_and_the_page() -> None:
    rows = [
        row(['backlash.x'], ['backlash.x'], {'backlash.x': 0.9, 'none': 0.1}),
        row([], ['scale_error.y'], {'scale_error.y': 0.6, 'none': 0.4}),
        row(['unknown'], ['unknown'], {'unknown': 0.7}),
    ]
    scores = suite_scores(rows)
    assert scores['exact']['mean'] == pytest.approx(2 / 3)
    assert scores['false_naming']['mean'] == 0.5 and scores['false_naming']['count'] == 2
    assert scores['probability_of_true']['mean'] == pytest.approx(0.8)
    assert scores['confusion'] == {
        'backlash': {'backlash': 1}, 'none': {'scale_error': 1}, 'unknown': {'unknown': 1},
    }  # fmt: skip
    assert scores['baselines']['always unknown']['exact']['mean'] == pytest.approx(1 / 3)
    page = markdown(
        {'seeds': 'development', 'commit': 'c0ffee', 'sha256': 'ab', 'command': '--suite main',
         'suites': {'main': scores, 'leave_one_out': scores, 'one_axis': scores}, 'cases': rows}
    )  # fmt: skip
    assert '| always unknown |' in page and '| main 0 | single | none | scale_error.y |' in page


def test_an_interval_of_equal_answers_has_a_width() -> None:
    assert interval([True] * 20)['low'] == pytest.approx(0.025**0.05)
    assert interval([False] * 20)['high'] == pytest.approx(1.0 - 0.025**0.05)
    assert interval([]) == {'count': 0}
    assert interval(list(np.arange(5.0)))['mean'] == 2.0


def test_a_run_goes_on_where_it_was_and_refuses_another_runs_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['--suite', 'one_axis', '--cases', '1', '--out', str(tmp_path)]
    assert run.main(words) == 0
    first = capsys.readouterr().out
    assert 'truth sha256' in first and '## Other sessions' in first
    folder = tmp_path / 'one_axis_0000'
    report = json.loads((folder / 'out' / 'report.json').read_text())
    assert report['schema'] == 'gap-report/1'
    assert not list(folder.glob('bag*')) and not (folder / 'out' / 'report.html').exists()
    written = (folder / 'done.json').stat().st_mtime_ns
    assert run.main(words) == 0
    assert (folder / 'done.json').stat().st_mtime_ns == written
    with pytest.raises(SystemExit, match='holds another run'):
        run.main([*words, '--first', '1'])
