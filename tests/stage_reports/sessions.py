"""Sessions whose errors are known."""

from __future__ import annotations

import numpy as np

from stage_core import topics
from stage_core.session import Series, Session, by_topic

START = 1_700_000_000_000_000_000


def circle_session(error: float = 2e-6) -> Session:
    """One turn each way on a 10 mm circle; the measured radius is larger one way by error."""
    count = 1200
    stamps = START + np.arange(2 * count, dtype=np.int64) * 1_000_000
    turn = 2.0 * np.pi * np.arange(count) / (count - 1)
    angle = np.concatenate([turn, turn[::-1]])
    path = 0.01 * np.column_stack([np.cos(angle), np.sin(angle)])
    growth = 1.0 + np.where(np.arange(2 * count) < count, error, -error) / 0.01
    still, zeros = np.zeros_like(path), np.zeros(2 * count)
    series = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=path, velocity=still),
        Series.per_axis(
            topics.JOINT_STATES, stamps, position=growth[:, None] * path, velocity=still
        ),
        Series.points(
            topics.CONTOUR_ERROR, stamps, np.column_stack([zeros, zeros, zeros + error])
        ),
    )
    key = topics.temperature_key('screw_x')
    series[key] = Series(topics.TEMPERATURE, stamps[::100], {'temperature': 20.0 + zeros[::100]})
    return Session('circle', series)


def rest_session() -> Session:
    """Twelve rests of a table that is off by 3 µm in x, between them a servo that lags by 1 mm."""
    rng = np.random.default_rng(1)
    targets = rng.uniform(-0.04, 0.04, (13, 2))
    reference, measured = [], []
    for old, new in zip(targets, targets[1:], strict=False):
        way = np.linspace(old, new, 30)
        reference += [way, np.tile(new, (70, 1))]
        measured += [way - 1e-3, np.tile(new + [3e-6, 0.0], (70, 1))]
    r, m = np.vstack(reference), np.vstack(measured)
    m += 1e-7 * rng.standard_normal(m.shape)
    stamps = START + np.arange(len(r), dtype=np.int64) * 10_000_000
    return Session(
        'rests',
        by_topic(
            Series.per_axis(topics.REFERENCE, stamps, position=r),
            Series.points(topics.TRACKER_POINT, stamps, m),
        ),
    )


def staircase(targets: list[float], cycles: int = 3) -> np.ndarray:
    """Reference that visits the targets up and down, resting 0.5 s at 100 Hz on each."""
    parts = [np.full(60, targets[0] - 0.01)]
    order = [*targets, targets[-1] + 0.01, *reversed(targets), targets[0] - 0.01]
    here = targets[0] - 0.01
    for _ in range(cycles):
        for target in order:
            parts.append(np.linspace(here, target, 30)[1:])
            parts.append(np.full(50, target))
            here = target
    return np.concatenate(parts)
