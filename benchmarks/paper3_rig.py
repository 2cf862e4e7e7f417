"""What the benchmarks of paper 3 share: the emulated machine, the tuning rules, the schemes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.sparse.linalg import LinearOperator, cg

from contour_ctrl import curves, ilc, reference
from contour_ctrl.cmac import CmacSettings
from contour_ctrl.figures import Figures
from contour_ctrl.learning import Learner, LearningSettings
from contour_ctrl.reference import Reference
from contour_ctrl.rehearsal import Rehearsal
from contour_ctrl.tick import EX, Controller, Gains
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile

PERIOD = 0.001
RADIUS, FEED = 0.03, 0.06
ITERATIONS = 30
TUNING_SEED = 1000
#: Maximum of the position loop's sensitivity that the gain is tuned to.
SENSITIVITY = 1.6
#: Random force that differs from run to run [N RMS], per axis.
NOISE = (1.0, 0.5)
#: Zero-phase filter Q [Hz] of the learning as printed, without lead: about twice the bandwidth
#: of the position loop, K_p / 2 pi.
PLAIN_CUTOFF = 50.0
#: Somebody pushes the table along x: largest force [N] and duration [s].
PULSE_FORCE, PULSE_TIME = 60.0, 0.3
NOMINAL = TwinFile.nominal_servo()


def norm_optimal_update(
    learned: Array,
    error: Array,
    impulse: Array,
    effort_weight: float,
    change_weight: float,
    tolerance: float = 1e-10,
) -> Array:
    """Return the u that minimises |e - G (u - u_j)|^2 + w_u |u|^2 + w_d |u - u_j|^2.

    The quadratic criterion of norm-optimal learning (Bristow, Tharayil, Alleyne, IEEE Control
    Systems 26, 2006), one axis: `learned` u_j (n,) [m/s], `error` e_j (n,) [m], `impulse`
    (<= n,) as in `ilc.convergence_factor`. G and its transpose are convolutions by FFT and the
    normal equations are solved by conjugate gradients, so no (n, n) matrix is made.
    """
    count = len(error)
    size = next_fast_len(count + len(impulse))
    spectrum = rfft(impulse, size)

    def forward(u: Array) -> Array:
        return np.asarray(irfft(rfft(u, size) * spectrum, size)[:count])

    def adjoint(e: Array) -> Array:
        return np.asarray(irfft(rfft(e, size) * np.conj(spectrum), size)[:count])

    def normal(u: Array) -> Array:
        u = np.ravel(u)
        return adjoint(forward(u)) + (effort_weight + change_weight) * u

    operator = LinearOperator((count, count), matvec=normal, dtype=float)
    right = adjoint(error + forward(learned)) + change_weight * learned
    solution, info = cg(operator, right, x0=learned, rtol=tolerance, maxiter=2000)
    if info != 0:
        raise StageError('norm-optimal learning did not converge: raise effort_weight')
    return np.asarray(solution)


def contour() -> Reference:
    """The circle of the benchmark, a NURBS as in figure 8a."""
    return reference.plan(curves.circle(RADIUS), FEED, PERIOD)


def machine(seed: int, load: float = 0.0) -> TwinFile:
    """A reality of the servo twin: friction, ripple and inertia that the nominal one lacks.

    `load` is what rides on the table, as a share of the nominal mass of each axis.
    """
    rng = np.random.default_rng(seed)

    def about(value: float) -> float:
        return float(value * rng.uniform(0.85, 1.15))

    return NOMINAL.with_effects(
        {
            'stribeck_friction.x': {
                'coulomb': about(22.0),
                'breakaway': about(9.0),
                'stribeck_velocity': about(6e-3),
                'presliding': about(4e-6),
            },
            'stribeck_friction.y': {
                'coulomb': about(7.0),
                'breakaway': about(3.0),
                'stribeck_velocity': about(4e-3),
                'presliding': about(3e-6),
            },
            'force_ripple.x': {'amplitude': about(3.0), 'phase': float(rng.uniform(0, 6.28))},
            'force_ripple.y': {'amplitude': about(1.5), 'phase': float(rng.uniform(0, 6.28))},
            'inertia_mismatch.x': {'ratio': load + float(rng.uniform(-0.1, 0.1))},
            'inertia_mismatch.y': {'ratio': load + float(rng.uniform(0.1, 0.3))},
        }
    )


def disturbances(seed: int, count: int, iterations: int = ITERATIONS) -> list[np.ndarray]:
    """Random forces (n, 2) [N] of each run: what does not repeat."""
    rng = np.random.default_rng(10_000 + seed)
    return [rng.normal(size=(count, 2)) * NOISE for _ in range(iterations)]


def pulse(count: int) -> np.ndarray:
    """Force (count, 2) [N] of a push after a third of an iteration."""
    force, ticks = np.zeros((count, 2)), int(PULSE_TIME / PERIOD)
    shape = PULSE_FORCE * np.sin(np.pi * np.arange(ticks) / ticks) ** 2
    force[count // 3 : count // 3 + ticks, 0] = shape
    return force


def position_gain(axis: str) -> float:
    """Rule: the largest K_p whose loop on the nominal twin keeps max |S| <= SENSITIVITY."""
    best = 1.0
    for gain in range(5, 201, 1):
        # An unstable loop has no finite one.
        if not sensitivity(axis, float(gain)) <= SENSITIVITY:
            break
        best = float(gain)
    return best


def sensitivity(axis: str, gain: float) -> float:
    """Maximum of |S| of the position loop with K_p on the nominal twin."""
    return float(np.abs(1.0 - gain * np.fft.rfft(nominal_impulse(axis, gain))).max())


def first_rate(gain: float) -> float:
    """Rule: the smallest L whose nominal convergence factor exceeds 1.05.

    The paper begins with "a larger value" and leaves the rest to the regulator; just beyond the
    edge of convergence is where a fixed rate over-learns.
    """
    impulse = nominal_impulse('x', gain)
    for rate in range(10, 1000, 10):
        if ilc.convergence_factor(impulse, float(rate), PLAIN_CUTOFF, PERIOD) > 1.05:
            return float(rate)
    raise RuntimeError('no rate is beyond the edge')


def nominal_impulse(axis: str, gain: float, count: int = 4000) -> np.ndarray:
    """Response (count,) [m] of the nominal axis to a learned velocity, loop closed by K_p."""
    return ilc.closed_loop_impulse(NOMINAL.servo(axis), gain, PERIOD, count)


def designed(tuned: Tuned) -> LearningSettings:
    """Learning of scheme 3 with lead and Q by `ilc.design` and L_initial = K_p."""
    gain = tuned.base.position[0]
    lead, cutoff = ilc.design(nominal_impulse('x', gain), gain, PERIOD)
    return LearningSettings((gain, gain), cutoff, lead, floor=0.1, divergence=0.0)


def printed(tuned: Tuned) -> LearningSettings:
    """Learning of scheme 3 as printed: no lead, a rate that a fixed one over-learns with."""
    rate = first_rate(tuned.base.position[0])
    return LearningSettings((rate, rate), PLAIN_CUTOFF, 0, floor=0.1, divergence=0.0)


@dataclass(frozen=True)
class Tuned:
    """The gains that the rules give; all from the tuning seed, none from a test seed."""

    base: Gains
    scheme_1: Gains
    feed_forward: Gains


def tune() -> Tuned:
    """Tune scheme 1 and the feed-forward peer.

    K_p by `position_gain`. K_c and the CMAC's rate: the pair with the smallest contour RMS in
    lap 8 of scheme 1. K_a of the peer: the smallest tracking RMS.
    """
    ref, rig = contour(), Rehearsal(machine(TUNING_SEED))
    noise = disturbances(TUNING_SEED, len(ref), 8)
    base = Gains(position=(position_gain('x'), position_gain('y')))

    def last(gains: Gains) -> Figures:
        return rig.iterate(Controller(ref, gains), None, 8, noise)[-1]

    candidates = [
        replace(base, cross_coupling=coupling, cmac=CmacSettings(rate=rate))
        for coupling in (0.0, 10.0, 20.0, 40.0, 60.0)
        for rate in (500.0, 1000.0, 2000.0, 4000.0)
    ]
    scheme_1 = min(candidates, key=lambda gains: last(gains).contour.rms)
    forward = [
        replace(base, acceleration_feedforward=(lead, lead))
        for lead in np.arange(0.0, 0.0101, 0.0005)
    ]
    feed_forward = min(forward, key=lambda gains: (f := last(gains)).x.rms + f.y.rms)
    return Tuned(base, scheme_1, feed_forward)


@dataclass(frozen=True)
class Situation:
    """What an experiment changes: load (see `machine`), random force, forces by iteration [N]."""

    load: float = 0.0
    noise: float = 1.0
    extra: dict[int, np.ndarray] = field(default_factory=dict)

    def forces(self, seed: int, count: int, iterations: int) -> list[np.ndarray]:
        """Forces (count, 2) [N] of each iteration."""
        forces = [self.noise * force for force in disturbances(seed, count, iterations)]
        for index, force in self.extra.items():
            forces[index] = forces[index] + force
        return forces


NORMAL = Situation()


def learn(
    seed: int,
    gains: Gains,
    settings: LearningSettings | None,
    iterations: int = ITERATIONS,
    situation: Situation = NORMAL,
) -> tuple[list[Figures], Learner | None, Controller]:
    """Run a scheme on the machine of a seed."""
    ref = contour()
    forces = situation.forces(seed, len(ref), iterations)
    controller = Controller(ref, gains)
    learner = None if settings is None else Learner(len(ref), PERIOD, settings)
    rig = Rehearsal(machine(seed, situation.load))
    return rig.iterate(controller, learner, iterations, forces), learner, controller


def change_weight(gains: Gains, iterations: int = ITERATIONS) -> float:
    """Rule: the weight w_d with the smallest contour RMS in the last iteration, tuning seed."""
    weights = (1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3)

    def last(weight: float) -> float:
        return norm_optimal(TUNING_SEED, gains, weight, iterations)[-1].contour.rms

    return min(weights, key=last)


def norm_optimal(
    seed: int,
    gains: Gains,
    change: float,
    iterations: int = ITERATIONS,
    situation: Situation = NORMAL,
) -> list[Figures]:
    """Norm-optimal learning on the machine of a seed."""
    forces = situation.forces(seed, len(contour()), iterations)
    return norm_optimal_on(Rehearsal(machine(seed, situation.load)), gains, change, forces)


def norm_optimal_on(
    rig: Rehearsal, gains: Gains, change: float, forces: list[np.ndarray]
) -> list[Figures]:
    """Plain norm-optimal learning on the nominal model of each axis; no weight on the effort."""
    controller = Controller(contour(), gains)
    models = [nominal_impulse(axis, gains.position[i], 1000) for i, axis in enumerate(('x', 'y'))]
    results = []
    for force in forces:
        results.append(rig.run(controller, force))
        for axis in range(2):
            controller.learned[:, axis] = norm_optimal_update(
                controller.learned[:, axis].copy(),
                controller.record[:, EX + axis].copy(),
                models[axis],
                0.0,
                change,
                1e-6,
            )
    return results
