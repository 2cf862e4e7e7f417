"""What a session without recorded forces tells of the drive, and what it cannot tell."""

from __future__ import annotations

from typing import Any

from gap_diagnosis.evidence.describe import not_seen
from gap_diagnosis.residuals.without_forces import NOT_TOLD, lost_drive
from gap_diagnosis.result import Diagnosis
from stage_core.pages import Page
from stage_core.quantities import split_effect
from stage_core.wording import effect_words, measure
from stage_twin.effects import effect_of, link_of

#: Units whose quantities are measured over the mass, and what is measured.
_OVER_MASS = {'N': 'm/s²', 'N·s/m': '1/s', 'N/m': '1/s²', 'N/m³': '1/(m·s)²'}


def not_identifiable(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Effects that only a recorded force would show, and parameters that nothing shows."""
    return [
        {'effect': f'{effect}.{axis}', 'reason': f'no effort recorded: {reason}'}
        for axis in diagnosis.drives
        for effect, reason in NOT_TOLD.items()
    ] + [
        {'effect': name, 'parameter': parameter, 'reason': 'the session shows none of it'}
        for name in diagnosis.accepted
        for parameter in not_seen(name, diagnosis.parameters[name])
    ]


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """The fitted controllers and the effects' parameters, all over the mass."""
    drives: dict[str, Any] = {}
    for axis, law in diagnosis.drives.items():
        gains, mass = law.gains, diagnosis.twin.servo(axis).mass
        if not law.known:
            drives[axis] = {'known': False}
            continue
        drives[axis] = {
            'known': True,
            'position_gain': {'value': gains.position_gain, 'unit': '1/s'},
            'velocity_feedforward': {'value': gains.velocity_feedforward, 'unit': ''},
            'velocity_gain_over_mass': {'value': gains.velocity_gain / mass, 'unit': '1/s'},
            'integral_gain_over_mass': {'value': gains.integral_gain / mass, 'unit': '1/s²'},
            'velocity_filter': {'value': gains.velocity_filter, 'unit': 'rad/s'},
        }
    over_mass = [
        {'effect': effect, 'parameter': name, 'value': value, 'std': std, 'unit': unit}
        for effect, name, value, std, unit in _over_mass(diagnosis)
    ]
    return {'controllers': drives, 'over_mass': over_mass}


def _over_mass(diagnosis: Diagnosis) -> list[tuple[str, str, float, float, str]]:
    found = []
    for name in diagnosis.accepted:
        axis = split_effect(name)[1]
        if link_of(name) != 'servo' or axis not in diagnosis.drives:
            continue
        mass = diagnosis.twin.servo(axis).mass
        for parameter in effect_of(name).parameters:
            if parameter.unit in _OVER_MASS and parameter.name in diagnosis.parameters[name]:
                value, std = diagnosis.parameters[name][parameter.name]
                unit = _OVER_MASS[parameter.unit]
                found.append((name, parameter.name, value / mass, std / mass, unit))
    return found


def section(page: Page, diagnosis: Diagnosis) -> None:
    """What the gains are, what is measured over the mass, and what cannot be told."""
    if not diagnosis.drives:
        return
    page.heading('Without forces')
    page.text(
        'The session holds no effort. The controller was fitted to reference, velocity command '
        'and encoder, and the deviation of its gains widens the intervals of forces. Only '
        "force over mass shows in a motion: newtons on this page are those for the twin's mass."
    )
    rows = [
        [
            axis,
            f'{law.gains.position_gain:.4g} 1/s',
            f'{law.gains.velocity_gain / diagnosis.twin.servo(axis).mass:.4g} 1/s',
            f'{law.gains.integral_gain / diagnosis.twin.servo(axis).mass:.4g} 1/s²',
            f'{law.gains.velocity_filter:.4g} rad/s',
        ]
        for axis, law in diagnosis.drives.items()
        if law.known
    ]
    if rows:
        page.table(
            ['axis', 'position gain', 'velocity gain / mass', 'integral gain / mass', 'filter'],
            rows,
            'the controller as the session shows it',
        )
    over = [
        [effect_words(e), n, measure(v, u), measure(s, u)]
        for e, n, v, s, u in _over_mass(diagnosis)
    ]
    if over:
        page.table(['effect', 'parameter', 'over the mass', '1 σ'], over, 'what is measured')
    lost = [axis for axis, law in diagnosis.drives.items() if not law.known]
    page.items(
        [
            f'Axis {axis}: {lost_drive(diagnosis.records)}. Its servo link is not judged, and its '
            'encoder has no figures.'
            for axis in lost
        ]
        + [
            f'Cannot be told without forces: {", ".join(effect_words(e) for e in NOT_TOLD)}. '
            'Record the effort to tell them.'
        ]
    )
