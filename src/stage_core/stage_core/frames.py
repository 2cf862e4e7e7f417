"""Transforms between the tracker's frame and the stage's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError


@dataclass(frozen=True)
class RigidTransform:
    """p_target = rotation · p_source + translation; rotation (3, 3), translation (3,) [m]."""

    rotation: Array
    translation: Array

    @classmethod
    def identity(cls) -> RigidTransform:
        """The transform that leaves every point where it is."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_quaternion(cls, quaternion: ArrayLike, translation: ArrayLike) -> RigidTransform:
        """Transform from a quaternion in ROS order (x, y, z, w) and a translation [m].

        Raises
        ------
        StageError
            For a quaternion of length zero or one that holds a NaN.
        """
        q = np.asarray(quaternion, dtype=float)
        length = float(np.linalg.norm(q))
        if not np.isfinite(length) or length < 1e-12:
            raise StageError('the alignment holds no rotation: align the tracker again')
        x, y, z, w = q / length
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        return cls(rotation, np.asarray(translation, dtype=float))

    def quaternion(self) -> Array:
        """Rotation as a quaternion in ROS order (x, y, z, w), shape (4,)."""
        # Largest-component form: no division by a small number for any rotation.
        m = self.rotation
        squares = np.array(
            [
                1 + m[0, 0] - m[1, 1] - m[2, 2],
                1 - m[0, 0] + m[1, 1] - m[2, 2],
                1 - m[0, 0] - m[1, 1] + m[2, 2],
                1 + m[0, 0] + m[1, 1] + m[2, 2],
            ]
        )
        largest = int(np.argmax(squares))
        s = 2.0 * np.sqrt(squares[largest])
        if largest == 3:
            q = [(m[2, 1] - m[1, 2]) / s, (m[0, 2] - m[2, 0]) / s, (m[1, 0] - m[0, 1]) / s, s / 4]
        elif largest == 0:
            q = [s / 4, (m[0, 1] + m[1, 0]) / s, (m[0, 2] + m[2, 0]) / s, (m[2, 1] - m[1, 2]) / s]
        elif largest == 1:
            q = [(m[0, 1] + m[1, 0]) / s, s / 4, (m[1, 2] + m[2, 1]) / s, (m[0, 2] - m[2, 0]) / s]
        else:
            q = [(m[0, 2] + m[2, 0]) / s, (m[1, 2] + m[2, 1]) / s, s / 4, (m[1, 0] - m[0, 1]) / s]
        return np.asarray(q, dtype=float)

    def apply(self, points: ArrayLike) -> Array:
        """Transform points of shape (..., 3) [m]."""
        return np.asarray(points, dtype=float) @ self.rotation.T + self.translation

    def inverse(self) -> RigidTransform:
        """The transform from the target frame back to the source frame."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation)


def alignment(parent: str, quaternion: ArrayLike, translation: ArrayLike) -> RigidTransform:
    """The transform from the tracker to the stage (see `RigidTransform.from_quaternion`).

    A transform holds the coordinates of the child frame's points in the parent frame, so one
    whose parent is the tracker is inverted.
    """
    found = RigidTransform.from_quaternion(quaternion, translation)
    return found.inverse() if parent == topics.TRACKER_FRAME else found


def alignment_in(message: Any) -> RigidTransform:
    """The alignment that a TransformStamped holds."""
    r, t = message.transform.rotation, message.transform.translation
    return alignment(message.header.frame_id, (r.x, r.y, r.z, r.w), (t.x, t.y, t.z))


def fit_rigid(source: ArrayLike, target: ArrayLike) -> RigidTransform:
    """Least-squares rigid transform from `source` to `target`, both (n, 3) [m].

    Kabsch's solution through the singular value decomposition. Points in one plane are enough
    (a proper rotation is chosen); points on one line are not.

    Raises
    ------
    StageError
        With fewer than three pairs, a NaN, or points on one line.
    """
    a = np.asarray(source, dtype=float)
    b = np.asarray(target, dtype=float)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3 or len(a) < 3:
        raise StageError(
            f'an alignment needs at least three pairs of points, got {len(a)}: '
            'move the stage to more positions and align again'
        )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise StageError('a point of the alignment is not a number: measure it again')
    centre_a, centre_b = a.mean(axis=0), b.mean(axis=0)
    u, sizes, vt = np.linalg.svd((b - centre_b).T @ (a - centre_a))
    if sizes[0] <= 0.0 or sizes[1] < 1e-6 * sizes[0]:
        raise StageError(
            'the points of the alignment lie on one line: move both axes and align again'
        )
    # The sign of the determinant keeps a reflection out.
    sign = np.sign(np.linalg.det(u @ vt))
    rotation = u @ np.diag([1.0, 1.0, sign]) @ vt
    return RigidTransform(rotation, centre_b - rotation @ centre_a)
