"""Pictures, standard figures and pages of sessions."""

from stage_reports.iso230 import Circular, Positioning, circular, positioning

__all__ = ['Circular', 'Positioning', 'circular', 'positioning']
