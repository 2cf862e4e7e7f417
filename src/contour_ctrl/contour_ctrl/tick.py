"""One control tick as one compiled kernel: reference, contour error, CMAC and every term.

vc = K_f dr/dt + K_a d2r/dt2 + K_p (r - q) + learned + cross-coupling (+ friction)
(eqs. 23-30 of paper 3; docs/reference/interfaces.md, "Servo controller").
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import float64, int64, njit, typeof

from contour_ctrl import cmac
from contour_ctrl.cmac import CmacSettings
from contour_ctrl.contour_error import parameter_estimate
from contour_ctrl.friction import LuGre, lugre_step
from contour_ctrl.reference import Reference
from stage_core.arrays import Array
from stage_core.errors import StageError

# Columns of the table of ticks.
RX, VX, AX, ANGLE, ARC = 0, 2, 4, 6, 7
# Places in the vector of settings.
KP, KF, KA, KC, PERIOD, STEP, CLOSED, STEPS = 0, 2, 4, 6, 7, 8, 9, 10
MODE, RATE, KEEP, LIMIT, SPAN, FRICTION, KV, KI = 11, 12, 13, 14, 15, 16, 17, 19
SETTINGS = 21
# Places in the memory between ticks.
ESTIMATE_1, ESTIMATE_2, BRISTLE, INTEGRAL = 0, 1, 2, 4
# Columns of the record, one row per tick.
QX, EX, ESTIMATE, CONTOUR = 0, 2, 4, 5
RECORD = 6


@njit(cache=True)
def _against_friction(
    axis: int, velocity: float, settings: Array, friction: Array, memory: Array
) -> float:
    """Velocity that makes the PI velocity loop put out exactly the force of the LuGre model."""
    memory[BRISTLE + axis], force = lugre_step(
        friction[axis], memory[BRISTLE + axis], velocity, settings[PERIOD]
    )
    extra = (force - memory[INTEGRAL + axis]) / settings[KV + axis]
    memory[INTEGRAL + axis] += settings[KI + axis] * extra * settings[PERIOD]
    return extra


@njit(cache=True)
def tick(
    k: int,
    qx: float,
    qy: float,
    table: Array,
    path: Array,
    settings: Array,
    learned: Array,
    weights: Array,
    friction: Array,
    memory: Array,
    record: Array,
    command: Array,
) -> None:
    """Compute the velocity command of tick k from the encoder (qx, qy) into `command` (2,).

    `table` (n, 8), `path` (m, 6), `settings` (21,), `learned` (n, 2), `weights`
    (layers, cells + 1, cells + 1), `friction` (2, 6), `memory` (6,), `record` (n, 6):
    the `Controller.arrays`, all preallocated.
    """
    ex, ey = table[k, RX] - qx, table[k, RX + 1] - qy
    sine, cosine = np.sin(table[k, ANGLE]), np.cos(table[k, ANGLE])
    contour = -sine * ex + cosine * ey
    steps = int(settings[STEPS])
    estimate = contour
    if steps > 0:
        estimate = parameter_estimate(
            path, settings[STEP], settings[CLOSED] > 0.5, table[k, ARC], qx, qy, steps
        )
    amount = settings[KC] * estimate
    mode = int(settings[MODE])
    if mode > 0:
        scale = 0.5 / settings[SPAN]
        x, y = 0.5 + scale * table[k, VX], 0.5 + scale * table[k, VX + 1]
        if mode == 1:
            increment = settings[RATE] * settings[PERIOD] * estimate
        else:
            increment = settings[RATE] * (memory[ESTIMATE_1] - memory[ESTIMATE_2])
        cmac.update(weights, x, y, increment, settings[KEEP], settings[LIMIT])
        amount += cmac.output(weights, x, y)
    memory[ESTIMATE_2] = memory[ESTIMATE_1]
    memory[ESTIMATE_1] = estimate
    # Along the contour's normal (eqs. 1 and 2, 21 and 22).
    normal_x, normal_y = -sine * amount, cosine * amount
    record[k, QX], record[k, QX + 1] = qx, qy
    record[k, EX], record[k, EX + 1] = ex, ey
    record[k, ESTIMATE], record[k, CONTOUR] = estimate, contour
    for axis in range(2):
        error = ex if axis == 0 else ey
        value = settings[KF + axis] * table[k, VX + axis]
        value += settings[KA + axis] * table[k, AX + axis]
        value += settings[KP + axis] * error + learned[k, axis]
        value += normal_x if axis == 0 else normal_y
        if settings[FRICTION] > 0.5:
            # The encoder's speed has steps of a count per tick: the command drives the model.
            value += _against_friction(axis, table[k, VX + axis], settings, friction, memory)
        command[axis] = value


@dataclass(frozen=True)
class Gains:
    """What the control law weighs; pairs are (x, y).

    Attributes
    ----------
    position
        K_p [1/s].
    velocity_feedforward
        K_f, no unit.
    acceleration_feedforward
        K_a [s].
    cross_coupling
        K_c [1/s]; 0 switches the classical cross-coupled controller off.
    cmac
        Settings of the CMAC; None switches it off.
    friction
        LuGre models whose force is added as a velocity; None leaves it to the driver.
    velocity_gain, integral_gain
        The PI velocity loop [N.s/m], [N/m], which the friction term needs.
    estimator_steps
        Newton steps of the contour error estimate; 0 is the tangent approximation.
    """

    position: tuple[float, float] = (40.0, 40.0)
    velocity_feedforward: tuple[float, float] = (1.0, 1.0)
    acceleration_feedforward: tuple[float, float] = (0.0, 0.0)
    cross_coupling: float = 0.0
    cmac: CmacSettings | None = None
    friction: tuple[LuGre, LuGre] | None = None
    velocity_gain: tuple[float, float] = (3600.0, 1600.0)
    integral_gain: tuple[float, float] = (90000.0, 40000.0)
    estimator_steps: int = 2

    def __post_init__(self) -> None:
        values = [*self.position, *self.velocity_feedforward, *self.acceleration_feedforward]
        if not np.all(np.isfinite([*values, self.cross_coupling])):
            raise StageError('a gain is not finite: correct the parameters')
        if min(self.position) <= 0.0:
            raise StageError(f'position_gain must be positive, not {self.position}')


@dataclass
class Controller:
    """The arrays of one contour, and the tick that works on them.

    Making one allocates and compiles; `tick` does neither.
    """

    reference: Reference
    gains: Gains = field(default_factory=Gains)

    def __post_init__(self) -> None:
        reference, gains = self.reference, self.gains
        count = len(reference)
        self.table = np.column_stack(
            [
                reference.position,
                reference.velocity,
                reference.acceleration,
                reference.angle,
                reference.arc,
            ]
        )
        path = reference.path
        self.path = np.zeros((2, 6)) if path is None else np.ascontiguousarray(path.values)
        self.learned = np.zeros((count, 2))
        self.record = np.full((count, RECORD), np.nan)
        self.command = np.zeros(2)
        self.memory = np.zeros(6)
        self.friction = np.ones((2, 6))
        self.weights = np.zeros((1, 2, 2))
        settings = np.zeros(SETTINGS)
        settings[KP : KP + 2] = gains.position
        settings[KF : KF + 2] = gains.velocity_feedforward
        settings[KA : KA + 2] = gains.acceleration_feedforward
        settings[KC] = gains.cross_coupling
        settings[PERIOD] = reference.period
        if path is not None:
            settings[STEP], settings[CLOSED] = path.step, path.closed
            settings[STEPS] = gains.estimator_steps
        settings[KEEP], settings[LIMIT], settings[SPAN] = 1.0, 1.0, 1.0
        if gains.cmac is not None:
            settings[MODE] = 1 + cmac.UPDATES.index(gains.cmac.mode)
            settings[RATE] = gains.cmac.rate
            if gains.cmac.mode == 'gradient':
                settings[KEEP] = np.exp(-gains.cmac.leak * reference.period)
            settings[LIMIT] = gains.cmac.limit
            settings[SPAN] = max(reference.feed, 1e-9)
            self.weights = gains.cmac.empty_weights()
        if gains.friction is not None:
            settings[FRICTION] = 1.0
            self.friction = np.stack([model.packed() for model in gains.friction])
        settings[KV : KV + 2] = gains.velocity_gain
        settings[KI : KI + 2] = gains.integral_gain
        self.settings = settings
        #: What `tick` takes after the encoder, in its order.
        self.arrays = (
            *(self.table, self.path, self.settings, self.learned, self.weights),
            *(self.friction, self.memory, self.record, self.command),
        )
        tick.compile((int64, float64, float64, *map(typeof, self.arrays)))

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self.table)

    @property
    def adapts(self) -> bool:
        """Whether a CMAC learns."""
        return bool(self.settings[MODE] > 0.5 and self.settings[RATE] > 0.0)

    def freeze_cmac(self) -> None:
        """Keep the CMAC's weights as they are from now on."""
        self.settings[RATE], self.settings[KEEP] = 0.0, 1.0

    def tick(self, k: int, qx: float, qy: float) -> Array:
        """Return vc (2,) [m/s] of tick k; the array is overwritten by the next tick."""
        tick(k, qx, qy, *self.arrays)
        return self.command

    def restart(self) -> None:
        """Forget the last run's states; what was learned stays."""
        self.memory[:] = 0.0
        self.record[:] = np.nan
