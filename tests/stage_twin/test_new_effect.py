"""An effect in a file of its own, beside the library: simulated, diagnosed and reported."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]

GEAR_WOBBLE = '''
"""A gear that wobbles once in 17 mm."""

import math

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='gear_wobble',
    link='kinematic',
    parameters=(Parameter('amplitude', 'm', 0.0, 100e-6, 5e-6, 'amplitude'),),
    model='amplitude * sin(2 pi p / 17 mm). Nobody (2026).',
    sentence='the gear wobbles by {amplitude}',
    excited_by='strokes of 20 mm',
)


def along(motor, amplitude):
    return amplitude * math.sin(2.0 * math.pi * motor / 0.017)


def term(rows):
    signal = [np.sin(2.0 * np.pi * p / 0.017) for p in rows.position()]
    return Term(constant(rows.along(signal)), lambda theta, c: {'amplitude': float(c[0])})
'''

SLOW_DRIVE = '''
"""A drive whose force comes through a first-order lag, as in `dF/dt = (command - F) / lag`."""

import math

from stage_twin.effects.definition import Effect, Parameter

EFFECT = Effect(
    name='slow_drive',
    link='servo',
    parameters=(Parameter('lag', 's', 0.0, 0.01, 1e-3, 'time constant'),),
    model='dF/dt = (command - F) / lag. Nobody (2026).',
    sentence='the force lags by {lag}',
    excited_by='a sweep',
    states=('force',),
)


def drive(state, force, step, lag):
    left = math.exp(-step / lag)
    mean = force + (state[0] - force) * (1.0 - left) * lag / step
    state[0] = force + (state[0] - force) * left
    return mean
'''

SIMULATE = """
import numpy as np
from stage_core.twin_file import TwinFile
from stage_twin.plant import ServoPlant

nominal = TwinFile.nominal_servo()
late = ServoPlant(nominal.with_effects({'slow_drive.x': {'lag': 2e-3}}))
prompt = ServoPlant(nominal)
for plant in (late, prompt):
    for _ in range(3000):
        plant.step([10.0, 0.0])
# A constant force that comes late by a lag leaves the axis behind by the lag times its speed.
behind = prompt.encoder()[0] - late.encoder()[0]
expected = 2e-3 * prompt.motor_velocity()[0]
assert abs(behind / expected - 1.0) < 0.02, (behind, expected)
"""

DIAGNOSE = """
import sys
from pathlib import Path
from conftest import make_session, nominal
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.report import document, page

session = make_session({'gear_wobble.x': {'amplitude': 8e-6}})
found = diagnose([session], [], nominal(('x',)))
document.write(found, Path(sys.argv[1]))
assert list(found.verdict) == ['gear_wobble.x'], found.verdict
amplitude = found.corrected_twin.effects['gear_wobble.x']['amplitude']
assert abs(amplitude - 8e-6) < 0.5e-6, amplitude
assert 'the gear wobbles by 8' in page.render(found)
"""


def test_effects_of_one_file_each_are_simulated_diagnosed_and_reported(tmp_path: Path) -> None:
    """Two files beside the library, one of an effect with a state; kernels are compiled once."""
    (tmp_path / 'effects').mkdir()
    for name, effect in (('gear_wobble', GEAR_WOBBLE), ('slow_drive', SLOW_DRIVE)):
        (tmp_path / 'effects' / f'{name}.py').write_text(effect, encoding='utf-8')
    # What no effect goes into is compiled already; what depends on them is compiled here.
    if shared := os.environ.get('NUMBA_CACHE_DIR'):
        shutil.copytree(shared, tmp_path / 'numba', ignore=shutil.ignore_patterns('twin-*'))
    # First, because other folders of tests have a conftest too.
    paths = [str(TESTS / 'gap_diagnosis'), *sys.path]
    environment = {
        **os.environ,
        'STAGE_EFFECTS': str(tmp_path / 'effects'),
        'PYTHONPATH': os.pathsep.join(p for p in paths if p),
        'NUMBA_CACHE_DIR': str(tmp_path / 'numba'),
    }
    done = subprocess.run(
        [sys.executable, '-c', SIMULATE + DIAGNOSE, str(tmp_path / 'out')],
        capture_output=True, text=True, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert 'gear_wobble.x' in (tmp_path / 'out' / 'report.json').read_text(encoding='utf-8')


def test_a_function_that_asks_for_what_there_is_not_is_named(tmp_path: Path) -> None:
    file = tmp_path / 'gear_wobble.py'
    file.write_text(GEAR_WOBBLE.replace('along(motor,', 'along(mottor,'), encoding='utf-8')
    done = subprocess.run(
        [sys.executable, '-c', 'import stage_twin.hooks'],
        capture_output=True, text=True, env={**os.environ, 'STAGE_EFFECTS': str(tmp_path)},
    )  # fmt: skip
    assert 'gear_wobble: along asks for mottor' in done.stderr
