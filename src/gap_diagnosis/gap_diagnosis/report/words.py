"""The words of the page for what `report.json` names by keys."""

from __future__ import annotations

from gap_diagnosis.evidence.localise import Condition

_CONDITIONS = {
    'reversal': 'side of approach',
    'screw_phase': 'place within a turn of the screw',
    'position': 'position',
    'cross_axis': 'position of the other axis',
    'speed': 'speed',
    'time': 'time',
    'temperature': 'temperature',
    'frequency_band': 'a band of frequencies',
    'acceleration': 'acceleration',
}
_LINKS = {
    'servo': 'the servo loop',
    'kinematic': 'the way from the motor to the table',
    'sensor': 'the sensors',
}
_STATUS = {
    'accepted': 'accepted',
    'rejected': 'rejected',
    'below_noise': 'too small to tell',
}
#: Some hundred sessions cannot show more.
_SUREST = 0.99


def probability_words(probability: float) -> str:
    """A probability to two digits, never 1."""
    return f'{min(probability, _SUREST):.2f}'


def condition_words(condition: Condition) -> str:
    """*x: side of approach (the servo loop)*."""
    name = _CONDITIONS.get(condition.name, condition.name.replace('_', ' '))
    return f'{condition.axis}: {name} ({link_words(condition.link)})'


def link_words(link: str) -> str:
    """A link of the chain from command to measurement."""
    return _LINKS.get(link, link)


def status_words(status: str) -> str:
    """What became of a candidate."""
    return _STATUS.get(status, status.replace('_', ' '))
