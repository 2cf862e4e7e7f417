"""A compiled MuJoCo model of a stage: loaded, and where its axes sit in it."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stage_core.errors import StageError
from stage_core.quantities import AXES

MISSING = 'a MuJoCo model needs the package mujoco: `pip install "mujoco<4"` into this environment'


def load(path: str | Path) -> Any:
    """The compiled model, a `mujoco.MjModel`.

    Raises
    ------
    StageError
        If the package or the file is missing, or MuJoCo refuses the model.
    """
    if importlib.util.find_spec('mujoco') is None:
        raise StageError(f'{path}: {MISSING}')
    import mujoco

    if not Path(path).is_file():
        raise StageError(f'there is no model {path}: give the MJCF file of the stage')
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        reason = ' '.join(str(error).split())
        raise StageError(f'MuJoCo refuses {path} ({reason}): mend the model') from error


@dataclass(frozen=True)
class Place:
    """Where an axis sits in a compiled model."""

    joint: int
    position: int  # in qpos
    dof: int
    actuator: int


def places(model: Any, path: str | Path) -> dict[str, Place]:
    """Axes of a compiled model.

    Raises
    ------
    StageError
        If there is no slide joint `x` or `y`, or an axis has not one actuator that is a motor.
    """
    import mujoco

    out = {}
    for axis in AXES:
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, axis)
        if joint < 0:
            continue
        if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_SLIDE):
            raise StageError(f'{path}: joint {axis} is no slide joint: give it type="slide"')
        own = [
            k
            for k in range(model.nu)
            if int(model.actuator_trntype[k]) == int(mujoco.mjtTrn.mjTRN_JOINT)
            and model.actuator_trnid[k, 0] == joint
        ]
        if len(own) != 1:
            raise StageError(
                f'{path}: joint {axis} has {len(own)} actuators: give it one <motor> (the '
                'controller is that of --controller)'
            )
        _check_motor(model, own[0], f'{path}: the actuator of joint {axis}')
        out[axis] = Place(
            joint, int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]), own[0]
        )
    if not out:
        raise StageError(f'{path} has no slide joint named x or y: name the joints of the axes so')
    return out


def _check_motor(model: Any, k: int, where: str) -> None:
    import mujoco

    filters = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    kinds = [int(kind) for kind in (mujoco.mjtDyn.mjDYN_NONE, *filters)]
    plain = (
        int(model.actuator_gaintype[k]) == int(mujoco.mjtGain.mjGAIN_FIXED)
        and not np.any(model.actuator_biasprm[k, 1:3])
        and int(model.actuator_dyntype[k]) in kinds
    )
    if not plain:
        raise StageError(
            f'{where} is no motor: MuJoCo would close a loop of its own; give it <motor>, the '
            'controller is that of --controller'
        )
    if model.actuator_gear[k, 0] * model.actuator_gainprm[k, 0] <= 0.0:
        raise StageError(f'{where} has a gear or gain that is not above zero: turn the joint axis')
