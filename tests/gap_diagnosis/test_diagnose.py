"""Planted effects are named with their parameters, and nothing else is."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from benchmarks.experiment.machine import session
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.report import document as report
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.service import run
from session_bags.writer import write_session
from stage_core import topics
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.simulate import simulate

from .conftest import nominal, reference
from .report_schema import check_report

Maker = Callable[..., Session]


@pytest.mark.parametrize(
    ('effect', 'parameter', 'value', 'tolerance'),
    [
        ('coulomb_friction.x', 'coulomb', 6.0, 0.05),
        ('viscous_friction.x', 'viscous', 60.0, 0.05),
        ('inertia_mismatch.x', 'ratio', 0.2, 0.05),
        ('backlash.x', 'width', 8e-6, 0.05),
        ('scale_error.x', 'error', 2e-4, 0.05),
        ('cyclic_pitch_error.x', 'amplitude', 4e-6, 0.1),
        ('tracker_latency', 'latency', 2e-3, 0.05),
        ('force_offset.x', 'offset', 5.0, 0.05),
    ],
)
def test_a_single_planted_effect_is_named(
    planted: Maker, tmp_path: Path, effect: str, parameter: str, value: float, tolerance: float
) -> None:
    found = diagnose([planted({effect: {parameter: value}})], [], nominal())
    assert found.verdict == [effect]
    check_report(found, tmp_path, [effect])
    assert found.causes[0].contains == []
    estimate, deviation = found.parameters[effect][parameter]
    assert estimate == pytest.approx(value, rel=tolerance)
    assert 0.0 < deviation < 0.2 * value
    assert found.causes[0].probability > 0.5
    assert sum(c.probability for c in found.causes) == pytest.approx(1.0)


def test_the_nominal_machine_has_no_gap(planted: Maker, tmp_path: Path) -> None:
    threads: list[int] = []

    def progress(message: str) -> None:
        threads.extend(p['num_threads'] for p in threadpool_info() if p['user_api'] == 'blas')

    with threadpool_limits(2, 'blas'):
        found = diagnose([planted({})], [], nominal(), progress=progress)
    # No sum depends on the number of cores.
    assert threads and set(threads) == {1}
    assert found.verdict == []
    assert found.after < 2.0 * found.noise_floor
    none = next(c for c in found.causes if c.effect == 'none')
    assert none.probability > 0.5
    check_report(found, tmp_path, [])


def both_axes(planted: Maker) -> Diagnosis:
    effects = {
        'backlash.x': {'width': 8e-6},
        'cyclic_pitch_error.y': {'amplitude': 3e-6, 'phase': 0.7},
        'nonorthogonality': {'angle': 80e-6},
        'coulomb_friction.x': {'coulomb': 8.0},
    }
    return diagnose([planted(effects, axes=('x', 'y'))], [], TwinFile.nominal_servo())


def test_four_effects_at_once_and_the_corrected_twin(planted: Maker, tmp_path: Path) -> None:
    found = both_axes(planted)
    assert set(found.verdict) == {
        'backlash.x', 'cyclic_pitch_error.y', 'nonorthogonality', 'coulomb_friction.x',
    }  # fmt: skip
    assert found.after < 0.35 * found.before
    # The corrected twin runs as it is, and reproduces the machine's tracker points.
    report.write(found, tmp_path)
    corrected = TwinFile.load(tmp_path / 'corrected_twin.yaml')
    record = found.records[0]
    assert record.tracker is not None and record.tracker_time is not None
    result = simulate(
        corrected,
        record.reference,
        record.reference_velocity,
        tracker_times=record.tracker_time,
        noise=False,
    )
    gap = record.tracker - result.tracker_points[:, :2]
    assert float(np.sqrt(np.mean(gap**2))) < 2.5e-6


def test_a_held_out_session_judges_the_fit_of_another(planted: Maker, tmp_path: Path) -> None:
    effects = {'coulomb_friction.x': {'coulomb': 6.0}, 'backlash.x': {'width': 8e-6}}
    fit, judge = planted(effects, seed=1), planted(effects, seed=2)
    found = diagnose([fit], [judge], nominal())
    check_report(found, tmp_path, effects)
    assert len(found.windows) == 1 and found.windows[0][0] > 1.0


def test_two_diagnoses_write_the_same_report(planted: Maker, tmp_path: Path) -> None:
    bag = write_session(tmp_path / 'bag', planted({'backlash.x': {'width': 8e-6}}), nominal())
    nominal().save(tmp_path / 'twin.yaml')
    texts = []
    for name in ('a', 'b'):
        run([str(bag)], [], str(tmp_path / 'twin.yaml'), tmp_path / name, quiet=True)
        texts.append((tmp_path / name / 'report.json').read_bytes())
        assert b'<img' in (tmp_path / name / 'report.html').read_bytes()
    assert texts[0] == texts[1]
    content = json.loads(texts[0])
    assert content['verdict'] == ['backlash.x']
    assert content['where']['link'] == 'kinematic'
    assert content['where']['conditions'][0]['name'] == 'reversal'
    low, high = content['causes'][0]['shrink_ci95']
    assert low <= content['causes'][0]['shrink'] <= high


def test_a_phase_belongs_to_the_session_and_an_amplitude_to_the_machine(planted: Maker) -> None:
    def effects(phase: float) -> dict[str, dict[str, float]]:
        return {'cyclic_pitch_error.x': {'amplitude': 4e-6, 'phase': phase}}

    found = diagnose([planted(effects(0.3))], [planted(effects(2.5), seed=2)], nominal())
    assert found.verdict == ['cyclic_pitch_error.x']
    assert found.parameters['cyclic_pitch_error.x']['amplitude'][0] == pytest.approx(4e-6, rel=0.1)
    assert found.after < 1.2 * found.noise_floor


def test_an_axis_that_stands_in_the_windows_that_judge_it_is_not_judged() -> None:
    twin = TwinFile.nominal_servo()
    path = reference(12.0, twin.control_period, 2)
    time = np.arange(len(path)) * twin.control_period
    # The first window that is held out begins after 2.7 s.
    s = np.clip((time - 0.5) / 1.5, 0.0, 1.0)
    path[:, 1] = 0.01 * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    real = twin.with_effects({'coulomb_friction.x': {'coulomb': 6.0}})
    found = diagnose([session(real, twin, path, np.full(len(path), 20.0), 0)], [], twin)
    assert found.verdict == ['coulomb_friction.x']
    assert not any(name.endswith('.y') for part in found.parts for name in part.problem.terms)
    (note,) = (w for w in found.warnings if 'axis y' in w)
    assert 'hardly moves in the windows that judge it' in note


def test_an_axis_that_moves_within_a_few_steps_of_its_encoder_is_not_judged() -> None:
    whole = TwinFile.nominal_servo()
    coarse = replace(whole.axes['y'], encoder_resolution=5e-5)
    twin = replace(whole, axes={**whole.axes, 'y': coarse})
    path = reference(12.0, twin.control_period, 2)
    path[:, 1] = 2e-4 * np.sin(np.arange(len(path)) * twin.control_period)
    real = twin.with_effects({'coulomb_friction.x': {'coulomb': 6.0}})
    found = diagnose([session(real, twin, path, np.full(len(path), 20.0), 0)], [], twin)
    assert 'coulomb_friction.x' in found.verdict
    assert [part.name for part in found.parts if part.name.startswith('servo')] == ['servo.x']
    assert any('axis y hardly moves' in warning for warning in found.warnings)


def pushed(step: float) -> tuple[Session, TwinFile]:
    """An axis y at rest that axis x pushes, with an encoder of this step [m]."""
    whole = nominal(('x', 'y'))
    own = replace(whole.axes['y'], encoder_resolution=step)
    twin = replace(whole, axes={**whole.axes, 'y': own})
    path = reference(12.0, twin.control_period, 2)
    path[:, 1] = 0.0
    real = twin.with_effects({'axis_crosstalk.y': {'mass': 5.0}})
    made = session(real, twin, path, np.full(len(path), 20.0), 0)
    assert np.ptp(made.series[topics.JOINT_STATES].values['position.y']) < 2e-4
    return made, twin


def test_an_axis_at_rest_that_the_other_one_pushes_is_judged() -> None:
    made, twin = pushed(1e-7)
    assert diagnose([made], [], twin).verdict == ['axis_crosstalk.y']


def test_an_axis_with_too_few_sliding_rows_ends_no_diagnosis() -> None:
    made, twin = pushed(1e-6)
    found = diagnose([made], [], twin)
    assert [part.name for part in found.parts if part.name.startswith('servo')] == ['servo.x']


def test_an_encoder_without_any_noise_is_diagnosed() -> None:
    """One axis rests at a force of zero, and the encoders differ from the twin's by nothing."""
    whole = nominal(('x', 'y'))
    fine = {a: replace(axis, encoder_resolution=1e-9) for a, axis in whole.axes.items()}
    twin = replace(whole, axes=fine)
    path = reference(12.0, twin.control_period, 2)
    path[:, 1] = 0.0
    found = diagnose([session(twin, twin, path, np.full(len(path), 20.0), 0)], [], twin)
    assert found.verdict == []
    assert replace(found, before=0.0, after=0.0).shrink == 0.0
