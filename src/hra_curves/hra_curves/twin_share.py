"""Table 5 of paper 4 on a twin: the share of the definition error in the stage's total error.

The twin (`ros_ws/config/twin_nanopla.yaml`) has the uncertainty budget of the paper's Table 2; how
far it keeps it is measured (`measured_uncertainty`). The defined curves are driven through it,
stopped at the paper's trajectory points, and read by its tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from hra_curves.cycloid import cycloid, nearest_points
from hra_curves.peers import Evaluator, chord_length_spline
from hra_curves.tables import BASIS_1, BASIS_2, TURN, hra_cycloid
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile

METHODS = ('IB1', 'CAM', 'IB2', 'linear')
DATA = 11
TRAVEL = 0.05  # m, working range of the paper's stage along each axis
READOUT_PERIOD = 0.12  # s, Section 7
SETTLING = 1.0  # s; the slowest closed-loop pole of the shipped twin decays in 0.1 s
# Data interval plus the fraction of it. The paper does not say where its points lie: these are
# chosen for its definition errors, which they give with the CAM entries of TP1 and TP2 exchanged.
STOPS = (0.47, 0.61, 1.35, 1.45)


@dataclass(frozen=True)
class Printed:
    """An entry of the paper's Table 5, micrometres; ``definition`` is the text as printed."""

    definition: str
    system: float
    deviation: float

    @property
    def share(self) -> float:
        """Share of the squared definition error in the sum of it and the stage's."""
        definition = float(self.definition)
        return definition**2 / (definition**2 + self.system**2 + self.deviation**2)


PRINTED = {
    'IB1': (
        Printed('0.04', 0.01, 0.16),
        Printed('0.03', 0.01, 0.19),
        Printed('0.007', 0.02, 0.22),
        Printed('0.007', 0.02, 0.31),
    ),
    'CAM': (
        Printed('3.1', 0.02, 0.21),
        Printed('3.8', 0.00, 0.13),
        Printed('4.5', 0.01, 0.32),
        Printed('4.5', 0.01, 0.16),
    ),
}


@dataclass(frozen=True)
class Hold:
    """A trajectory point held by the twin: lengths in metres, along the definition error.

    ``system`` is the mean size of the holds' mean error, ``deviation`` the standard deviation
    within a hold, ``total`` the root mean square of stage and definition together, ``share`` that
    of the squared definition error in the sum of it and the mean squared error of the stage.
    """

    name: str
    method: str
    paper: Printed | None
    definition: float
    system: float
    deviation: float
    total: float
    share: float


@dataclass(frozen=True)
class Drive:
    """A whole curve driven: distances to the cycloid in metres, ``share`` of mean squares."""

    method: str
    largest_definition: float
    definition: float
    total: float
    share: float


def default_twin() -> Path:
    """The shipped twin file, in a checkout or beside the installed packages.

    Raises
    ------
    StageError
        If it is in neither place.
    """
    name = 'twin_nanopla.yaml'
    for base in Path(__file__).resolve().parents:
        for folder in (base / 'ros_ws' / 'config', base / 'share' / 'stage_bringup' / 'config'):
            if (folder / name).is_file():
                return folder / name
    raise StageError(f'{name} is not beside the packages: give its place with --twin')


def _simulate(
    twin: TwinFile, reference: Array, velocity: Array, readouts: Array, seed: int
) -> Array:
    """Tracker's points (m, 2) at the instants ``readouts`` (m,) s of a session."""
    try:
        from stage_twin.simulate import simulate
    except ImportError as error:
        raise StageError(
            f'table5 needs the package stage_twin ({error}): build it, or put src/stage_twin '
            'on PYTHONPATH'
        ) from None
    result = simulate(twin, reference, velocity, seed=seed, tracker_times=readouts)
    return result.tracker_points[:, :2]


def measured_uncertainty(twin: TwinFile, places: int = 1000, seed: int = 5) -> Array:
    """Expanded uncertainty (k = 2) of the stage per axis, (2,) metres.

    Twice the root mean square of tracker minus reference over ``places`` random positions of the
    working range, each held for 2 s after it has settled: what is constant during a hold
    (resolution, geometry) and what is not (noise), as Table 2 of paper 4 adds them.
    """
    generator = np.random.default_rng(seed)
    readouts = np.arange(SETTLING, SETTLING + 2.0, READOUT_PERIOD)
    ticks = round((SETTLING + 2.0) / twin.control_period)
    squares = np.zeros(2)
    for place in generator.uniform(0.0, TRAVEL, (places, 2)):
        reference = np.tile(place, (ticks, 1))
        points = _simulate(
            twin, reference, np.zeros_like(reference), readouts, int(generator.integers(2**31))
        )
        squares += ((points - place) ** 2).mean(axis=0)
    return 2.0 * np.sqrt(squares / places)


def defined_curve(method: str) -> Evaluator:
    """Curve through the eleven data; its parameter counts the data intervals, from 0 to 10."""
    theta = np.linspace(0.0, TURN, DATA)
    places = np.arange(DATA, dtype=float)
    if method == 'linear':
        return make_interp_spline(places, cycloid(theta), k=1)
    if method == 'CAM':
        nodes, spline = chord_length_spline(cycloid(theta))
        return lambda u: spline(np.interp(u, places, nodes))
    curve = hra_cycloid(cycloid(theta), BASIS_1 if method == 'IB1' else BASIS_2)
    return lambda u: curve.evaluate(np.interp(u, places, theta))


def definition_error(method: str, u: Array) -> Array:
    """Vectors (m, 2) from the cycloid to the defined curve at parameters u (m,), metres.

    IB1 and IB2 are compared at equal angle, curves that know none with the nearest point.
    """
    points = defined_curve(method)(u)
    if method in ('IB1', 'IB2'):
        return points - cycloid(u * TURN / (DATA - 1))
    return points - nearest_points(points)


@dataclass(frozen=True)
class Session:
    """Reference of a session: positions and velocities (n, 2), parameters u (n,), holds' starts.

    ``starts`` are the instants (s) at which each stop is reached; before, between and after
    them the stage moves.
    """

    reference: Array
    velocity: Array
    parameters: Array
    starts: Array


def plan(curve: Evaluator, period: float, hold: float, speed: float) -> Session:
    """Drive a curve from end to end with a hold (s) at each of `STOPS`.

    Between stops the speed along the curve rises to ``speed`` (m/s) and falls as a raised cosine.
    """
    u = np.linspace(0.0, DATA - 1.0, 20001)
    steps = np.linalg.norm(np.diff(curve(u), axis=0), axis=1)
    lengths = np.concatenate(([0.0], np.cumsum(steps)))
    stops = np.interp([0.0, *STOPS, DATA - 1.0], u, lengths)
    pieces: list[Array] = []
    starts = []
    count = 0
    for first, last in zip(stops[:-1], stops[1:], strict=True):
        ticks = max(round(2.0 * (last - first) / speed / period), 1)
        phase = np.arange(ticks) / ticks
        rise = phase - np.sin(2.0 * np.pi * phase) / (2.0 * np.pi)
        still = np.full(round((SETTLING + hold) / period), last)
        pieces += [first + (last - first) * rise, still]
        starts.append((count + ticks) * period)
        count += ticks + still.size
    parameters = np.interp(np.concatenate(pieces), lengths, u)
    reference = curve(parameters)
    velocity = np.gradient(reference, period, axis=0)
    return Session(reference, velocity, parameters, np.array(starts[:-1]))


def table5(
    twin: TwinFile,
    placings: int = 50,
    hold: float = 3.0,
    speed: float = 1e-3,
    methods: Sequence[str] = METHODS,
    seed: int = 5,
) -> tuple[list[Hold], list[Drive]]:
    """Share of the definition error in the total positioning error on a twin (Table 5, Eq. 15).

    Parameters
    ----------
    placings : how often each curve is driven, its origin at random in the working range, so that
        resolution and geometry show with their distribution and not with one value.
    hold, speed : seconds at each stop, metres per second along the curve.

    Returns
    -------
    Rows of the stops, and of the curves while driven.

    Raises
    ------
    StageError
        If the twin is not one of two servo axes, or stage_twin cannot be imported.
    """
    for axis in ('x', 'y'):
        twin.servo(axis)
    generator = np.random.default_rng(seed)
    extent = np.array([TURN, 2.0]) * 1e-3
    origins = generator.uniform(0.0, TRAVEL - extent, (placings, 2))
    readouts = np.arange(SETTLING, SETTLING + hold, READOUT_PERIOD)
    holds: list[Hold] = []
    drives: list[Drive] = []
    for method in methods:
        session = plan(defined_curve(method), twin.control_period, hold, speed)
        ticks = np.arange(session.parameters.size)
        moving = ticks[:-1][np.diff(session.parameters) > 0.0][::10]
        moments = [(session.starts[:, None] + readouts).ravel(), moving * twin.control_period]
        stops, squares = [], 0.0
        for origin in origins:
            points = _simulate(
                twin,
                session.reference + origin,
                session.velocity,
                np.concatenate(moments),
                int(generator.integers(2**31)),
            )
            points -= origin
            path = points[moments[0].size :]
            stops.append(points[: moments[0].size].reshape(len(STOPS), readouts.size, 2))
            squares += float(((path - nearest_points(path)) ** 2).sum(axis=1).mean()) / placings
        holds += _holds(method, np.array(stops))
        drives.append(_drive(method, session.reference[moving], squares))
    return holds, drives


def _holds(method: str, points: Array) -> list[Hold]:
    """Rows of the stops from points (placings, stops, readouts, 2) [m], their origin taken off."""
    places = np.array(STOPS)
    vectors = definition_error(method, places)
    sizes = np.linalg.norm(vectors, axis=1)
    still = points - defined_curve(method)(places)[:, None]
    errors = np.einsum('pkrc,kc->kpr', still, vectors / sizes[:, None])
    return [
        Hold(
            f'TP{index + 1}',
            method,
            PRINTED[method][index] if method in PRINTED else None,
            float(definition),
            float(np.abs(error.mean(axis=1)).mean()),
            float(np.sqrt(error.var(axis=1).mean())),
            float(((definition + error) ** 2).mean()) ** 0.5,
            float(definition**2 / (definition**2 + (error**2).mean())),
        )
        for index, (definition, error) in enumerate(zip(sizes, errors, strict=True))
    ]


def _drive(method: str, reference: Array, squares: float) -> Drive:
    """Row of a driven curve: its reference (m, 2) and the mean square of the whole error [m²]."""
    distances = np.linalg.norm(reference - nearest_points(reference), axis=1)
    mean_square = float((distances**2).mean())
    return Drive(
        method,
        float(distances.max()),
        mean_square**0.5,
        squares**0.5,
        mean_square / squares,
    )
