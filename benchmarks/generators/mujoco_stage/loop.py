"""The servo controller around the MuJoCo model, tick by tick with a zero-order hold."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import mujoco
import numpy as np

from ..machine import Axis
from .model import STEPS, mjcf
from .plan import AxisPlan, StagePlan

Array = np.ndarray
# Encoder, estimated speed, velocity command, force.
Known = tuple[float, float, float, float]
# Parts of a tick in which forces of the state are held.
PARTS = 4


class Controller:
    """docs/reference/interfaces.md, "Servo controller", for one axis."""

    def __init__(self, axis: Axis, period: float, start: float) -> None:
        self.axis, self.period = axis, period
        self.keep = exp(-period * axis.velocity_filter)
        self.last, self.speed, self.integral = start, 0.0, 0.0

    def tick(self, q: float, r: float, rate: float) -> tuple[float, float, float]:
        """Estimated speed [m/s], velocity command [m/s] and force [N] of a tick."""
        axis = self.axis
        step = (q - self.last) / self.period
        self.speed = self.keep * self.speed + (1.0 - self.keep) * step
        self.last = q
        command = axis.velocity_feedforward * rate + axis.position_gain * (r - q)
        error = command - self.speed
        asked = axis.velocity_gain * error + self.integral
        force = max(-axis.force_limit, min(axis.force_limit, asked))
        outward = (asked > force and error > 0.0) or (asked < force and error < 0.0)
        if not outward:
            self.integral += axis.integral_gain * error * self.period
        return self.speed, command, force


@dataclass
class Motion:
    """What the simulation yields: the controller's (n, 2) columns and the bodies' tracks.

    `tracks` and `speeds` hold per axis the carriage, the load (or the carriage), the base (or
    zero) and the follower behind a play (or the carriage): (n, 2, 4) [m, m/s].
    """

    encoder: Array
    velocity: Array
    command: Array
    force: Array
    tracks: Array
    speeds: Array


class Rig:
    """A compiled model, with the addresses of its joints."""

    def __init__(self, plan: StagePlan, period: float, start: Array) -> None:
        self.plan = plan
        self.steps = STEPS.get(period, 8)
        self.model = mujoco.MjModel.from_xml_string(mjcf(plan, period / self.steps))
        self.data = mujoco.MjData(self.model)
        self.own = [self._address(letter) for letter in 'xy']
        self.bodies = np.array([self._bodies(letter) for letter in 'xy'])
        self.busy = any(a.forces or a.friction or a.sag for a in plan.axes)
        self.rubs = [
            self._address(f'{"xy"[i]}_wiper') if a.presliding else self.own[i]
            for i, a in enumerate(plan.axes)
        ]
        for letter, at in zip('xy', start, strict=True):
            for body in ('', '_drive', '_wiper', '_table'):
                address = self._address(letter + body)
                if address >= 0:
                    self.data.qpos[address] = at
        mujoco.mj_forward(self.model, self.data)

    def _address(self, name: str) -> int:
        number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name)
        return int(self.model.jnt_qposadr[number]) if number >= 0 else -1

    def _bodies(self, letter: str) -> list[int]:
        return [self._address(letter + body) for body in ('', '_load', '_base', '_table')]

    def advance(self, forces: tuple[float, float], steps: int, time: float) -> None:
        """Some physics steps under commanded forces [N], state-dependent forces held."""
        data = self.data
        if self.busy:
            for i, axis in enumerate(self.plan.axes):
                p, v = float(data.qpos[self.own[i]]), float(data.qvel[self.own[i]])
                ahead = p + 0.5 * v * steps * self.model.opt.timestep
                factor = axis.sag(forces[i], v, time) if axis.sag else 1.0
                data.ctrl[i] = forces[i] * factor
                if axis.forces:
                    data.qfrc_applied[self.own[i]] = sum(f(ahead, v, time) for f in axis.forces)
                if axis.friction:
                    self.model.dof_frictionloss[self.rubs[i]] = axis.friction(ahead, v, time)
        else:
            data.ctrl[:] = forces
        mujoco.mj_step(self.model, data, steps)

    def tracks(self, values: Array) -> Array:
        """Carriage, load, base and follower (n, 2, 4) of joint positions or speeds (n, joints)."""
        out = np.zeros((len(values), 2, 4))
        for i in range(2):
            carriage, load, base, follower = self.bodies[i]
            out[:, i] = values[:, [carriage]]
            out[:, i, 1] += values[:, load] if load >= 0 else 0.0
            out[:, i, 2] = values[:, base] if base >= 0 else 0.0
            out[:, i, 3] = values[:, follower] if follower >= 0 else out[:, i, 3]
        return out


def _read(axis: AxisPlan, p: float, noise: float) -> float:
    seen = p + noise
    for error in axis.scale_errors:
        seen += error(p)
    return round(seen / axis.resolution) * axis.resolution


def _cuts(rig: Rig) -> tuple[list[int], list[tuple[int, int]]]:
    """Ends of the parts of a tick in physics steps; per axis, ticks and steps of delay."""
    delays = []
    for axis in rig.plan.axes:
        whole = round(axis.delay / rig.model.opt.timestep)
        delays.append(divmod(whole, rig.steps))
    ends = {rig.steps, *(rest for _, rest in delays if rest)}
    if rig.busy:
        ends |= {rig.steps * part // PARTS for part in range(1, PARTS)}
    return sorted(ends), delays


def run(plan: StagePlan, ticks: Array, noise: Array, r: Array, rd: Array, period: float) -> Motion:
    """A session: `ticks` [s] (n,) are the true times, `noise` [m], `r`, `rd` are (n, 2)."""
    rig = Rig(plan, period, r[0])
    n, (ends, delays) = len(ticks), _cuts(rig)
    places, speeds = np.zeros((n, rig.model.nq)), np.zeros((n, rig.model.nv))
    loops = [
        Controller(a.controller, period, _read(a, float(r[0, i]), float(noise[0, i])))
        for i, a in enumerate(plan.axes)
    ]
    asked: tuple[list[float], list[float]] = ([], [])
    known: tuple[list[Known], list[Known]] = ([], [])
    noises, rows, rates, times = noise.tolist(), r.tolist(), rd.tolist(), ticks.tolist()
    steps = (np.diff(ticks, append=ticks[-1] + period) / rig.steps).tolist()
    qpos, (first, second) = rig.data.qpos, rig.own
    for k in range(n):
        places[k], speeds[k] = qpos, rig.data.qvel
        for i, p in enumerate((float(qpos[first]), float(qpos[second]))):
            q = _read(plan.axes[i], p, noises[k][i])
            told = loops[i].tick(q, rows[k][i], rates[k][i])
            known[i].append((q, *told))
            asked[i].append(told[2])
        rig.model.opt.timestep = steps[k]
        done = 0
        for end in ends:
            held = (_held(asked[0], k, *delays[0], done), _held(asked[1], k, *delays[1], done))
            rig.advance(held, end - done, times[k] + done * steps[k])
            done = end
    encoder, velocity, command, force = np.array(known).transpose(2, 1, 0)
    return Motion(encoder, velocity, command, force, rig.tracks(places), rig.tracks(speeds))


def _held(asked: list[float], k: int, whole: int, rest: int, done: int) -> float:
    """The force that acts from `done` steps after tick k on."""
    tick = k - whole - (1 if done < rest else 0)
    return asked[tick] if tick >= 0 else 0.0
