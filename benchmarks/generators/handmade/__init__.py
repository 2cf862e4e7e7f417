"""A servo XY stage by hand: leapfrog in uneven substeps, generalised Maxwell-slip friction."""

from .generator import AXIS_EFFECTS, GLOBAL_EFFECTS, MECHANISMS, draw, simulate

__all__ = ['AXIS_EFFECTS', 'GLOBAL_EFFECTS', 'MECHANISMS', 'draw', 'simulate']
