"""Curves that come as YAML text: checked whole before one is made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import hra_curves
from contour_ctrl import curves, nurbs
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.names import refuse_unknown_keys
from stage_core.untrusted import yaml_mapping

#: Keys of a curve by the kind of contour that it is given for.
KEYS = {
    'nurbs': ('degree', 'knots', 'control_points', 'weights'),
    'freeform': ('points', 'closed'),
    'hra': ('points', 'basis'),
}
KINDS = tuple(KEYS)


def from_text(kind: str, text: str, origin: str) -> curves.Curve:
    """Curve of a YAML text.

    Parameters
    ----------
    kind
        ``nurbs`` (degree, knots, control_points [m], weights), ``freeform`` (points [m], closed)
        or ``hra`` (points [m], basis).
    text, origin
        The text, and what errors call it.

    Raises
    ------
    StageError
        What is wrong with it; the message names the key or the number of the point.
    """
    remedy = 'give points as a list of [x, y] in metres under the key points'
    if kind == 'nurbs':
        remedy = 'give degree, knots, control_points and, if wanted, weights'
    content = yaml_mapping(text, origin, remedy)
    refuse_unknown_keys(content, KEYS[kind], origin)
    if kind == 'nurbs':
        return _nurbs(content, origin, remedy)
    try:
        points = point_list(content.get('points'))
    except StageError as error:
        raise StageError(f'{origin}: {error}: {remedy}') from None
    return _through(kind, points, content, origin)


def _nurbs(content: Mapping[Any, Any], origin: str, remedy: str) -> nurbs.NurbsCurve:
    missing = [key for key in KEYS['nurbs'][:3] if key not in content]
    if missing:
        raise StageError(f'{origin}: the key {missing[0]} is missing: {remedy}')
    weights = content.get('weights')
    try:
        return nurbs.NurbsCurve(
            int(content['degree']),
            np.asarray(content['knots'], dtype=float),
            np.asarray(content['control_points'], dtype=float),
            None if weights is None else np.asarray(weights, dtype=float),
        )
    except (TypeError, ValueError) as error:
        raise StageError(f'{origin} is not made of numbers ({error}): correct it') from None
    except StageError as error:
        raise StageError(f'{origin}: {error}') from None


def _through(kind: str, points: Array, content: Mapping[Any, Any], origin: str) -> curves.Curve:
    if kind == 'freeform':
        closed = content.get('closed', True)
        if not isinstance(closed, bool):
            raise StageError(f'{origin}: closed must be true or false, got {closed!r}')
        return nurbs.interpolate(points, closed)
    name = content.get('basis')
    if name is None:
        return hra_curves.interpolate(points)
    return hra_curves.interpolate(points, basis=hra_curves.basis_named(str(name)))


def point_list(given: Any) -> Array:
    """Points (n, 2) [m] of a list; the first point has the number 1.

    Raises
    ------
    StageError
        If it is no list, or a point is not two finite numbers; the message has its number.
    """
    if not isinstance(given, Sequence) or isinstance(given, str) or not given:
        raise StageError(f'points must be a list of points, got {str(given)[:40]!r}')
    for number, point in enumerate(given, 1):
        if not (isinstance(point, Sequence) and len(point) == 2 and all(map(_finite, point))):
            raise StageError(
                f'point {number} of {len(given)} must be two finite numbers, got {str(point)[:40]}'
            )
    return np.asarray(given, dtype=float)


def _finite(value: Any) -> bool:
    # YAML 1.1 reads 1e-3 (no dot) as text.
    try:
        return not isinstance(value, bool) and math.isfinite(float(value))
    except (TypeError, ValueError):
        return False
