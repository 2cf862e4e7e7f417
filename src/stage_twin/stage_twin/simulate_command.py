"""Console script `simulate`: run a servo twin around a circle and print what it does."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

import numpy as np

from stage_core.errors import StageError, command_line
from stage_core.quantities import MICROMETRE
from stage_core.twin_file import TwinFile
from stage_twin.simulate import SimulationResult, simulate

#: Time over which the speed along the circle rises [s].
RAMP = 0.5


def circle(
    twin: TwinFile, seconds: float, radius: float, speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Reference position [m] and velocity [m/s], (n, n_axes), on a circle that starts at 0, 0.

    The speed rises as a raised cosine over `RAMP`; one axis alone moves as x does.
    """
    times = np.arange(round(seconds / twin.control_period) + 1) * twin.control_period
    rising = np.minimum(times, RAMP)
    arc = 0.5 * speed * (rising - RAMP / math.pi * np.sin(math.pi * rising / RAMP))
    arc += speed * np.maximum(times - RAMP, 0.0)
    rate = np.where(times < RAMP, 0.5 * (1.0 - np.cos(math.pi * rising / RAMP)), 1.0) * speed
    angle = arc / radius
    position = radius * np.stack([1.0 - np.cos(angle), np.sin(angle)], axis=1)
    velocity = rate[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    return position[:, : len(twin.axes)], velocity[:, : len(twin.axes)]


def summary(twin: TwinFile, reference: np.ndarray, result: SimulationResult) -> str:
    """One table: per axis what the controller and the table do."""
    following = reference - result.encoder
    carried = result.table - result.encoder
    lines = [
        f'{"axis":<5}{"reference-encoder µm":>24}{"table-encoder µm":>22}{"force N":>16}',
        f'{"":<5}{"rms":>14}{"max":>10}{"rms":>12}{"max":>10}{"rms":>8}{"max":>8}',
    ]
    for index, name in enumerate(twin.axes):
        row = f'{name:<5}'
        for values, unit, widths in (
            (following[:, index], MICROMETRE, (14, 10)),
            (carried[:, index], MICROMETRE, (12, 10)),
            (result.force[:, index], 1.0, (8, 8)),
        ):
            rms = math.sqrt(float(np.mean(values**2))) / unit
            row += f'{rms:>{widths[0]}.2f}{float(np.abs(values).max()) / unit:>{widths[1]}.2f}'
        lines.append(row)
    return '\n'.join(lines)


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and simulate."""
    parser = argparse.ArgumentParser(
        prog='simulate', description='Simulate a servo twin around a circle.'
    )
    parser.add_argument('--twin', required=True, help='twin file (YAML) of kind servo')
    parser.add_argument('--seconds', type=float, default=10.0, help='length of the session')
    parser.add_argument('--radius', type=float, default=0.03, help='radius of the circle [m]')
    parser.add_argument('--speed', type=float, default=0.05, help='speed on the circle [m/s]')
    parser.add_argument('--seed', type=int, default=0, help="seed of the tracker's noise")
    options = parser.parse_args(arguments)
    for name in ('seconds', 'radius', 'speed'):
        value = getattr(options, name)
        if not 0.0 < value < math.inf:
            raise StageError(f'--{name} must be above zero, got {value:g}')
    twin = TwinFile.load(options.twin, with_gains=True)
    reference, velocity = circle(twin, options.seconds, options.radius, options.speed)
    result = simulate(twin, reference, velocity, seed=options.seed)
    print(
        f'{options.twin}: {len(result.times)} ticks of {twin.control_period:g} s, '
        f'{len(result.tracker_stamps)} tracker points, '
        f'effects: {", ".join(twin.effects) or "none"}'
    )
    print(summary(twin, reference, result))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
