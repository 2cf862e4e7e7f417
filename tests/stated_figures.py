"""Sentences of README and docs with the figures that the code gives them.

`STATED` is by page. What stands in `GIVEN` is fixed by others: formats of vendors, publications.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import yaml

from calibrator import prepare
from contour_ctrl import sequence
from gap_diagnosis.input import stepper
from gap_diagnosis.report import causes, document
from session_bags import convert_odrive_cogging, metadata, writer
from stage_bringup.graph import Options
from stage_bringup.rerun_view import PINNED
from stage_bringup.up import TPI_PORT
from stage_core import drive_link
from stage_core.clocks import NANOSECONDS
from stage_core.metrics import SIGMAS
from stage_core.ros.node import LATCHED_QOS, SETPOINT_QOS, STATE_QOS
from stage_core.twin_file import StepperAxis, TrackerSpec, TwinFile
from stage_driver import protocol, zaber_link
from stage_driver.config import ZaberConfig
from stage_twin import loops, measured_force
from stage_twin.effects import encoder_interpolation, friction, torque_sag
from stage_twin.emulators import zaber_axis
from tracker_bridge import tpi

ROOT = Path(__file__).resolve().parents[1]
NOMINAL = TwinFile.nominal_servo()
RATE = f'{1e-3 / NOMINAL.control_period:g} kHz'
CONTOUR = yaml.safe_load((ROOT / 'ros_ws/config/contour_ctrl.yaml').read_text('utf-8'))
CIRCLE = CONTOUR['contour_ctrl']['ros__parameters']
LOCKED = dict(
    re.findall(r'^([\w-]+)==([\w.]+)', (ROOT / 'requirements.lock').read_text('utf-8'), re.M)
)
CHUNK = writer.SessionWriter.__init__.__kwdefaults__
VERSIONS = {
    str(ElementTree.parse(file).findtext('version')) for file in ROOT.glob('src/*/package.xml')
}

STATED: dict[str, list[str]] = {
    'README.md': [f'UDP, {RATE}', f'the servo loop at {RATE}'],
    'concepts/architecture.md': [f'The plant ticks at {RATE}'],
    'concepts/bags.md': [
        f'records six topics at {RATE}',
        f'ticks of {1e3 * convert_odrive_cogging.PERIOD:g} ms',
    ],
    'concepts/contour.md': [
        f'At {RATE} the controller',
        f'has rested for {sequence.REST_TIME:g} s',
    ],
    'concepts/driver.md': [f'a force, {1.0 / NOMINAL.control_period:g} times a second'],
    'concepts/reliability.md': [f'At {RATE} the publishers keep', f'too few for {RATE}'],
    'concepts/twin.md': [
        f'times {NOMINAL.axes["y"].mass:g}/{NOMINAL.axes["x"].mass:g}, the ratio of the masses'
    ],
    'guide/diagnosis_reading.md': [f'a probability below {causes.LIKELY:g} are named'],
    'guide/live_view.md': [
        f'foxglove-sdk {LOCKED["foxglove-sdk"]}',
        f'viewer of {PINNED.replace("==", " ")}',
    ],
    'guide/real_machine.md': [f'force in, at {RATE}', f'connects to port {TPI_PORT}'],
    'guide/tutorials/paper1.md': [f'the same {100 * prepare.SHARE:.0f} % of the recording'],
    'guide/tutorials/paper2.md': [
        'screws warm up by 4 K',
        f'1.645 times the noise of 0.2 µm is {1.645 * 0.2:.2f} µm',
        'the **last 30 % of the time**',
    ],
    'guide/tutorials/paper3.md': [
        f'a circle of {1e3 * CIRCLE["radius"]:g} mm at {1e3 * CIRCLE["feed"]:g} mm/s'
        f' {("once", "twice", "three times")[Options.iterations - 1]}'
    ],
    'guide/tutorials/paper4.md': ['defined to 50 nm', 'a spline through 11 points'],
    'reference/glossary.md': [
        f'the wall clock, at {RATE}',
        f'{1e3 * NOMINAL.control_period:g} ms',
    ],
    'reference/interfaces.md': [
        f'| states and measurements | reliable | volatile | keep last {STATE_QOS.depth} |',
        f'`/stage/target` | reliable | volatile | keep last {SETPOINT_QOS.depth} |',
        f'| reliable | transient local | keep last {LATCHED_QOS.depth} |',
        '| `/diagnostics`, `/clock` | reliable | volatile | keep last 10 |',
        f'simulated time starts at {loops.LOCKSTEP_START_NS / NANOSECONDS:g} s',
        f'port {drive_link.DEFAULT_PORT}',
        f'header, {drive_link.HEADER.size} bytes',
        f'at most {(drive_link.MAX_DATAGRAM - drive_link.HEADER.size) // 8} values',
        f'a tick more than {loops.STALE_TICKS} ticks ago',
        f'| version {metadata.VERSION}, ',
        f'at most {CHUNK["chunk_bytes"] // 1024} KiB or {CHUNK["chunk_period"]:g} s',
        f'time between two ticks | {NOMINAL.control_period:g} |',
        f'points per second | {TrackerSpec.rate:g} |',
        f'a length is nominal | {TwinFile.temperature_reference:g} |',
        f'positions beyond {stepper.LARGEST_TRAVEL:g} m',
        f'windows of {1e3 * measured_force.WINDOW:g} ms',
        f'max({torque_sag.LEAST:g}, ',
        f'up to {1e6 * friction.LONGEST_PRESLIDING:g} µm, '
        f'or up to 1/{1.0 / friction.OF_TRAVEL:.0f} of the travel',
        f'periods of {1e6 * encoder_interpolation.SHORTEST:g} µm'
        f' to {1e3 * encoder_interpolation.LONGEST:g} mm',
    ],
    'reference/interfaces_report.md': [
        'blocks of about 5 s, of about 10 s for a session longer than two minutes',
        'encoder resolution / √12',
        f'at most {document.MOST_CANDIDATES} |',
        f'further than {SIGMAS:g} standard deviations',
    ],
    'reference/interfaces_tracker.md': [
        f'port {TPI_PORT}',
        f'at most {tpi.MAXIMUM_SIZE // 1024} KiB',
        f'first takes {tpi.HEADER.size} bytes, then size − {tpi.HEADER.size}',
        f'the answer of {len(tpi.encode_reflectors(0, 0, 0.0, ""))} bytes',
        '`tracker_port` 20700',
    ],
    'reference/interfaces_zaber.md': [
        f'{ZaberConfig.baud} baud is the default',
        f'At {ZaberConfig.baud} baud a byte takes {1e7 / ZaberConfig.baud:.1f} µs',
        f'Ids are 0 to {protocol.LARGEST_ID}.',
        f'an unanswered id again for {zaber_link.QUARANTINE:g} s',
        f'at most {protocol.PACKET_SIZE} bytes',
        f'for example {1e6 * StepperAxis.microstep:g} µm',
        f'times {zaber_axis.SPEED_UNIT}. ',
        f'times {1e4 * zaber_axis.ACCELERATION_UNIT} / 10000',
        f'travel 0 to {zaber_axis.LIMITS[1]} microsteps '
        f'({1e3 * StepperAxis.microstep * zaber_axis.LIMITS[1]:.0f} mm of'
        f' {1e6 * StepperAxis.microstep:g} µm)',
        f'`zaber-motion` {LOCKED["zaber-motion"]}',
    ],
    'reference/quality.md': [f'each `package.xml` is {", ".join(VERSIONS)}'],
}

#: Facts that no code of this project sets.
GIVEN: dict[str, list[str]] = {
    'README.md': ['RS-232', 'Apache-2.0'],
    'concepts/calibration.md': [
        'The settings of the papers are `{"degree": 5}` or 7, `{"rules": 5, "particles": 1000, '
        '"iterations": 200}`, `{"neurons": 10}`',
        'c1 + c2 < 0.169 at w = 0.7298',
    ],
    'concepts/contour.md': [
        'max |S| ≤ 1.6 (a robust loop)',
        # Beside `sequence.REST_TIME`, with what it was measured on.
        'The position loop takes 0.35 s',
    ],
    'concepts/tracker.md': ['`flood` (10 points for each)'],
    'concepts/twin.md': ['R = 4 s'],
    'guide/diagnosis_reading.md': ['a probability of 0.97, about three'],
    'guide/tutorials/paper1.md': ['sections 3.2 and 3.3 of the paper'],
    'reference/interfaces_tracker.md': [
        "the controller's clock, resolution 1 µs",
        'header, version 3.6',
        'header 3.6',
        'Structures are packed to 4 bytes: integers, enumerations and booleans take 4 bytes, '
        'doubles 8 bytes and are aligned to 4.',
        'skips types 4, 5, 6 and 11',
        'Two decimals in mm are steps of 10 µm',
        'Events 6, 12 and 16',
    ],
    'reference/interfaces_zaber.md': [
        'addresses 1 to 99. A device has 1 to 9 axes',
        'holds bytes back for up to 16 ms',
        '`zaber.serial` 0.9.1',
    ],
    'reference/quality.md': ['Apache-2.0'],
}
