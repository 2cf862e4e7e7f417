"""What a record says about the friction of an axis, and whether it says anything."""

from __future__ import annotations

import math
from dataclasses import dataclass

from contour_ctrl.friction import LuGre
from stage_core.errors import StageError
from stage_core.metrics import SIGMAS

#: Friction explains something where it lowers the force left by this share.
EXPLAINS = 0.01


class NoFriction(StageError):
    """A record from which the friction of an axis cannot be told."""


@dataclass(frozen=True)
class FrictionEstimate:
    """What a record says about an axis; forces in N, or in the record's effort unit.

    Attributes
    ----------
    model
        The LuGre model, `viscous` included.
    mass, offset
        Moving mass [kg, or effort unit per m/s^2] and constant force.
    std
        Standard deviation of coulomb, viscous, mass and offset, from the residual with its
        correlation time taken into account; of stiffness from the scatter of the slow reversals,
        infinite where the record holds too few of them.
    residual, residual_without
        RMS of the force that is left with this model, and with mass and viscous part alone.
    """

    model: LuGre
    mass: float
    offset: float
    std: dict[str, float]
    residual: float
    residual_without: float

    def sentence(self) -> str:
        """One line."""
        model, stiffness = self.model, self.std['stiffness']
        spread = f'{stiffness:.2g} N/m' if math.isfinite(stiffness) else 'unknown'
        return (
            f'F_c {model.coulomb:.4g} N (std {self.std["coulomb"]:.2g} N), '
            f'F_s {model.static:.4g} N, v_s {model.stribeck_velocity:.3g} m/s, '
            f'sigma_0 {model.stiffness:.3g} N/m (std {spread}), '
            f'viscous {model.viscous:.4g} N s/m, mass {self.mass:.4g} kg, '
            f'offset {self.offset:.3g} N; force left {self.residual:.3g} N RMS, '
            f'{self.residual_without:.3g} N without friction'
        )


def refuse_noise(coulomb: float, std: float) -> None:
    """Demand a Coulomb force [N] that its standard deviation sets apart from zero.

    Raises
    ------
    NoFriction
        If its 95 % interval reaches zero.
    """
    if coulomb <= SIGMAS * std:
        raise NoFriction(
            f'no friction can be told from this bag: the Coulomb force is {coulomb:.2g} N '
            f'± {SIGMAS * std:.2g} N (95 %)'
        )


def refuse_useless(estimate: FrictionEstimate) -> FrictionEstimate:
    """The estimate, if its friction explains some of the force.

    Raises
    ------
    NoFriction
        If it leaves as much force as none does.
    """
    if estimate.residual > (1.0 - EXPLAINS) * estimate.residual_without:
        raise NoFriction(
            'no friction can be told from this bag: the force left is '
            f'{estimate.residual:.3g} N RMS with it and {estimate.residual_without:.3g} N without'
        )
    return estimate
