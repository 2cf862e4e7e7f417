"""Model files of other simulators: what is read, what is written, and that both mean the same."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.models import is_model, read_model
from stage_twin.models.plant import Plant, as_twin, corrected, instruments
from stage_twin.models.unsaid import unsaid
from stage_twin.models.xml_text import XmlText
from stage_twin.mujoco_plant import MujocoPlant
from stage_twin.simulate import simulate
from stage_twin.simulate_command import circle

BODY = '<inertial pos="0 0 0" mass="{}" diaginertia="1 1 1"/>'
#: A stage whose y rides on x, with every number that is read; gravity pulls along x.
MJCF = f"""<mujoco>
  <option timestep="0.002" gravity="-0.2 0 -9.81"/>
  <default><joint damping="25"/></default>
  <worldbody>
    <!-- x carries y -->
    <body>
      <joint name="x" type="slide" axis="1 0 0" frictionloss='4' armature="1.5"
             stiffness="300" springref="0.01"/>
      {BODY.format(10)}
      <body>
        <joint name="y" type="slide" axis="0 1 0" damping="30"/>
        <geom type="box" size="0.1 0.1 0.02" mass="8"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="x" gear="2 0 0 0 0 0" forcerange="-150 150"/>
    <general joint="y" dyntype="filter" dynprm="0.002"></general>
  </actuator>
</mujoco>
"""
URDF = """<robot name="stage">
  <link name="base"/>
  <link name="beam"><inertial><mass value="10"/></inertial></link>
  <link name="table"><inertial><mass value="8"/></inertial></link>
  <joint name="x" type="prismatic">
    <parent link="base"/><child link="beam"/>
    <dynamics damping="40" friction="3"/><limit effort="200" velocity="1"/>
  </joint>
  <joint name="y" type="prismatic"><parent link="beam"/><child link="table"/></joint>
</robot>
"""


def saved(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.fixture
def mjcf(tmp_path: Path) -> Path:
    return saved(tmp_path / 'stage.xml', MJCF)


def test_every_number_of_a_model_is_read(mjcf: Path) -> None:
    plants = read_model(mjcf).plants
    x, y = plants['x'], plants['y']
    assert x.mass == pytest.approx(19.5)  # with the armature and what it carries
    assert (x.viscous, x.coulomb, x.stiffness, x.centre) == (25.0, 4.0, 300.0, 0.01)
    assert x.offset == pytest.approx(-0.2 * 18.0)  # of gravity
    assert (x.gain, x.limit) == (2.0, 150.0)
    assert y == Plant(mass=pytest.approx(8.0), viscous=30.0, lag=0.002)


def test_the_twin_knows_forces_of_the_command(mjcf: Path) -> None:
    rig = TwinFile.nominal_servo().with_effects(
        {'backlash.x': {'width': 5e-6}, 'coulomb_friction.y': {'coulomb': 9.0}}
    )
    twin = as_twin(read_model(mjcf).plants, rig)
    assert twin.servo('x').mass == pytest.approx(9.75)
    assert twin.servo('x').position_gain == rig.servo('x').position_gain
    assert twin.effects['coulomb_friction.x']['coulomb'] == pytest.approx(2.0)
    assert twin.effects['force_saturation.x']['limit'] == 150.0
    # The table is the file's, the plant the model's.
    assert 'backlash.x' in twin.effects
    assert 'coulomb_friction.y' not in twin.effects


def test_mujoco_moves_as_the_twin_of_its_model(tmp_path: Path) -> None:
    # Friction apart: MuJoCo softens its start.
    text = MJCF.replace("frictionloss='4'", '').replace('0.002"/>', '0.0005"/>')
    path = saved(tmp_path / 'stage.xml', text.replace('timestep="0.002"', 'timestep="0.00025"'))
    rig = instruments(TwinFile.nominal_servo())
    reference, rate = circle(rig, 2.0, 0.02, 0.1)
    ours = simulate(as_twin(read_model(path).plants, rig), reference, rate, noise=False)
    theirs = MujocoPlant(rig, path).session(reference, rate, noise=False)
    moved = np.sqrt(np.mean((ours.encoder - reference) ** 2))
    apart = np.sqrt(np.mean((ours.encoder - theirs.encoder) ** 2))
    assert apart < 0.4e-6 < 0.01 * moved
    assert theirs.tracker_points.shape == ours.tracker_points.shape


def test_a_correction_is_written_and_read_back(mjcf: Path, tmp_path: Path) -> None:
    model = read_model(mjcf)
    found = {
        'inertia_mismatch.x': {'ratio': -0.2},
        'inertia_mismatch.y': {'ratio': -0.1},
        'viscous_friction.x': {'viscous': 5.0},
        'coulomb_friction.x': {'coulomb': 3.5, 'presliding': 0.0},
        'cable_force.x': {'stiffness': 200.0, 'centre': -0.02, 'hardening': 0.0},
        'force_offset.x': {'offset': 1.25},
        'drive_gain.y': {'error': -0.1},
        'force_offset.y': {'offset': -2.0},
        'current_loop_lag.x': {'time_constant': 0.003},
        'actuation_delay.y': {'delay': 0.0015},
        'force_saturation.y': {'limit': 90.0, 'known': 0.0},
    }
    wanted = corrected(model.plants, found)
    text = model.write(wanted)
    again = read_model(saved(tmp_path / 'again.xml', text)).plants
    for axis, plant in wanted.items():
        assert vars(again[axis]) == pytest.approx(vars(plant), rel=1e-4)
    assert again['x'].mass == pytest.approx(0.8 * 19.5, rel=1e-4)
    assert again['y'].gain == pytest.approx(0.9)
    assert again['x'].offset == pytest.approx(2.5, rel=1e-4)
    # What does not change stands as it was written.
    untouched = [line for line in MJCF.splitlines() if 'geom' in line or 'option' in line]
    assert set(untouched) | {'    <!-- x carries y -->'} <= set(text.splitlines())
    assert unsaid(found, 'MJCF') == {}
    assert {c.attribute for c in model.text.changes} >= {'mass', 'inertial', 'delay', 'biasprm'}


def test_what_a_file_cannot_say_is_said(mjcf: Path) -> None:
    found = {
        'stribeck_friction.x': {'coulomb': 3.0, 'breakaway': 2.0},
        'asymmetric_friction.y': {'coulomb_positive': 6.0, 'coulomb_negative': 4.0},
        'backlash.x': {'width': 5e-6},
        'viscous_friction.x': {'viscous': 5.0},
    }
    assert set(unsaid(found, 'MJCF')) == set(found) - {'viscous_friction.x'}
    wanted = corrected(read_model(mjcf).plants, found)
    assert wanted['x'].coulomb == 6.0  # two newtons at the joint for each commanded
    assert (wanted['y'].coulomb, wanted['y'].offset) == (5.0, -1.0)


def test_the_dynamics_of_a_urdf(tmp_path: Path) -> None:
    model = read_model(saved(tmp_path / 'stage.urdf', URDF))
    assert model.plants['x'] == Plant(mass=18.0, viscous=40.0, coulomb=3.0, limit=200.0)
    assert model.plants['y'] == Plant(mass=8.0)
    found = {
        'inertia_mismatch.x': {'ratio': 0.5},
        'inertia_mismatch.y': {'ratio': 0.25},
        'coulomb_friction.y': {'coulomb': 6.0},
        'viscous_friction.x': {'viscous': 5.0},
    }
    wanted = corrected(model.plants, found)
    again = read_model(saved(tmp_path / 'again.urdf', model.write(wanted)))
    assert again.plants == wanted
    assert unsaid({'drive_gain.x': {'error': 0.1}}, 'URDF').keys() == {'drive_gain.x'}


@pytest.mark.parametrize(
    ('old', 'new', 'says'),
    [
        ('type="slide" axis="1 0 0"', 'type="hinge" axis="1 0 0"', 'no slide joint'),
        ('<motor joint="x" gear="2 0 0 0 0 0" forcerange="-150 150"/>', '', '0 actuators'),
        ('<motor joint="x" gear="2 0 0 0 0 0"', '<position joint="x" kp="9"', 'no motor'),
        ('-150 150', '-100 150', 'not symmetric'),
        ('name="x"', 'name="X"', 'no joint x|actuator|refuses'),
        ('</body>', '', 'no XML'),
        ('<mujoco>', '<mujoco><nonsense/>', 'refuses'),
    ],
)
def test_an_unusable_model_is_one_clear_line(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    path = saved(tmp_path / 'stage.xml', MJCF.replace(old, new))
    with pytest.raises(StageError, match=says) as error:
        read_model(path)
    assert '\n' not in str(error.value)


def test_without_the_package_one_line_says_what_to_install(
    mjcf: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None)
    with pytest.raises(StageError, match='pip install "mujoco'):
        read_model(mjcf)


def test_a_plant_of_a_model_takes_no_other_plant(mjcf: Path) -> None:
    rig = TwinFile.nominal_servo()
    with pytest.raises(StageError, match='belongs to the plant'):
        MujocoPlant(rig.with_effects({'coulomb_friction.x': {'coulomb': 3.0}}), mjcf)
    late = replace(rig, axes={a: replace(rig.servo(a), delay=0.0015) for a in rig.axes})
    plain, delayed = MujocoPlant(rig, mjcf), MujocoPlant(late, mjcf)
    for plant in (plain, delayed):
        plant.reset([0.0, 0.0])
        plant.step([50.0, 50.0])
    # Gravity alone gives 0.2 mm/s in a tick.
    assert plain.motor_velocity()[0] > 4e-3
    assert abs(delayed.motor_velocity()[0]) < 3e-4


def test_names_of_files() -> None:
    assert is_model('a/stage.XML')
    assert is_model('stage.urdf')
    assert not is_model('twin.yaml')


def test_a_change_leaves_every_other_byte(tmp_path: Path) -> None:
    path = tmp_path / 'a.xml'
    path.write_bytes(b'<a>\r\n  <b x="1>2" y = \'3\' /><!-- x="4" -->\r\n  <c\tz="5"></c>\r\n</a>')
    text = XmlText(path)
    b, c = (text.find(lambda e, tag=tag: e.tag == tag) for tag in 'bc')
    assert b is not None
    assert c is not None
    text.set(b, 'b', 'y', '7')
    text.set(b, 'b', 'new', '8')
    text.rename(c, 'dd')
    assert text.text == (
        '<a>\r\n  <b x="1>2" y = "7" new="8" /><!-- x="4" -->\r\n  <dd\tz="5"></dd>\r\n</a>'
    )
    assert [(t.attribute, t.old, t.new) for t in text.changes] == [
        ('y', '3', '7'), ('new', None, '8')
    ]  # fmt: skip
