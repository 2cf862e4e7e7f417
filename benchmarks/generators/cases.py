"""Draws cases from a seed, makes sure that what is planted shows, and writes them."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from .bag import write_bag
from .machine import Machine, draw_machine
from .record import Generator, Planted, Record, Wish
from .references import Reference, draw_reference

KINDS = {'none': 0.08, 'hidden': 0.04, 'single': 0.60, 'pair': 0.20, 'unknown': 0.08}
# A planted effect changes the encoder or the tracker by at least this many noise floors (RMS);
# a hidden one by at most the second figure.
SHOWS = 2.0
HIDES = 0.3  # most of it is the encoder's rounding, which falls otherwise
ATTEMPTS = 5
# A stage farther than this from its path has failed: no such session would be kept.
LOST = 0.02
# A share of ticks at the force limit: paths ask for at most 0.6 of it.
HOWLING = 0.05
# What these change is in the bag, not in the motion.
RECORDED_ONLY = ('effort_convention', 'sample_jitter')
NEEDS_TRACKER = {
    'scale_error', 'cyclic_pitch_error', 'nonorthogonality', 'straightness', 'backlash',
    'thermal_expansion', 'angular_error', 'tracker_misalignment', 'tracker_latency',
    'tracker_clock_drift',
}  # fmt: skip
NEEDS_BOTH = {
    'axis_crosstalk', 'angular_error', 'straightness', 'base_resonance', 'structural_resonance',
}  # fmt: skip
# Forces of which a constant one may be a part.
CONSTANT = {'position_force', 'cable_force', 'force_offset'}
# On a path that never turns back these are an offset or a force of the position.
NEEDS_REVERSALS = {
    'backlash', 'coulomb_friction', 'asymmetric_friction', 'stribeck_friction', 'drive_play',
    'position_dependent_friction',
}  # fmt: skip
# Of one family, two on the same axis cannot be told apart or exclude each other.
FAMILIES = (
    {
        'coulomb_friction', 'asymmetric_friction', 'stribeck_friction',
        'position_dependent_friction', 'drive_play',
    },
    {'inertia_mismatch', 'drive_gain', 'torque_sag'},
    {'cable_force', 'position_force'},
    {'actuation_delay', 'current_loop_lag'},
    {'scale_error', 'thermal_expansion', 'angular_error'},
    {'encoder_quantisation', 'encoder_interpolation'},
)  # fmt: skip
# These have no axis, or displace the other one: a pair of them is none.
WHOLE = {'straightness', 'nonorthogonality', 'tracker_misalignment', 'angular_error'}


@dataclass(frozen=True)
class Case:
    """A case ready to be written; `gap` is RMS change over noise floor, per planted name."""

    name: str
    kind: str
    machine: Machine
    reference: Reference
    planted: list[Planted]
    record: Record
    gap: dict[str, float]
    axes: int
    tracker: bool


def draw_cases(generator: Generator, seed: int, count: int, only: str = '') -> Iterator[Case]:
    """`count` cases of a seed; with `only`, single effects of that name."""
    plan = np.random.default_rng([seed, 0])
    decks = {
        'effects': _shuffled(plan, generator.AXIS_EFFECTS + generator.GLOBAL_EFFECTS),
        'mechanisms': _shuffled(plan, generator.MECHANISMS),
    }
    kinds = _kinds(plan, count)
    for index in range(count):
        kind = 'single' if only else kinds[index]
        yield _draw_case(generator, seed, index, kind, decks, only)


def _kinds(rng: np.random.Generator, count: int) -> list[str]:
    """Kinds in their shares, in random order."""
    places = (np.arange(count) + rng.random()) / count
    bounds = np.cumsum(list(KINDS.values()))
    kinds = [list(KINDS)[int(np.searchsorted(bounds, place))] for place in places]
    return [kinds[i] for i in rng.permutation(count)]


def _shuffled(rng: np.random.Generator, names: tuple[str, ...]) -> Iterator[str]:
    """The names over and over, each time in another order."""
    while True:
        for index in rng.permutation(len(names)):
            yield names[index]


def _draw_case(
    generator: Generator,
    seed: int,
    index: int,
    kind: str,
    decks: dict[str, Iterator[str]],
    only: str,
) -> Case:
    rng = np.random.default_rng([seed, 1 + index])
    for attempt in itertools.count():
        # After some stages and paths on which the effects do not show, others are tried.
        if attempt % 4 == 0:
            effects = _effects(kind, decks, only)
        machine = draw_machine(rng)
        reference = draw_reference(rng, machine, float(rng.choice([30.0, 40.0, 60.0])))
        noise = int(rng.integers(2**31))
        if 'one_way' in reference.kinds and NEEDS_REVERSALS & set(effects):
            continue
        if kind == 'none':
            planted: list[Planted] = []
            gap: dict[str, float] = {}
            record = generator.simulate(machine, reference, planted, noise)
            if not _kept(record, machine):
                continue
        else:
            trial = _Trial(generator, machine, reference, noise, {})
            found = _plant(trial, rng, effects, kind == 'hidden')
            if found is None:
                continue
            planted, gap, record = found
        axes, tracker = _presence(rng, kind, planted)
        name = f'{index:03d}_' + '+'.join(p.name for p in planted) if planted else f'{index:03d}'
        label = {'none': '_none', 'hidden': '_hidden', 'unknown': '_unknown'}.get(kind, '')
        return Case(name + label, kind, machine, reference, planted, record, gap, axes, tracker)
    raise AssertionError('unreachable')


def _effects(kind: str, decks: dict[str, Iterator[str]], only: str) -> list[str]:
    if kind == 'none':
        return []
    if kind == 'unknown':
        return [next(decks['mechanisms'])]
    if only:
        return [only]
    first = next(decks['effects'])
    while kind == 'hidden' and first in RECORDED_ONLY + ('controller_mismatch',):
        first = next(decks['effects'])
    if kind != 'pair':
        return [first]
    second = next(n for n in decks['effects'] if n != first and not {n, first} <= WHOLE)
    return [first, second]


def _alike(one: str, other: str) -> bool:
    """Whether two effects are one, or of one family."""
    return one == other or any({one, other} <= family for family in FAMILIES)


@dataclass
class _Trial:
    """A stage and a path on which effects are tried; each different run is simulated once."""

    generator: Generator
    machine: Machine
    reference: Reference
    noise: int
    runs: dict[tuple[tuple[str, float], ...], Record]

    def run(self, planted: list[Planted], key: tuple[tuple[str, float], ...]) -> Record:
        """The session with what is planted; `key` are effects and sizes."""
        if key not in self.runs:
            self.runs[key] = self.generator.simulate(
                self.machine, self.reference, planted, self.noise
            )
        return self.runs[key]


def _plant(
    trial: _Trial, rng: np.random.Generator, effects: list[str], hidden: bool
) -> tuple[list[Planted], dict[str, float], Record] | None:
    """Effects strong enough to be seen each beside the others, or `None`."""
    axes = _axes_of(rng, trial.reference, effects)
    sizes = [0.005 if hidden else 1.0] * len(effects)
    # The structure of an effect stays while its strength is raised.
    seeds = rng.integers(2**31, size=len(effects))
    for _attempt in range(ATTEMPTS):
        groups = [
            trial.generator.draw(
                np.random.default_rng(seed),
                effect,
                Wish(trial.machine, trial.reference, axis, size),
            )
            for effect, axis, size, seed in zip(effects, axes, sizes, seeds, strict=True)
        ]
        planted = [p for group in groups for p in group]
        key = tuple(zip(effects, sizes, strict=True))
        record = trial.run(planted, key)
        if not _kept(record, trial.machine):
            return None
        gap: dict[str, float] = {}
        weak = False
        for i, group in enumerate(groups):
            rest = [p for other in groups if other is not group for p in other]
            bare = trial.run(rest, key[:i] + key[i + 1 :])
            gap[group[0].name] = change = _change(record, bare, trial.machine)
            factor = _resize(group[0].effect, change, hidden)
            sizes[i] *= factor
            weak = weak or factor != 1.0
        if not weak:
            return planted, gap, record
    return None


def _axes_of(rng: np.random.Generator, reference: Reference, effects: list[str]) -> list[int]:
    """Axes of the effects: ones that move, and different ones for effects of a family."""
    moving = [i for i in range(2) if np.ptp(reference.position[:, i]) > 1e-4]
    axis = int(rng.choice(moving))
    apart = rng.random() < 0.5 or _alike(effects[0], effects[-1])
    return [axis, (axis + int(apart)) % 2][: len(effects)]


def _resize(effect: str, change: float, hidden: bool) -> float:
    """Factor on the size of an effect that changed a session by so many floors; 1 if it fits."""
    if hidden:
        return 0.3 if change > HIDES else 1.0
    if effect in RECORDED_ONLY or change >= SHOWS:
        return 1.0
    return float(np.clip(1.3 * SHOWS / max(change, 1e-9), 1.4, 2.5))


def _kept(record: Record, machine: Machine) -> bool:
    """Whether the stage followed its path, and did not howl between its limits."""
    error = record.motor - record.reference
    if not np.all(np.isfinite(error)) or np.max(np.abs(error)) > LOST:
        return False
    limits = 0.98 * np.array([axis.force_limit for axis in machine.axes])
    if np.max(np.mean(np.abs(record.force) > limits, axis=0)) > HOWLING:
        return False
    speed = np.gradient(error, record.stamps, axis=0)
    fastest = np.max(np.abs(record.reference_velocity))
    return bool(np.max(np.std(speed, axis=0)) < 0.01 + 0.3 * fastest)


def _change(record: Record, bare: Record, machine: Machine) -> float:
    """Greatest RMS change of a channel between two runs of one noise, in its noise floors."""
    changes = [_encoder_change(record, bare, machine)]
    for axis in range(2):
        # A point stamped later is as good as one of a stage that is behind.
        speed = np.interp(record.tracker_stamps, record.stamps, record.reference_velocity[:, axis])
        difference = record.tracker[:, axis] - bare.tracker[:, axis]
        difference -= speed * (record.tracker_stamps - bare.tracker_stamps)
        changes.append(_rms(difference) / machine.tracker_noise)
    return round(float(max(changes)), 3)


def _encoder_change(record: Record, bare: Record, machine: Machine) -> float:
    """The same of the encoders alone, by what they say and by what the carriages really do.

    Two independent roundings differ by 1.4 floors without any effect.
    """
    changes = []
    for axis in range(2):
        resolution = machine.axes[axis].encoder_resolution
        floor = np.hypot(resolution / np.sqrt(12.0), machine.encoder_noise[axis])
        for one, other in ((record.motor, bare.motor), (record.encoder, bare.encoder)):
            changes.append(_rms(one[:, axis] - other[:, axis]) / floor / 1.4)
    return max(changes)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _presence(rng: np.random.Generator, kind: str, planted: list[Planted]) -> tuple[int, bool]:
    """How many axes and whether a tracker the bag has: some sessions that can miss it do."""
    effects = {p.effect for p in planted}
    if kind == 'unknown' or effects & NEEDS_BOTH:
        return 2, True
    on_x = all(p.axis == 'x' for p in planted)
    axes = 1 if on_x and rng.random() < 0.12 else 2
    return axes, bool(effects & NEEDS_TRACKER) or rng.random() > 0.1


def write_case(case: Case, folder: Path) -> None:
    """Writes `bag`, `twin.yaml` and, last, `truth.json` into the folder."""
    write_bag(case.record, folder / 'bag', case.axes, case.tracker)
    twin = case.machine.twin(case.axes, case.tracker)
    (folder / 'twin.yaml').write_text(yaml.safe_dump(twin, sort_keys=False))
    (folder / 'truth.json').write_text(json.dumps(truth(case), indent=1) + '\n')


def truth(case: Case) -> dict[str, object]:
    """What the case holds: see `README.md` beside this file for the keys."""
    planted = case.planted
    shown = [] if case.kind in ('none', 'hidden') else planted
    names = ['unknown'] if case.kind == 'unknown' else [p.name for p in shown]
    return {
        'kind': case.kind,
        'truth': names,
        'also_right': also_right(planted, case.kind),
        'planted': [
            {'name': p.name, 'parameters': p.parameters, 'shape': p.shape} for p in planted
        ],
        'gap_over_floor': case.gap,
        'motion': list(case.reference.kinds),
        'session': {
            'seconds': len(case.reference.position) * case.machine.control_period,
            'axes': case.axes,
            'tracker': case.tracker,
            'encoder_noise': case.machine.encoder_noise,
            'stamp_jitter': case.machine.stamp_jitter,
        },
    }


def _instead(one: Planted, planted: list[Planted]) -> tuple[str, ...]:
    """Effects that no such data can tell from a planted one, beside the others."""
    constant = {p.effect for p in planted if p.axis == one.axis} & CONSTANT
    # The half difference of two levels is a constant force, which is one of the other.
    symmetric = one.effect == 'asymmetric_friction' and constant
    return (*one.instead, 'coulomb_friction') if symmetric else one.instead


def also_right(planted: list[Planted], kind: str) -> list[list[str]]:
    """Whole verdicts that are as right as the truth: every way to name each planted effect."""
    if kind == 'unknown':
        return []
    if kind == 'hidden':
        return [sorted({p.name for p in planted})]
    ways = []
    for p in planted:
        with_companions = [
            [p.name, *(p.named(c) for c in chosen)]
            for size in range(len(p.companions) + 1)
            for chosen in itertools.combinations(p.companions, size)
        ]
        ways.append(with_companions + [[p.named(other)] for other in _instead(p, planted)])
    names = {
        tuple(sorted({n for way in ways_of_all for n in way}))
        for ways_of_all in itertools.product(*ways)
    }
    names.discard(tuple(sorted({p.name for p in planted})))
    return [list(one) for one in sorted(names)]
