"""A session in the Rerun viewer: ``ros2 run stage_bringup rerun --bag BAG``.

Two timelines: ``session_time`` is that of the stamps, simulated where the session was, in seconds
since its start; ``wall_time`` is the date and time at which it was recorded.
"""

from __future__ import annotations

import argparse
import importlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stage_bringup.rerun_content import Note, Recorded, Stamps, read_recorded
from stage_core import topics
from stage_core.arrays import Array
from stage_core.errors import StageError, command_line
from stage_core.session import Session
from stage_core.whole_file import replacing
from stage_reports.tracking import runs, tracking_errors

#: The optional extra `rerun`, the release that the archetypes below were tried with.
PINNED = 'rerun-sdk==0.41.0'
#: Columns of a session as curves: entity, topic, quantity, factor to the unit of the entity.
CURVES = (
    ('position_mm/reference', topics.REFERENCE, 'position', 1e3),
    ('position_mm/encoder', topics.JOINT_STATES, 'position', 1e3),
    ('force_N', topics.COMMAND, 'effort', 1.0),
)


def load_sdk() -> Any:
    """The module ``rerun`` of rerun-sdk.

    Raises
    ------
    StageError
        If it is not installed.
    """
    try:
        return importlib.import_module('rerun')
    except ImportError as error:
        raise StageError(
            f'the Rerun viewer is not installed: pip install {PINNED} (Python 3.11 or newer)'
        ) from error


class RerunWriter:
    """Sends a session to a Rerun recording as archetypes, each on both timelines."""

    def __init__(self, sdk: Any, stream: Any, recorded: Recorded) -> None:
        self._sdk, self._stream, self._recorded = sdk, stream, recorded
        self._session = recorded.session

    def write(self) -> None:
        """Send everything that the bag holds, and end the recording."""
        self._stream.log('stage', self._sdk.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._places()
        self._curves()
        self._alignments()
        self._notes()
        for stamp, text in self._recorded.models:
            stamps = np.array([stamp])
            self._send('model', stamps, self._sdk.TextDocument.columns(text=[text]))
        self._stream.flush()
        self._stream.disconnect()

    def _send(self, entity: str, stamps: Stamps, columns: Any) -> None:
        since = (stamps - self._session.start_ns).astype('timedelta64[ns]')
        wall = self._recorded.wall_time(stamps).astype('datetime64[ns]')
        column = self._sdk.TimeColumn
        indexes = [column('session_time', duration=since), column('wall_time', timestamp=wall)]
        self._stream.send_columns(entity, indexes, columns)

    def _places(self) -> None:
        """The tracker's points in its own frame, and the table by its encoders."""
        session = self._session
        if session.has(topics.TRACKER_POINT):
            series = session.require(topics.TRACKER_POINT)
            points = np.column_stack([series.values[axis] for axis in 'xyz'])
            self._points('stage/tracker/point', series.stamps, points, 3.0, (0, 114, 178))
        if session.has(topics.JOINT_STATES):
            series = session.require(topics.JOINT_STATES)
            points = np.zeros((len(series), 3))
            points[:, : len(session.axes)] = series.columns('position', session.axes)
            self._points('stage/table', series.stamps, points, 1.0, (213, 94, 0))

    def _points(
        self,
        entity: str,
        stamps: Stamps,
        points: Array,
        radius: float,
        colour: tuple[int, ...],
    ) -> None:
        sdk = self._sdk
        look = sdk.Points3D.from_fields(radii=sdk.Radius.ui_points(radius), colors=[colour])
        self._stream.log(entity, look, static=True)
        self._send(entity, stamps, sdk.Points3D.columns(positions=points))

    def _curves(self) -> None:
        session = self._session
        for entity, topic, quantity, factor in CURVES:
            if session.has(topic):
                series = session.series[topic]
                for axis in session.axes:
                    if f'{quantity}.{axis}' in series.values:
                        values = factor * series.values[f'{quantity}.{axis}']
                        self._curve(f'{entity}/{axis}', series.stamps, values)
        self._servo_error()
        if session.has(topics.CONTOUR_ERROR):
            series = session.series[topics.CONTOUR_ERROR]
            self._curve('contour_error', series.stamps, 1e6 * series.values['z'])
        for sensor, series in session.temperatures().items():
            self._curve(f'temperature_degC/{sensor}', series.stamps, series.values['temperature'])

    def _servo_error(self) -> None:
        """Reference minus encoder at the stamps that both have, as a servo stage's do."""
        reference = self._session.series.get(topics.REFERENCE)
        encoder = self._session.series.get(topics.JOINT_STATES)
        if reference is None or encoder is None:
            return
        stamps, wanted, found = np.intersect1d(
            reference.stamps, encoder.stamps, return_indices=True
        )
        for axis in self._session.axes:
            name = f'position.{axis}'
            if name in reference.values and name in encoder.values:
                error = reference.values[name][wanted] - encoder.values[name][found]
                self._curve(f'tracking_error/{axis}', stamps, 1e6 * error)

    def _curve(self, entity: str, stamps: Stamps, values: Array) -> None:
        known = np.isfinite(values)
        self._send(entity, stamps[known], self._sdk.Scalars.columns(scalars=values[known]))

    def _alignments(self) -> None:
        """Each alignment places the tracker, and so its points, in the stage's frame."""
        found = self._recorded.alignments
        if found:
            columns = self._sdk.Transform3D.columns(
                translation=[transform.translation for _, transform in found],
                quaternion=[transform.quaternion() for _, transform in found],
            )
            self._send('stage/tracker', np.array([stamp for stamp, _ in found]), columns)

    def _notes(self) -> None:
        """What the nodes said of themselves: a lane of states and a line of a log for each."""
        for entity, notes in notes_by_entity(self._recorded).items():
            stamps = np.array([note.stamp for note in notes])
            texts, levels = [note.text for note in notes], [note.level for note in notes]
            self._send(entity, stamps, self._sdk.TextLog.columns(text=texts, level=levels))
            self._send(entity, stamps, self._sdk.StateChange.columns(state=texts))


def notes_by_entity(recorded: Recorded) -> dict[str, list[Note]]:
    """The notes of each node under its entity."""
    found: dict[str, list[Note]] = {}
    for note in recorded.notes:
        entity = 'diagnostics/' + re.sub(r'\W+', '_', note.name).strip('_')
        found.setdefault(entity, []).append(note)
    return found


def layout(sdk: Any, recorded: Recorded) -> Any:
    """The viewer's panels for what the session holds."""
    views = importlib.import_module('rerun.blueprint')
    legend = views.PlotLegend(views.Corner2D.RightTop)
    limits = {'tracking_error': _error_limits(views, recorded.session)}
    curves = [
        views.TimeSeriesView(
            origin=origin, name=name, plot_legend=legend, axis_y=limits.get(origin)
        )
        for origin, name, topic in (
            ('contour_error', 'Contour error (µm)', topics.CONTOUR_ERROR),
            ('tracking_error', 'Error: reference minus encoder (µm)', topics.REFERENCE),
            ('position_mm', 'Position (mm)', topics.JOINT_STATES),
            ('force_N', 'Force (N)', topics.COMMAND),
        )
        if recorded.session.has(topic)
    ]
    # The way that table and tracker have gone until the cursor, not one point alone.
    way = sdk.VisibleTimeRange(
        'session_time',
        start=sdk.TimeRangeBoundary.infinite(),
        end=sdk.TimeRangeBoundary.cursor_relative(),
    )
    left = views.Vertical(
        views.Spatial3DView(origin='stage', name='Table and tracker', time_ranges=way),
        views.TextLogView(origin='diagnostics', name='What the nodes said'),
        row_shares=[2, 1],
    )
    changed = [name for name, notes in notes_by_entity(recorded).items() if len(notes) > 1]
    states = views.StateTimelineView(contents=changed, name='States of the nodes that changed')
    panels = (
        views.TimePanel(timeline='session_time', state='collapsed'),
        views.SelectionPanel(state='collapsed'),
        views.BlueprintPanel(state='collapsed'),
    )
    return views.Blueprint(views.Horizontal(left, views.Vertical(*curves, states)), *panels)


def _error_limits(views: Any, session: Session) -> Any:
    """The error while a contour is followed: the approach to it exceeds that a hundredfold."""
    encoder = next((t for t in tracking_errors(session) if t.sensor == 'encoder'), None)
    followed = runs(session)
    if encoder is None or not followed:
        return None
    largest = max(
        float(np.abs(encoder.errors[run.within(encoder.seconds)]).max(initial=0.0))
        for run in followed
    )
    return views.ScalarAxis(range=(-1e6 * largest, 1e6 * largest))


def parser() -> argparse.ArgumentParser:
    """The command line."""
    found = argparse.ArgumentParser(
        prog='rerun', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    found.add_argument('--bag', type=Path, required=True, help='session bag, or an mcap file')
    found.add_argument('--out', type=Path, help='write this .rrd file and open no viewer')
    return found


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the recording of a bag, or open it in the viewer."""
    chosen = parser().parse_args(arguments)
    sdk = load_sdk()
    recorded = read_recorded(chosen.bag)
    stream = sdk.RecordingStream('stage')
    stream.send_recording_name('/'.join(chosen.bag.resolve().parts[-2:]))
    blueprint = layout(sdk, recorded)
    writer = RerunWriter(sdk, stream, recorded)
    try:
        if chosen.out:
            with replacing(chosen.out) as part:
                stream.save(part.name, default_blueprint=blueprint)
                writer.write()
        else:
            stream.spawn(default_blueprint=blueprint)
            writer.write()
    except (OSError, RuntimeError) as error:
        where = f'cannot write {chosen.out}' if chosen.out else 'the viewer does not start'
        raise StageError(f'{where} ({error}): name a file with --out FILE.rrd') from error
    if chosen.out:
        print(f'{chosen.out}: open it with `rerun {chosen.out}`')
    return 0
