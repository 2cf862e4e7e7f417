"""A servo XY stage on MuJoCo: joints, friction loss, springs, second bodies, tendons as plays."""

from .generator import AXIS_EFFECTS, GLOBAL_EFFECTS, MECHANISMS, draw, simulate

__all__ = ['AXIS_EFFECTS', 'GLOBAL_EFFECTS', 'MECHANISMS', 'draw', 'simulate']
