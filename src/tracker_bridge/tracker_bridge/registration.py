"""Alignment of the tracker's frame with the stage's by least squares (eq. 24 of paper 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.frames import RigidTransform, fit_rigid
from stage_core.tracker_frame import TURNED, other_unit
from stage_core.wording import measure

FEWEST_PAIRS = 3
# Points nearer to one line than this do not fix the rotation about it [m].
NARROWEST_SPREAD = 1e-3


@dataclass(frozen=True)
class Registration:
    """A rigid transform tracker -> stage with what is known about its quality.

    Attributes
    ----------
    transform
        p_stage = rotation · p_tracker + translation [m].
    residuals
        Transformed tracker point minus stage position, (n, 3) [m].
    rms
        Root mean square of the residuals' lengths [m].
    rotation_std
        Standard deviations from the residuals, about x, y, z [rad].
    planar_rms
        Root mean square of what eq. 24 of paper 1 leaves, with scale and skew free [m].
    """

    transform: RigidTransform
    residuals: Array
    rms: float
    rotation_std: Array
    planar_rms: float

    def summary(self) -> str:
        """Return one line for the answer of the service."""
        largest = float(np.linalg.norm(self.residuals, axis=1).max())
        return (
            f'tracker -> stage from {len(self.residuals)} rests: RMS {measure(self.rms)}, '
            f'max {measure(largest)}, rotation about z known to '
            f'{measure(self.rotation_std[2], "rad")}; eq. 24 with scale and skew free: '
            f'RMS {measure(self.planar_rms)}'
        )


def _rms(residuals: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


def fit_planar(stage: Array, tracker: Array) -> Array:
    """Matrix Tr (2, 3) of eq. 24 of paper 1, p_tracker = Tr · (x, y, 1), by least squares."""
    design = np.column_stack([stage[:, :2], np.ones(len(stage))])
    solution, *_ = np.linalg.lstsq(design, tracker[:, :2], rcond=None)
    return np.asarray(solution.T)


def register(tracker: ArrayLike, stage: ArrayLike) -> Registration:
    """Fit the rigid transform from tracker points to stage positions, both (n, 3) [m].

    Raises
    ------
    StageError
        With fewer than three pairs, pairs nearly on one line, another unit, or points that do not
        follow the stage.
    """
    source = np.asarray(tracker, dtype=float).reshape(-1, 3)
    target = np.asarray(stage, dtype=float).reshape(-1, 3)
    if len(source) < FEWEST_PAIRS:
        raise StageError(
            f'only {len(source)} rests of the stage were measured: move to at least three '
            'positions that are not on one line and rest at each, then align again'
        )
    centred = target - target.mean(axis=0)
    spread = np.linalg.svd(centred, compute_uv=False)[1] / np.sqrt(len(target))
    if not spread > NARROWEST_SPREAD:
        raise StageError(
            f'the positions lie within {spread * 1e3:.3f} mm of one line: '
            'rest at positions that differ on both axes, then align again'
        )
    if unit := other_unit(source, target, 'the stage'):
        raise StageError(f'the tracker {unit}')
    transform = fit_rigid(source, target)
    residuals = transform.apply(source) - target
    if _rms(residuals) > TURNED * _rms(centred):
        raise StageError(
            f'the tracker does not follow the stage (RMS {measure(_rms(residuals))}): put the '
            'reflector on the table, call ~/reset, rest at six places and align again'
        )
    freedom = 3 * len(source) - 6
    variance = float(np.sum(residuals**2)) / freedom
    # Small rotation w and shift t about the centre move a point by w × p + t.
    design = np.zeros((len(source), 3, 6))
    x, y, z = (transform.apply(source) - target.mean(axis=0)).T
    design[:, 0, 1], design[:, 0, 2] = z, -y
    design[:, 1, 0], design[:, 1, 2] = -z, x
    design[:, 2, 0], design[:, 2, 1] = y, -x
    design[:, :, 3:] = np.eye(3)
    flat = design.reshape(-1, 6)
    deviations = np.sqrt(variance * np.diag(np.linalg.inv(flat.T @ flat)))
    planar = fit_planar(target, source)
    left = source[:, :2] - (target[:, :2] @ planar[:, :2].T + planar[:, 2])
    return Registration(transform, residuals, _rms(residuals), deviations[:3], _rms(left))
