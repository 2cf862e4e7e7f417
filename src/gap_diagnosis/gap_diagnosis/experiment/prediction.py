"""What the twin with a set of effects would show on a motion, in what a diagnosis judges."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gap_diagnosis.parameters import Effects
from gap_diagnosis.residuals.low_pass import band_limited
from gap_diagnosis.residuals.nominal import merged
from stage_core.arrays import Array
from stage_core.quantities import split_effect
from stage_core.twin_file import TrackerSpec, TwinFile
from stage_twin.simulate import simulate

#: Of a prediction [s]: means of so much are one value; effects last longer.
STEP = 0.02
#: The step [m] of an encoder whose counts do not stand between two predictions.
FINE = 1e-9
#: Below this mean speed of its encoder [m/s] an axis rests: its friction holds any force then.
RESTING = 1.5e-4


@dataclass(frozen=True)
class Noise:
    """Noise of what is judged, as a diagnosis low-passes it.

    Noise of the encoder weighs less in slow motion, of which the fast part is left out: the
    first of the `cuts` (k,) [Hz] above which a motion shows little enough of it.

    Attributes
    ----------
    acceleration, force : (k, a) standard deviation of a row below each cut [m/s²], [N]
    share : of noise in the mean square of the acceleration that is borne
    session : (a,) mean square of the acceleration [m²/s⁴] in the session that is judged together
        with the motion
    tracker : of the tracker [m]
    """

    cuts: tuple[float, ...]
    acceleration: Array
    force: Array
    share: float
    session: Array
    tracker: float

    def cut(self, axis: int, rate: Array, period: float) -> int:
        """Number of the cut for a motion of an axis with the speed (n,) [m/s]."""
        moved = max(float(np.mean(np.gradient(rate, period) ** 2)), self.session[axis])
        enough = self.acceleration[:, axis] ** 2 < self.share * moved
        return int(np.argmax(enough)) if enough.any() else len(self.cuts) - 1


@dataclass(frozen=True)
class Predictor:
    """Runs the twin with any effects in closed loop.

    Attributes
    ----------
    twin : the nominal twin, of the axes that move
    noise : what stands beside a prediction
    rise : temperature of each screw above the reference (a,) [K]
    """

    twin: TwinFile
    noise: Noise
    rise: Array
    tracker: bool = True

    def channels(self, effects: Effects, position: Array) -> tuple[Array, Array]:
        """Channels (c, m) over their noise of a reference (n, a) [m]; largest force (a,) [N].

        Channels are the force of each axis that the nominal motion does not need, then the
        tracker less the encoder of each, but for the offset of its frame. Where an axis rests the
        force is zero, as a diagnosis passes it over.

        Raises
        ------
        StageError
            If the twin with these effects is no machine.
        """
        period = self.twin.control_period
        times = self.times(len(position))
        made = simulate(
            self._machine(effects),
            position,
            np.gradient(position, period, axis=0),
            temperatures=np.tile(self.rise + self.twin.temperature_reference, (len(position), 1)),
            tracker_times=times if self.tracker else np.zeros(0),
            noise=False,
        )
        shown = [self.balance(position, made.encoder, made.force)]
        if self.tracker:
            clock = np.arange(len(position)) * period
            at = np.array([np.interp(times, clock, column) for column in made.encoder.T])
            apart = made.tracker_points[:, : len(at)].T - at
            shown.append((apart - apart.mean(axis=1, keepdims=True)) / self.noise.tracker)
        return np.concatenate(shown), np.abs(made.force).max(axis=0)

    def times(self, ticks: int) -> Array:
        """Middle (m,) [s] of the stretches of so many ticks of which a channel has one value."""
        size = self._size
        return np.asarray((np.arange(ticks // size) + 0.5) * size * self.twin.control_period)

    def balance(self, position: Array, encoder: Array, force: Array) -> Array:
        """Mean force (a, m) that the nominal plant does not need, over its noise.

        It is zero where the axis rests. All are (n, a): reference and encoder [m], force [N].
        """
        period = self.twin.control_period
        rate = np.gradient(position, period, axis=0)
        out = self._means(force - self._needed(encoder, period))
        for i, column in enumerate(rate.T):
            at = self.noise.cut(i, column, period)
            if self.noise.cuts[at] < 0.5 / STEP:
                out[i] = band_limited(out[i], STEP, self.noise.cuts[at])
            out[i] /= self.noise.force[at, i]
        moving = np.abs(self._means(np.gradient(encoder, period, axis=0))) > RESTING
        return np.asarray(out * moving)

    @property
    def _size(self) -> int:
        return max(1, round(STEP / self.twin.control_period))

    def _means(self, signal: Array) -> Array:
        rows = len(signal) // self._size
        return np.asarray(signal[: rows * self._size].reshape(rows, self._size, -1).mean(axis=1).T)

    def _needed(self, encoder: Array, period: float) -> Array:
        """Force (n, a) [N] that the nominal plant needs for a motion."""
        axes = [self.twin.servo(a) for a in self.twin.axes]
        mass, viscous = (np.array([getattr(a, k) for a in axes]) for k in ('mass', 'viscous'))
        rate = np.gradient(encoder, period, axis=0)
        return np.asarray(mass * np.gradient(rate, period, axis=0) + viscous * rate)

    def _machine(self, effects: Effects) -> TwinFile:
        axes = {a: replace(self.twin.servo(a), encoder_resolution=FINE) for a in self.twin.axes}
        own = {
            name: dict(values)
            for name, values in effects.items()
            if split_effect(name)[1] in (None, *axes)
            and not name.startswith(('encoder_quantisation', 'effort_convention', 'sample_jitter'))
        }
        tracker = TrackerSpec(1.0 / STEP, 0.0) if self.tracker else None
        return merged(replace(self.twin, axes=dict(axes), tracker=tracker), own)
