"""Parameters of effects as they are found: each a value with its standard deviation."""

from __future__ import annotations

from collections.abc import Mapping

Estimates = dict[str, tuple[float, float]]
"""Of one effect, by their names."""
Parameters = dict[str, Estimates]
"""Of effects, by the names of these."""
Effects = Mapping[str, Mapping[str, float]]
"""Their values alone, as a twin file holds them."""


def plain_values(parameters: Parameters) -> dict[str, dict[str, float]]:
    """Parameters without their standard deviations."""
    return {n: {k: v for k, (v, _) in p.items()} for n, p in parameters.items()}
