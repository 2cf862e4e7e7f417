"""The page of a diagnosis: what stands out of the corrected twin is named, not passed over."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from gap_diagnosis.closed_loop.channels import Channel
from gap_diagnosis.report.leftovers import leftovers
from stage_core.twin_file import TwinFile


def found_in(after: np.ndarray) -> Any:
    """Leftovers of one encoder channel at 1 kHz whose reference turns at 1 s and at 3 s."""
    time = 1e-3 * np.arange(len(after))
    position = 0.01 * np.abs(((time + 1.0) % 4.0) - 2.0)
    record = SimpleNamespace(
        axes=('x',), time=time, reference=position[:, None], held_out_session=False
    )
    channel = Channel('encoder.x', 'm', [time], [2.0 * after], [after])
    diagnosis = SimpleNamespace(
        channels={'encoder.x': channel}, records=[record], twin=TwinFile.nominal_servo()
    )
    return leftovers(diagnosis)  # type: ignore[arg-type]


def test_spikes_after_a_reversal_are_found_and_noise_is_not() -> None:
    noise = 0.3e-6 * np.random.default_rng(0).standard_normal(4000)
    assert found_in(noise) == []
    spikes = noise.copy()
    spikes[1050:1060] += 15e-6
    spikes[2000:2005] -= 12e-6
    (found,) = found_in(spikes)
    assert (found.channel, found.count, found.after_reversal) == ('encoder.x', 2, 1)
    assert abs(found.largest - 15e-6) < 1.5e-6
    np.testing.assert_allclose(found.times, [1.055, 2.0], atol=0.01)


def test_a_count_of_the_encoder_is_no_event() -> None:
    counts = np.zeros(4000)
    counts[::400] = 1e-6
    assert found_in(counts) == []
