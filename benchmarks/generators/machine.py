"""The nominal stage of a case: what the twin file says, and what a session can ask of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

AXES = ('x', 'y')
LEADS = (0.002, 0.004, 0.005, 0.008, 0.010, 0.016, 0.020)
RESOLUTIONS = (1e-7, 2e-7, 5e-7, 1e-6, 2e-6, 5e-6)


@dataclass(frozen=True)
class Axis:
    """One axis of the twin file; units as in the file (SI)."""

    mass: float
    viscous: float
    encoder_resolution: float
    lead: float
    position_gain: float
    velocity_feedforward: float
    velocity_gain: float
    integral_gain: float
    velocity_filter: float
    force_limit: float
    delay: float = 0.0


@dataclass(frozen=True)
class Machine:
    """A nominal stage. What the twin file does not hold: noise, jitter, travel and abilities.

    `encoder_noise` [m] per axis and `stamp_jitter` [s] are standard deviations; the jitter moves
    the tick and its stamp alike. `travel` [m], `speed` [m/s], `acceleration` [m/s²] per axis bound
    the references.
    """

    control_period: float
    axes: tuple[Axis, Axis]
    tracker_rate: float
    tracker_noise: float
    temperature_reference: float
    encoder_noise: tuple[float, float]
    stamp_jitter: float
    travel: tuple[float, float]
    speed: tuple[float, float]
    acceleration: tuple[float, float]

    def twin(self, axes: int = 2, tracker: bool = True) -> dict[str, Any]:
        """Content of the twin file of the first `axes` axes."""
        content: dict[str, Any] = {
            'kind': 'servo',
            'control_period': self.control_period,
            'axes': {name: asdict(self.axes[i]) for i, name in enumerate(AXES[:axes])},
        }
        if tracker:
            content['tracker'] = {'rate': self.tracker_rate, 'noise': self.tracker_noise}
        content['temperature_reference'] = self.temperature_reference
        return content


def draw_machine(rng: np.random.Generator) -> Machine:
    """A stage with sensible, stable gains for its mass."""
    period = float(rng.choice([0.0005, 0.001]))
    resolution = float(rng.choice(RESOLUTIONS))
    lead = float(rng.choice(LEADS))
    acceleration = [float(rng.uniform(1.0, 5.0)) for _ in AXES]
    feedforward = float(rng.choice([0.0, 0.0, 1.0, rng.uniform(0.5, 0.95)]))
    axes = [_draw_axis(rng, resolution, lead, feedforward, a, period) for a in acceleration]
    noise_bound = 1.5 if resolution <= 1e-6 else 0.4
    return Machine(
        control_period=period,
        axes=(axes[0], axes[1]),
        tracker_rate=float(rng.choice([50.0, 100.0, 200.0, 250.0, 500.0])),
        tracker_noise=float(np.exp(rng.uniform(np.log(4e-7), np.log(4e-6)))),
        temperature_reference=20.0,
        encoder_noise=_pair(resolution * rng.uniform(0.0, noise_bound, 2)),
        stamp_jitter=float(rng.choice([0.0, 2e-6, 1e-5])),
        travel=_pair(np.exp(rng.uniform(np.log(0.05), np.log(0.4), 2))),
        speed=_pair(rng.uniform(0.05, 0.4, 2)),
        acceleration=_pair(acceleration),
    )


def _draw_axis(
    rng: np.random.Generator,
    resolution: float,
    lead: float,
    feedforward: float,
    acceleration: float,
    period: float,
) -> Axis:
    mass = float(np.exp(rng.uniform(np.log(3.0), np.log(40.0))))
    # A coarse encoder read often gives a noisy speed: such a stage is tuned softer.
    soft = 0.6 if resolution / period > 1.5e-3 else 1.0
    bandwidth = soft * rng.uniform(120.0, 260.0)
    gain = mass * bandwidth
    values = {
        'mass': mass,
        'viscous': mass * rng.uniform(0.5, 5.0),
        'position_gain': bandwidth / rng.uniform(4.0, 7.0),
        'velocity_gain': gain,
        'integral_gain': gain * bandwidth / rng.uniform(6.0, 12.0),
        'velocity_filter': bandwidth * rng.uniform(5.0, 8.0),
        'force_limit': mass * acceleration * rng.uniform(1.6, 3.0) + 20.0,
    }
    rounded = {name: float(f'{value:.4g}') for name, value in values.items()}
    return Axis(
        encoder_resolution=resolution,
        lead=lead,
        velocity_feedforward=round(feedforward, 3),
        **rounded,
    )


def _pair(values: Any) -> tuple[float, float]:
    return float(values[0]), float(values[1])
