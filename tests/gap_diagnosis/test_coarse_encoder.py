"""An encoder that counts coarser than stated, in a loop that hunts over its steps."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.report.document import sentence
from stage_core.session import Session

from .conftest import Effects, nominal

FRICTION = {
    **{'coulomb_positive': 4.3, 'coulomb_negative': 13.0},
    **{'viscous_positive': 20.0, 'viscous_negative': 3.0},
}


@pytest.mark.parametrize(
    ('step', 'beside', 'repeats'),
    [(40e-6, {}, True), (60e-6, {'asymmetric_friction.x': FRICTION}, False)],
)
def test_steps_make_the_corrected_twin_no_worse(
    planted: Callable[..., Session], step: float, beside: Effects, repeats: bool
) -> None:
    """Beside a friction the loop hunts at another phase than the twin: 1.7 µm more of a gap."""
    steps = 'encoder_quantisation.x'
    found = diagnose([planted({steps: {'resolution': step}, **beside})], [], nominal())
    assert set(found.verdict) == {steps, *beside}
    (cause,) = (c for c in found.causes if c.effect == steps)
    assert (cause.gap_after < cause.gap_before) == repeats
    assert cause.gap_after <= cause.gap_before
    assert any('follows the record no better' in n for n in found.warnings) != repeats
    assert (steps in found.run_effects) == repeats
    assert found.parameters[steps]['resolution'][0] == pytest.approx(step, rel=1e-3)
    assert 'shrinks' in sentence(found)
