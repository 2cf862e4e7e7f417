"""Sessions simulated with the twin, with planted effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import session
from stage_core.session import Session
from stage_core.twin_file import TrackerSpec, TwinFile

Effects = Mapping[str, Mapping[str, float]]


def reference(duration: float, period: float, axes: int, seed: int = 3) -> np.ndarray:
    """Smooth strokes with dwells, then a shrinking sweep; (n, axes) [m]."""
    generator = np.random.default_rng(seed)
    t = np.arange(round(duration / period)) * period
    out = np.zeros((len(t), axes))
    for i in range(axes):
        at, position = 0.3, 0.0
        while at < duration - 4.0:
            target = generator.uniform(-0.03, 0.03)
            length = float(generator.uniform(0.4, 1.2))
            s = np.clip((t - at) / length, 0.0, 1.0)
            out[:, i] += (target - position) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
            position = target
            at += length + 0.15
        u = np.clip(t - at, 0.0, None)
        out[:, i] += 0.008 * np.sin(2.0 * np.pi * (0.7 * u + 0.2 * u**2)) * np.minimum(1.0, 2 * u)
    return out


def make_session(
    effects: Effects, duration: float = 12.0, axes: tuple[str, ...] = ('x',), seed: int = 0
) -> Session:
    """A session of the nominal machine with planted effects, as a bag would hold it."""
    twin = nominal(axes)
    path = reference(duration, twin.control_period, len(axes))
    rise = 20.0 + 4.0 * (1.0 - np.exp(-np.arange(len(path)) * 1e-3 / 8.0))
    return session(twin.with_effects(effects), twin, path, rise, seed)


def nominal(axes: tuple[str, ...] = ('x',)) -> TwinFile:
    """The nominal twin with the axes of a test."""
    whole = TwinFile.nominal_servo()
    return replace(whole, axes={a: whole.axes[a] for a in axes}, tracker=TrackerSpec(100.0, 1e-6))


@pytest.fixture(scope='session')
def planted() -> Callable[..., Session]:
    """Maker of sessions with planted effects."""
    return make_session
