"""Parameters of effects as they are found: each a value with its standard deviation."""

from __future__ import annotations

Estimates = dict[str, tuple[float, float]]
"""Of one effect, by their names."""
Parameters = dict[str, Estimates]
"""Of effects, by the names of these."""


def plain_values(parameters: Parameters) -> dict[str, dict[str, float]]:
    """Parameters without their standard deviations."""
    return {n: {k: v for k, (v, _) in p.items()} for n, p in parameters.items()}
