"""Every parameter of the contour controller, and the objects that are made from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

from contour_ctrl import curve_file, curves, reinforcement, timed
from contour_ctrl.cmac import UPDATES, CmacSettings
from contour_ctrl.feedrate import AxisLimits
from contour_ctrl.friction import LuGre
from contour_ctrl.learning import LearningSettings
from contour_ctrl.reference import Reference, plan
from contour_ctrl.sequence import RunSettings
from contour_ctrl.tick import Gains
from stage_core.errors import StageError
from stage_core.parameters import THREAD_PRIORITY, Parameter
from stage_core.quantities import AXES
from stage_core.untrusted import file_text

Values = Callable[[str], Any]

#: A motion that is no contour: a table of times and positions in `curve_file`.
TIMED = 'timed'

BASES = ('p_ff', 'ccc', 'cccmac')
#: Feedback law, then what learns between the iterations.
SCHEMES = tuple(base + learning for base in BASES for learning in ('', '+ilc', '+rilc'))


def _axis_parameters(axis: str) -> list[Parameter]:
    velocity_gain, integral_gain = (
        gain[AXES.index(axis)] for gain in (Gains.velocity_gain, Gains.integral_gain)
    )
    return [
        Parameter(f'{axis}.position_gain', 40.0, 'K_p', '1/s', 1e-3, 1e4),
        Parameter(f'{axis}.velocity_feedforward', 1.0, 'K_f', '', 0.0, 2.0),
        Parameter(f'{axis}.acceleration_feedforward', 0.0, 'K_a', 's', 0.0, 1.0),
        Parameter(f'{axis}.ilc_gain', 40.0, 'L_initial of the learning', '1/s', 0.0, 1e3),
        Parameter(f'{axis}.max_velocity', 0.2, 'limit of the plan', 'm/s', 1e-6, 1e2),
        Parameter(f'{axis}.max_acceleration', 2.0, 'limit of the plan', 'm/s^2', 1e-4, 1e4),
        Parameter(f'{axis}.max_jerk', 500.0, 'limit of the plan', 'm/s^3', 1e-3, 1e7),
        Parameter(
            f'{axis}.velocity_gain',
            velocity_gain,
            "gain of the driver's velocity loop, for the friction term",
            'N.s/m',
            1e-6,
        ),
        Parameter(
            f'{axis}.integral_gain',
            integral_gain,
            "integral gain of the driver's velocity loop",
            'N/m',
            0.0,
        ),
        Parameter(f'{axis}.coulomb', 0.0, 'LuGre F_c; 0 is no friction term', 'N', 0.0),
        Parameter(f'{axis}.static', 0.0, 'LuGre F_s', 'N', 0.0),
        Parameter(f'{axis}.stribeck_velocity', 0.005, 'LuGre v_s', 'm/s', 1e-6),
        Parameter(f'{axis}.stiffness', 1e7, 'LuGre sigma_0', 'N/m', 1.0),
    ]


PARAMETERS: tuple[Parameter, ...] = (
    THREAD_PRIORITY,
    Parameter('contour', 'circle', 'what to follow', choices=(*curves.NAMES, TIMED)),
    Parameter('centre_x', 0.0, 'centre of the contour', 'm'),
    Parameter('centre_y', 0.0, 'centre of the contour', 'm'),
    Parameter('radius', 0.02, 'circle, star (outer points)', 'm', 1e-6),
    Parameter('clockwise', False, 'circle: the way round'),
    Parameter('inner_radius', 0.01, 'star (inner points)', 'm', 1e-6),
    Parameter('star_points', 5, 'star', '', 3, 50),
    Parameter('side', 0.04, 'square', 'm', 1e-6),
    Parameter('corner_radius', 0.002, 'square and star: least radius of curvature', 'm', 1e-7),
    Parameter('width', 0.05, 'eight', 'm', 1e-6),
    Parameter('height', 0.025, 'eight', 'm', 1e-6),
    Parameter(
        'curve_file', '', 'freeform, nurbs, hra: YAML; empty: the topic ~/curve; timed: CSV'
    ),
    Parameter('feed', 0.03, 'feed along the contour', 'm/s', 1e-6, 1e2),
    Parameter('reduce_feed', False, 'take the highest possible feed instead of refusing'),
    Parameter('path_acceleration', 0.5, 'of the ramps along the contour', 'm/s^2', 1e-4, 1e4),
    Parameter('path_jerk', 20.0, 'of the ramps along the contour', 'm/s^3', 1e-3, 1e7),
    Parameter('laps', 1, 'laps of a closed contour per iteration', '', 1, 1000),
    Parameter('iterations', 1, 'how often ~/run follows the contour', '', 1, 1000),
    Parameter('scheme', 'ccc', 'control scheme', choices=SCHEMES),
    Parameter(
        'control_rate', 1000.0, 'ticks per second; about 50 on a Zaber wire', 'Hz', 1.0, 2000.0
    ),
    Parameter('cross_coupling', 20.0, 'K_c of ccc and cccmac', '1/s', 0.0, 1e4),
    Parameter('estimator_steps', 2, 'of the contour error; 0 is the tangent', '', 0, 10),
    Parameter('cmac_update', CmacSettings.mode, 'reading of eq. 19', choices=UPDATES),
    Parameter('cmac_rate', CmacSettings.rate, 'gradient [1/s^2], literal [1/s]', '', 0.0),
    Parameter('cmac_layers', CmacSettings.layers, 'N_e', '', 1, 64),
    Parameter('cmac_cells', CmacSettings.cells, 'cells per layer and input', '', 2, 512),
    Parameter('cmac_limit', CmacSettings.limit, 'largest output of the CMAC', 'm/s', 1e-6),
    Parameter('ilc_cutoff', 25.0, 'of the zero-phase filter Q', 'Hz', 1e-3),
    Parameter('ilc_lead', 15, 'ticks by which the error is read ahead; eq. 26 has 0', '', 0, 1000),
    Parameter(
        'rilc_reading', 'recommended', 'reading of eqs. 12-16', choices=reinforcement.READINGS
    ),
    Parameter('rilc_floor', 0.2, 'smallest share of L_initial', '', 1e-3, 1.0),
    Parameter('divergence', 1.2, 'times the best RMS that is growth; 0 is off', '', 0.0),
    Parameter('start_tolerance', 1e-4, 'distance from the start to begin at', 'm', 1e-7),
    Parameter('approach_timeout', 30.0, 'to reach the start', 's', 0.1),
    Parameter(
        'missed_share', 0.05, 'ticks without a message that an iteration bears', '', 0.0, 1.0
    ),
    Parameter(
        'longest_step', 1e-3, 'way of the contour that may go by without a message', 'm', 1e-6
    ),
    Parameter('stop_time', 0.2, 'duration of a smooth stop', 's', 1e-3),
    Parameter('encoder_timeout', 0.5, 'silence of the encoder that ends a run', 's', 0.01),
    Parameter('lockstep_timeout', 20.0, 'the same on the wall clock in lockstep', 's', 0.1),
    Parameter('use_model', True, 'apply the active calibration model'),
    Parameter('machine', '', 'name of the stage that learned signals belong to'),
    Parameter(
        'session_folder', '', 'where learned signals are kept; empty is nowhere', read_only=True
    ),
    Parameter('reuse_learned', False, 'start from the signal in session_folder'),
    *(parameter for axis in AXES for parameter in _axis_parameters(axis)),
)


def _pair(value: Values, name: str) -> tuple[float, float]:
    return float(value(f'x.{name}')), float(value(f'y.{name}'))


def make_curve(value: Values, text: str | None = None) -> curves.Curve:
    """Make the contour; `text` is YAML that came by topic for the kinds that need a file.

    Raises
    ------
    StageError
        What is wrong with the parameters or the file.
    """
    kind = value('contour')
    centre = float(value('centre_x')), float(value('centre_y'))
    if kind == 'circle':
        return curves.circle(value('radius'), centre, value('clockwise'))
    if kind == 'square':
        return curves.square(value('side'), value('corner_radius'), centre)
    if kind == 'star':
        return curves.star(
            value('radius'),
            value('inner_radius'),
            value('corner_radius'),
            value('star_points'),
            centre,
        )
    if kind == 'eight':
        return curves.eight(value('width'), value('height'), centre)
    origin = value('curve_file') or 'the curve on the topic ~/curve'
    if value('curve_file'):
        text = file_text(origin, f'the curve {origin}', 'check the parameter curve_file')
    if text is None:
        raise StageError(
            f'the contour {kind} needs a curve: set curve_file or publish YAML on ~/curve'
        )
    return curve_file.from_text(kind, text, origin)


def check_curve(value: Values, text: str | None = None) -> None:
    """Make the curve or motion of a file or text, to say what is wrong before it is followed.

    Nothing is checked while the contour is of a kind that takes no curve.

    Raises
    ------
    StageError
        As `make_curve` and `make_timed`.
    """
    if value('contour') == TIMED and value('curve_file'):
        make_timed(value)
    if value('contour') in curve_file.KINDS and (value('curve_file') or text is not None):
        make_curve(value, text)


def make_reference(value: Values, curve: curves.Curve) -> Reference:
    """Plan the contour within the axes' limits."""
    return plan(
        curve,
        value('feed'),
        1.0 / value('control_rate'),
        _limits(value),
        value('path_acceleration'),
        value('path_jerk'),
        value('laps'),
        value('reduce_feed'),
    )


def make_timed(value: Values) -> Reference:
    """The motion of the table in `curve_file`, if the axes can follow it.

    Raises
    ------
    StageError
        What is wrong with the file.
    """
    path = value('curve_file')
    if not path:
        raise StageError('the contour timed needs a table: set curve_file')
    text = file_text(path, f'the motion {path}', 'check the parameter curve_file')
    return timed.from_text(text, path, 1.0 / value('control_rate'), _limits(value))


def _limits(value: Values) -> AxisLimits:
    return AxisLimits(
        _pair(value, 'max_velocity'), _pair(value, 'max_acceleration'), _pair(value, 'max_jerk')
    )


def make_gains(value: Values) -> Gains:
    """Gains of the scheme.

    Raises
    ------
    StageError
        If the friction of one axis alone is to be compensated, or is none of the model.
    """
    base = value('scheme').split('+')[0]
    settings = None
    if base == 'cccmac':
        settings = CmacSettings(
            value('cmac_layers'),
            value('cmac_cells'),
            value('cmac_rate'),
            limit=value('cmac_limit'),
            mode=value('cmac_update'),
        )
    friction = None
    forces = _pair(value, 'coulomb')
    if min(forces) <= 0.0 < max(forces):
        raise StageError(
            'friction is compensated on both axes: set x.coulomb and y.coulomb above zero, or '
            'both to zero'
        )
    if min(forces) > 0.0:
        models = [
            LuGre(
                value(f'{axis}.coulomb'),
                max(value(f'{axis}.static'), value(f'{axis}.coulomb')),
                value(f'{axis}.stribeck_velocity'),
                value(f'{axis}.stiffness'),
            )
            for axis in AXES
        ]
        friction = models[0], models[1]
    return Gains(
        position=_pair(value, 'position_gain'),
        velocity_feedforward=_pair(value, 'velocity_feedforward'),
        acceleration_feedforward=_pair(value, 'acceleration_feedforward'),
        cross_coupling=0.0 if base == 'p_ff' else float(value('cross_coupling')),
        cmac=settings,
        friction=friction,
        velocity_gain=_pair(value, 'velocity_gain'),
        integral_gain=_pair(value, 'integral_gain'),
        estimator_steps=value('estimator_steps'),
    )


def make_learning(value: Values) -> LearningSettings | None:
    """Settings of the learning, None where the scheme has none."""
    learning = value('scheme').partition('+')[2]
    if not learning:
        return None
    return LearningSettings(
        _pair(value, 'ilc_gain'),
        value('ilc_cutoff'),
        value('ilc_lead'),
        learning == 'rilc',
        value('rilc_reading'),
        value('rilc_floor'),
        value('divergence'),
    )


def make_run_settings(value: Values, lockstep: bool) -> RunSettings:
    """How a run approaches and stops."""
    given = {f.name: value(f.name) for f in fields(RunSettings) if f.name != 'lockstep'}
    return RunSettings(**given, lockstep=lockstep)
