"""Speed of the servo twin against the same session by scipy's solve_ivp, tick by tick.

Peer: scipy.integrate.solve_ivp (LSODA, rtol 1e-6) on the same axis with the same friction, the
usual way of writing such a plant in Python; run on the first seconds and scaled to a minute.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.integrate import solve_ivp

from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS
from stage_twin.simulate import simulate

PERIOD = 1e-3
SECONDS = 60.0
PEER_SECONDS = 1.0
COULOMB, PRESLIDING = 10.0, 1e-6


def session(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """A circle of 30 mm at 0.2 Hz: position [m] and velocity [m/s], (n, 2)."""
    times = np.arange(round(seconds / PERIOD)) * PERIOD
    angle = 0.4 * np.pi * times
    position = 0.03 * np.stack([1.0 - np.cos(angle), np.sin(angle)], axis=1)
    return position, np.gradient(position, PERIOD, axis=0)


def best_of(repeats: int, twin: TwinFile) -> float:
    """Shortest wall time of a minute's session [s], compiled beforehand."""
    position, velocity = session(SECONDS)
    simulate(twin, position[:100], velocity[:100])
    durations = []
    for _ in range(repeats):
        start = time.perf_counter()
        simulate(twin, position, velocity)
        durations.append(time.perf_counter() - start)
    return min(durations)


def peer(twin: TwinFile) -> float:
    """Wall time of the peer for a minute of two axes [s], scaled from a shorter run."""
    axis = twin.servo('x')
    position, velocity = session(PEER_SECONDS)
    result = simulate(twin, position, velocity)
    stiffness = COULOMB / PRESLIDING

    def rates(t: float, state: np.ndarray, force: float) -> list[float]:
        friction = axis.viscous * state[1] + stiffness * state[2]
        slip = state[1] - abs(state[1]) * state[2] / PRESLIDING
        return [state[1], (force - friction) / axis.mass, slip]

    state = np.zeros(3)
    start = time.perf_counter()
    for force in result.force[:, 0]:
        solution = solve_ivp(
            rates, (0.0, PERIOD), state, method='LSODA', rtol=1e-6, atol=1e-12, args=(force,)
        )
        state = solution.y[:, -1]
    return (time.perf_counter() - start) * SECONDS / PEER_SECONDS * 2.0


def main() -> None:
    """Print the table."""
    nominal = TwinFile.nominal_servo()
    friction = {'coulomb': COULOMB, 'presliding': PRESLIDING}
    rubbing = nominal.with_effects({f'coulomb_friction.{axis}': friction for axis in 'xy'})
    every = nominal.with_effects(
        {
            f'{effect.name}.{axis}' if effect.per_axis else effect.name: {}
            for effect in EFFECTS.values()
            for axis in 'xy'
        }
    )
    scipy_time = peer(rubbing)
    print(f'{SECONDS:.0f} s of two axes at 1 kHz            wall s   times real time   times peer')
    for name, twin in (
        ('nominal', nominal),
        ('Coulomb friction on both axes', rubbing),
        ('every effect on both axes', every),
    ):
        duration = best_of(3, twin)
        print(
            f'{name:<38}{duration:>8.3f}{SECONDS / duration:>18.0f}{scipy_time / duration:>13.0f}'
        )
    print(f'{"solve_ivp, friction (peer, scaled)":<38}{scipy_time:>8.1f}')


if __name__ == '__main__':
    main()
