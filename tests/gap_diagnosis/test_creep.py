"""A stated friction that gives way at rest, as the machine's does, is no gap."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gap_diagnosis.closed_loop.creep import with_creep
from gap_diagnosis.closed_loop.replay import replayed_gap
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.input.windows import judging, scored_ticks
from gap_diagnosis.report.document import sentence
from stage_core.session import Session

from .conftest import nominal

Maker = Callable[..., Session]

STATED = {'coulomb_friction.x': {'coulomb': 12.0, 'presliding': 0.0}}
CREEPING = {'coulomb_friction.x': {**STATED['coulomb_friction.x'], 'creep_velocity': 4e-4}}


@pytest.mark.parametrize('hidden', [{}, {'inertia_mismatch.x': {'ratio': 0.15}}])
def test_a_friction_that_gives_way_is_run_so(
    planted: Maker, hidden: dict[str, dict[str, float]]
) -> None:
    found = diagnose([planted({**CREEPING, **hidden})], [], nominal().with_effects(STATED))
    assert found.verdict == list(hidden)
    (note,) = (n for n in found.warnings if 'gives way otherwise' in n)
    assert 'creep_velocity' in note
    corrected = found.corrected_twin.effects['coulomb_friction.x']
    assert corrected['creep_velocity'] == pytest.approx(4e-4, rel=0.1)
    assert found.after < 1.2 * found.noise_floor
    # The gap before is that of the twin of the file, whose friction holds.
    judged, twin = judging(found.records), nominal().with_effects(STATED)
    before = replayed_gap(judged, twin, {}, 'x', scored_ticks)
    assert found.channels['encoder.x'].rms('before') == pytest.approx(before)
    assert before > 5.0 * found.channels['encoder.x'].rms('after')
    assert found.link == 'servo'
    # Without a cause the sentence says the gap, what is left of it, and its floor.
    before, after, floor = (1e6 * gap for gap in (found.before, found.after, found.noise_floor))
    said = (
        f'is {before:.2f} µm RMS, and {after:.2f} µm with a friction that rests otherwise '
        f'(floor {floor:.2f} µm)'
    )
    assert (said in sentence(found)) is (not hidden)


@pytest.mark.parametrize('presliding', [0.0, 2e-6])
def test_a_friction_that_holds_stays(planted: Maker, presliding: float) -> None:
    twin, name = nominal().with_effects(STATED), 'coulomb_friction.x'
    record = load_record(planted({name: {'coulomb': 12.0, 'presliding': presliding}}), twin)
    assert with_creep([record], twin) == twin


def test_a_friction_that_is_found_gives_way_as_the_machine_does(planted: Maker) -> None:
    found = diagnose([planted(CREEPING)], [], nominal())
    assert found.verdict == ['coulomb_friction.x']
    speed, deviation = found.parameters['coulomb_friction.x']['creep_velocity']
    assert speed == pytest.approx(4e-4, rel=0.1)
    assert deviation < 4e-5
    assert found.after < 1.2 * found.noise_floor
