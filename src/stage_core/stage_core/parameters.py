"""Parameters of nodes: declared once with description, range and unit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

Value = bool | int | float | str | list[str] | list[float]


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node; `minimum` and `maximum` belong to the allowed range."""

    name: str
    default: Value
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False


#: Of a process that works tick by tick. Off by default: on a machine without processors to spare
#: nothing ordinary would run any more, neither the recorder nor who calls ~/stop.
THREAD_PRIORITY = Parameter(
    'thread_priority',
    0,
    'real time: SCHED_FIFO priority of all threads where the system permits it; 0: ordinary',
    minimum=0,
    maximum=49,
    read_only=True,
)


def check(parameter: Parameter, value: Any) -> str | None:
    """What is wrong with a value, with the remedy; None where it is fine."""
    kind = type(parameter.default)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, kind):
        return f'{parameter.name} must be of type {kind.__name__}, got {value!r}'
    if parameter.choices and value not in parameter.choices:
        return f'{parameter.name} must be one of {", ".join(parameter.choices)}, got {value!r}'
    numbers = value if isinstance(value, list) else [value]
    for number in numbers:
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            continue
        if not math.isfinite(number):
            return f'{parameter.name} must be finite, got {number}'
        low, high = parameter.minimum, parameter.maximum
        if (low is not None and number < low) or (high is not None and number > high):
            bounds = f'{"-inf" if low is None else low} ... {"inf" if high is None else high}'
            return f'{parameter.name} must lie in {bounds} {parameter.unit}, got {number}'.strip()
    return None
