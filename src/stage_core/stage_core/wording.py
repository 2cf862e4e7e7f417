"""Numbers and names as a person reads them: units, digits that fit an interval, effects."""

from __future__ import annotations

import math
import time

from stage_core.quantities import split_effect

#: Unit -> (largest magnitude, factor, symbol), the first that fits is taken.
_SCALES: dict[str, tuple[tuple[float, float, str], ...]] = {
    'm': ((1e-3, 1e6, 'µm'), (1.0, 1e3, 'mm'), (math.inf, 1.0, 'm')),
    'rad': ((1e-2, 1e6, 'µrad'), (math.inf, 1.0, 'rad')),
    's': ((1e-3, 1e6, 'µs'), (1.0, 1e3, 'ms'), (math.inf, 1.0, 's')),
    'm/s': ((1.0, 1e3, 'mm/s'), (math.inf, 1.0, 'm/s')),
    'm/m': ((math.inf, 1e6, 'µm/m'),),
    '1/K': ((math.inf, 1e6, 'µm/(m·K)'),),
    's/s': ((math.inf, 1e6, 'µs/s'),),
    '1': ((math.inf, 1.0, ''),),
}

#: Stamps before this (s since 1970, September 2001) count from another zero: simulated time.
FIRST_DATE = 1_000_000_000

#: Names of persons inside the names of effects.
_PERSONS = ('coulomb', 'stribeck')


def effect_words(name: str) -> str:
    """An effect in words: ``coulomb_friction.x`` is *Coulomb friction of x*."""
    effect, axis = split_effect(name)
    words = [w.title() if w in _PERSONS else w for w in effect.split('_')]
    return ' '.join([*words, *([] if axis is None else ['of', axis])])


def parameter_name(name: str) -> str:
    """A parameter of an effect in words: ``amplitude_2`` is *amplitude of harmonic 2*."""
    kind, _, number = name.rpartition('_')
    return f'{kind} of harmonic {number}' if number.isdigit() else name.replace('_', ' ')


def scaled(magnitude: float, unit: str) -> tuple[float, str]:
    """Factor and symbol in which a value of this magnitude and SI unit is written."""
    for largest, factor, symbol in _SCALES.get(unit, ((math.inf, 1.0, unit),)):
        if abs(magnitude) < largest:
            return factor, symbol
    return 1.0, unit


def measure(value: float, unit: str = 'm', digits: int = 3) -> str:
    """A value with its unit and so many significant digits: ``measure(9.27e-7)`` is 0.927 µm."""
    factor, symbol = scaled(value, unit)
    return f'{_plain(factor * value, _places(factor * value, digits))} {symbol}'.strip()


def with_std(value: float, std: float, unit: str = 'm') -> str:
    """A value beside its standard deviation, both to the digits that the deviation allows.

    ``with_std(7.977e-6, 5e-8)`` is *7.98 ± 0.05 µm*.
    """
    if not std > 0.0 or not math.isfinite(std):
        return measure(value, unit)
    factor, symbol = scaled(max(abs(value), std), unit)
    value, std = factor * value, factor * std
    places = _known_places(std)
    return f'{_plain(value, places)} ± {_plain(std, places)} {symbol}'.strip()


def rounded(value: float, std: float) -> float:
    """A value to the digits that its standard deviation allows: -6.58 ± 8 is -7."""
    return round(value, _known_places(std)) if std > 0.0 and math.isfinite(std) else value


def _known_places(std: float) -> int:
    """Decimal places of a deviation above zero, and so of its value."""
    # Two digits where the first one is a 1: one digit would be off by up to half of it.
    digits = 2 if std / 10.0 ** math.floor(math.log10(std)) < 1.95 else 1
    return _places(std, digits)


def with_interval(value: float, low: float, high: float, unit: str = 'm') -> str:
    """A value and its 95 % interval: *0.93 µm (95 %: 0.68 to 1.46 µm)*."""
    factor, symbol = scaled(high, unit)
    # An interval of no width asks for no digits.
    places = _places(factor * max(high - low, 0.01 * abs(value)), 2)
    v, a, b = (_plain(factor * x, places) for x in (value, low, high))
    return f'{v} {symbol} (95 %: {a} to {b} {symbol})'


def date_words(stamp: int) -> str:
    """The local date and time of a stamp [ns]; empty where it is one of simulated time."""
    seconds = stamp // 1_000_000_000
    known = seconds > FIRST_DATE
    return time.strftime('%Y-%m-%d %H:%M', time.localtime(seconds)) if known else ''


def span(low: float, high: float, unit: str, places: int = 0) -> str:
    """A range in the unit given, one value where both are equal: *−40 to 40 mm*."""
    a, b = _plain(low, places), _plain(high, places)
    return f'{a} {unit}' if a == b else f'{a} to {b} {unit}'


def _places(value: float, digits: int) -> int:
    """Decimal places that show so many significant digits."""
    if value == 0.0 or not math.isfinite(value):
        return 0
    return digits - 1 - math.floor(math.log10(abs(float(f'{value:.{digits - 1}e}'))))


def _plain(value: float, places: int) -> str:
    """A number without an exponent, with a true minus sign."""
    text = f'{round(value, places):.{max(places, 0)}f}'
    return text.replace('-', '\u2212') if float(text) else text.replace('-', '')
