"""LuGre compensation (eqs. 6-8 of paper 3) in closed loop: without, true, identified parameters.

python benchmarks/paper3_friction.py [--seeds 3]

Each machine of `paper3_rig` is excited (`excitation`) and its friction identified from encoder and
force alone. Then P + velocity feed-forward follows the circle once, with each set of parameters.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
import paper3_rig as rig

from contour_ctrl import curves, reference
from contour_ctrl.excitation import excitation
from contour_ctrl.feedrate import AxisLimits
from contour_ctrl.figures import Figures
from contour_ctrl.friction import LuGre
from contour_ctrl.identify_friction import identify
from contour_ctrl.rehearsal import Rehearsal
from contour_ctrl.tick import Controller, Gains
from stage_core.twin_file import TwinFile
from stage_twin.simulate import simulate

FEEDS = (0.06, 0.01)
GAINS = Gains(position=(167.0, 169.0))
Models = tuple[LuGre, LuGre]


def true_models(machine: TwinFile) -> Models:
    """LuGre parameters of the emulated machine."""
    models = []
    for axis in ('x', 'y'):
        effect = machine.effects[f'stribeck_friction.{axis}']
        static = effect['coulomb'] + effect['breakaway']
        models.append(
            LuGre(
                effect['coulomb'],
                static,
                effect['stribeck_velocity'],
                static / effect['presliding'],
                0.0,
                machine.servo(axis).viscous,
            )
        )
    return models[0], models[1]


def identified_models(machine: TwinFile) -> Models:
    """The same from a recorded excitation; prints what was found."""
    limits = AxisLimits((0.2, 0.2), (2.0, 2.0), (500.0, 500.0))
    ref = excitation((0.03, 0.03), speeds=(0.015, 0.06), multisine_time=4.0, limits=limits)
    record = simulate(machine, ref.position, ref.velocity, noise=False)
    models = []
    for axis, truth in enumerate(true_models(machine)):
        found = identify(record.encoder[:, axis], record.force[:, axis], machine.control_period)
        models.append(found.model)
        spread = found.std['stiffness'] / found.model.stiffness
        shares = ', '.join(
            f'{name} {getattr(found.model, name) / getattr(truth, name) - 1.0:+.1%}'
            for name in ('coulomb', 'static', 'stribeck_velocity', 'stiffness')
        )
        print(f'  {"xy"[axis]}: identified against true: {shares} (std {spread:.1%})', flush=True)
    return models[0], models[1]


def main() -> None:
    """Print one table per feed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=3, help='machines')
    given = parser.parse_args()
    references = {feed: reference.plan(curves.circle(rig.RADIUS), feed) for feed in FEEDS}
    results: dict[tuple[float, str], list[Figures]] = {}
    for seed in range(given.seeds):
        machine = rig.machine(seed)
        print(f'machine {seed}', flush=True)
        sets: dict[str, Models | None] = {
            'without': None,
            'true parameters': true_models(machine),
            'identified': identified_models(machine),
        }
        for feed, ref in references.items():
            force = rig.disturbances(seed, len(ref), 1)[0]
            for name, friction in sets.items():
                controller = Controller(ref, replace(GAINS, friction=friction))
                results.setdefault((feed, name), []).append(
                    Rehearsal(machine).run(controller, force)
                )
    print('\n| feed | LuGre term | X RMS | max | Y RMS | max | contour RMS | max |')
    print('|---|---|---|---|---|---|---|---|')
    for (feed, name), figures in results.items():
        values = [[(m.rms, m.max) for m in (f.x, f.y, f.contour)] for f in figures]
        cells = [f'{rms:.2f} | {top:.1f}' for rms, top in 1e6 * np.mean(values, axis=0)]
        print(f'| {1e3 * feed:g} mm/s | {name} | {" | ".join(cells)} |')


if __name__ == '__main__':
    main()
