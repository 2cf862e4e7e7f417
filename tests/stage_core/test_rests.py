"""Rests of arrays and of streams."""

from __future__ import annotations

import numpy as np

from stage_core.rests import Standstill, find_rests


def test_rests_are_found_between_moves() -> None:
    times = np.arange(300) * 0.001
    command = np.concatenate([np.zeros(100), np.linspace(0, 1e-2, 50), np.full(150, 1e-2)])
    assert find_rests(times, command[:, None], 0.08) == [(0, 101), (149, 300)]
    assert find_rests(times, command[:, None], 0.12) == [(149, 300)]
    assert find_rests(times[:1], command[:1, None], 0.08) == []


def test_a_slow_move_is_no_rest_and_noise_within_the_band_is_one() -> None:
    times = np.arange(1000) * 0.001
    creep = np.column_stack([np.zeros(1000), 5e-9 * np.arange(1000)])
    assert find_rests(times, creep, 0.08) == []
    noise = np.random.default_rng(1).uniform(-1e-6, 1e-6, (1000, 2))
    assert find_rests(times, noise, 0.08, band=2e-6) == [(0, 1000)]
    noise[500, 1] = np.nan
    assert find_rests(times, noise, 0.08, band=2e-6) == [(0, 500), (501, 1000)]


def test_a_stream_tells_when_a_rest_begins() -> None:
    rest = Standstill(4e-6)
    stream = [(0.0, 0.0), (3e-6, 0.0), (5e-6, 0.0), (3e-6, 0.0), (3e-6,)]
    assert [rest.moved(position) for position in stream] == [True, False, True, False, True]
    assert rest.position == (3e-6,)
