"""The suites of the blind check: which cases, how many, and what the session lacks."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.blind.cases import COMMON, GEOMETRY, REPORT_SEEDS, SERVO, Case, draw, draw_single

#: Seeds of a suite start at this many times its number.
SPACING = 10_000
FRESH_SHIFT = 7_000_000  # between the seeds of a case and of another session of its machine
LONG = 1800.0  # s

#: Effects in the order in which the leave-one-out suite takes them out of the library.
EFFECTS = (*SERVO, *GEOMETRY, 'angular_error', *COMMON)

#: What goes out of the library together with an effect, because it holds it as a special case or
#: adds up to it exactly: a Stribeck friction without breakaway is a Coulomb friction, Coulomb
#: friction with an offset is an asymmetric one. Everything else must not stand in for it.
SAME: dict[str, tuple[str, ...]] = {
    'coulomb_friction': ('asymmetric_friction', 'stribeck_friction'),
    'viscous_friction': ('asymmetric_friction',),
    'asymmetric_friction': (
        'coulomb_friction', 'stribeck_friction', 'viscous_friction', 'force_offset',
    ),
    'stribeck_friction': ('coulomb_friction', 'asymmetric_friction'),
    'force_offset': ('cable_force', 'asymmetric_friction'),
    'cable_force': ('force_offset',),
    'inertia_mismatch': ('drive_gain',),
    'drive_gain': ('inertia_mismatch', 'viscous_friction'),
    'scale_error': ('thermal_expansion', 'angular_error'),
    'thermal_expansion': ('scale_error',),
}  # fmt: skip

#: Suite -> number of cases in the report. `leave_one_out` goes through all effects in turn.
SIZES: dict[str, int] = {
    'main': 200,
    'leave_one_out': len(EFFECTS),
    'no_tracker': 8,
    'no_temperature': 8,
    'one_axis': 8,
    'rate_100': 6,
    'rate_250': 6,
    'rate_1000': 6,
    'minutes_30': 2,
}


def case(suite: str, number: int, seeds: str) -> Case:
    """Case `number` of a suite, from development or report seeds."""
    seed = number + SPACING * list(SIZES).index(suite)
    seed += REPORT_SEEDS if seeds == 'report' else 0
    if suite == 'leave_one_out':
        effect = EFFECTS[number % len(EFFECTS)]
        made = draw_single(number, seed, effect)
        return replace(made, suite=suite, without=(effect, *SAME.get(effect, ())))
    made = draw(
        number,
        seed,
        duration=LONG if suite == 'minutes_30' else 30.0,
        axes=('x',) if suite == 'one_axis' else None,
    )
    if suite.startswith('rate_'):
        made = replace(made, rate=float(suite.removeprefix('rate_')))
    return replace(
        made,
        suite=suite,
        tracker=suite != 'no_tracker',
        temperature=suite != 'no_temperature',
    )
