"""Pictures and standard figures of sessions."""

from stage_reports.iso230 import Circular, Positioning, circular, positioning
from stage_reports.report import Report

__all__ = ['Circular', 'Positioning', 'Report', 'circular', 'positioning']
