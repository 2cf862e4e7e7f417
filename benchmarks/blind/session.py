"""From the blind machine's recording to a session bag, and which effects it can show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.cases import Case
from benchmarks.blind.machine import Recording, record
from stage_core import topics
from stage_core.session import Series, Session, by_topic

EPOCH = 1_760_000_000_000_000_000

#: What an effect must change to count as visible: means of the encoder over 20 ms [m] (its last
#: count is chance), the tracker [m] (a third of its noise), means of the force over 0.1 s [N].
ENCODER, TRACKER, FORCE = 0.1e-6, 0.33e-6, 0.3


def run_machine(case: Case, seed: int | None = None) -> Recording:
    """The recording of a case, or of another session of the same machine with another seed."""
    return record(
        case.truth,
        case.seed if seed is None else seed,
        case.axes,
        case.duration,
        case.rate,
        case.noise,
    )


def as_session(
    recording: Recording, seed: int, tracker: bool = True, temperature: bool = True
) -> Session:
    """A recording with stamps at any epoch; stage stamps jitter by up to 20 µs."""
    generator = np.random.default_rng(seed + 1)
    start = EPOCH + int(generator.integers(0, 10**15))

    def stamps(seconds: np.ndarray, jitter: float) -> np.ndarray:
        noise = generator.uniform(-jitter, jitter, len(seconds))
        return start + np.rint((seconds + noise) * 1e9).astype(np.int64)

    ticks = stamps(recording.time, 20e-6)

    axes = recording.axes
    motion = {'position': recording.reference, 'velocity': recording.reference_velocity}
    command = {'velocity': recording.velocity_command, 'effort': recording.force}
    state = {'position': recording.encoder, 'velocity': recording.filtered_velocity}
    series = by_topic(
        Series.per_axis(topics.REFERENCE, ticks, axes, **motion),
        Series.per_axis(topics.COMMAND, ticks, axes, **command),
        Series.per_axis(topics.JOINT_STATES, ticks, axes, **state),
    )
    if tracker:
        series[topics.TRACKER_POINT] = Series.points(
            topics.TRACKER_POINT, stamps(recording.tracker_time, 0.0), recording.tracker
        )
    for i, axis in enumerate(recording.axes if temperature else ()):
        series[topics.temperature_key(f'screw_{axis}')] = Series(
            topics.TEMPERATURE,
            stamps(recording.temperature_time, 0.0),
            {'temperature': recording.temperature[:, i]},
        )
    return Session('blind', series)


def visible(case: Case) -> Case:
    """The case with those effects expected that change what the recorder holds.

    The machine is run once more without each effect. An effect that changes less than `ENCODER`,
    `TRACKER` and `FORCE` is below the noise and must not be named. A coarse encoder is seen.
    """
    if not case.planted:
        return case
    whole = run_machine(case)
    seen = []
    for name in case.planted:
        rest = {n: v for n, v in case.truth.items() if n != name}
        less = run_machine(replace(case, truth=rest))
        changes = [
            _rms_of_means(whole.encoder - less.encoder, 20) / ENCODER,
            _rms_of_means(whole.force - less.force, 100) / FORCE,
            2.0 if name.startswith('encoder_quantisation') else 0.0,
        ]
        if case.tracker:
            changes.append(_rms_of_means(whole.tracker - less.tracker, 1) / TRACKER)
        if max(changes) > 1.0:
            seen.append(name)
    return replace(case, planted=tuple(seen))


def _rms_of_means(signal: np.ndarray, size: int) -> float:
    """Largest RMS over the axes (n, a) of means over `size` samples."""
    whole = signal[: len(signal) // size * size]
    means = whole.reshape(-1, size, signal.shape[1]).mean(axis=1)
    return float(np.sqrt(np.mean(means**2, axis=0)).max())
