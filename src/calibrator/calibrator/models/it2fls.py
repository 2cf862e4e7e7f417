"""Interval type-2 fuzzy system trained by a particle swarm (paper 1), and the hybrid with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from calibrator.consequents import fit_consequents, regressors, rule_outputs
from calibrator.it2_sets import AntecedentSets, vector_bounds
from calibrator.models.adaptable import Adaptable
from calibrator.models.base import CalibrationModel
from calibrator.models.inputs import scaling_of
from calibrator.models.selection import Conditions
from calibrator.models.structured import Structured
from calibrator.pso import minimise
from calibrator.type_reduction import REDUCTIONS, effective_weights
from stage_core.arrays import Array
from stage_core.errors import StageError

SAMPLES_PER_CONSEQUENT = 10
"""With fewer places than this for each consequent, a rule follows the noise."""


class FuzzySystem(Adaptable):
    """One interval type-2 TSK system per axis; all axes share the antecedents.

    Options: `rules` M (`auto`: one, two or five, each of which holds ten samples per consequent),
    `particles` and `iterations` of the swarm (the paper's: 1000 and 200),
    `reduction` of `type_reduction.REDUCTIONS`, `threads` and `seed`. The attribute
    `progress` is passed on to the swarm.
    """

    method = 'it2fls'
    weights_key = 'theta'
    summary = 'interval type-2 fuzzy system trained by a particle swarm (paper 1)'
    defaults = {
        'rules': 'auto',
        'particles': 30,
        'iterations': 100,
        'reduction': 'maclaurin',
        'threads': 0,
        'seed': 0,
    }
    choices = {'rules': (1, 2, 5)}

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        if self.options['reduction'] not in REDUCTIONS:
            raise StageError(
                f'there is no type reduction {self.options["reduction"]}: choose one of '
                f'{", ".join(REDUCTIONS)}'
            )

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Consequents of one output; the antecedents are searched, not solved."""
        if self.options['rules'] != 'auto':
            return int(self.options['rules']) * (axes + 1)
        rules = int(self.chosen.get('rules', 1))
        return rules * (axes + 1) * (1 if rules == 1 else SAMPLES_PER_CONSEQUENT)

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        # Only here: importing the compiled loops costs a second that prediction need not pay.
        from calibrator.swarm_fitness import SwarmFitness

        centre, half = scaling_of(command)
        mean, deviation = error.mean(axis=0), error.std(axis=0)
        deviation = np.where(deviation > 0.0, deviation, 1.0)
        inputs, targets = (command - centre) / half, (error - mean) / deviation
        rules, reduction = int(self.setting('rules')), str(self.options['reduction'])
        low, high = vector_bounds(rules, self.axes)
        fitness = SwarmFitness(inputs, targets, reduction, int(self.options['threads']))
        particles, iterations, seed = (
            int(self.options[name]) for name in ('particles', 'iterations', 'seed')
        )
        position = minimise(fitness, low, high, particles, iterations, seed, self.progress)
        sets = AntecedentSets.from_vector(position, rules, self.axes)
        lower, upper = sets.firing(inputs)
        theta = [
            fit_consequents(lower, upper, inputs, targets[:, axis], reduction)
            for axis in range(self.axes)
        ]
        self.state.update(
            centre=centre,
            half=half,
            mean=mean,
            deviation=deviation,
            rules=rules,
            antecedents=position,
            theta=np.array(theta),
        )

    def firing(self, command: Array) -> tuple[Array, Array, Array]:
        """Scaled inputs (n, axes) and the lower and upper firing strengths (n, rules)."""
        inputs = (command - self.state['centre']) / self.state['half']
        sets = AntecedentSets.from_vector(
            self.state['antecedents'], int(self.state['rules']), self.axes
        )
        return (inputs, *sets.firing(inputs))

    def _linear_design(self, command: Array, d: Array, t: Array) -> list[tuple[Array, Array]]:
        # Linear while the signs of type reduction stay: those of the present consequents.
        inputs, lower, upper = self.firing(command)
        result = []
        for axis, theta in enumerate(self.state['theta']):
            outputs = rule_outputs(theta, inputs)
            nu = effective_weights(lower, upper, outputs, str(self.options['reduction']))
            design = self.state['deviation'][axis] * regressors(nu, inputs)
            result.append((design, np.full(len(command), self.state['mean'][axis])))
        return result

    def describe(self) -> str:
        """Rules, type reduction and swarm."""
        o = self.options
        return (
            f'{self.method}: {self.summary}, {self.state.get("rules", o["rules"])} rules, '
            f'{o["reduction"]} reduction, {o["particles"]} x {o["iterations"]} swarm'
        )


class Hybrid(CalibrationModel):
    """The structured model first, an interval type-2 system on what it leaves.

    With `rules` `auto` the data choose two, five, or none: the structured model alone.
    """

    method = 'hybrid'
    thermal = True
    summary = 'structured model, then interval type-2 system on the rest'
    defaults = {**FuzzySystem.defaults, **Structured.defaults}
    choices = {'rules': (0, 2, 5)}

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.structured = self._part(Structured)
        self.fuzzy = self._part(FuzzySystem)

    def _part(self, method: type[CalibrationModel]) -> CalibrationModel:
        return method(**{name: self.options[name] for name in method.defaults})

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Those of the larger part; the parts are fitted one after the other."""
        alone = self.structured.parameter_count(axes, sensors)
        self.fuzzy.chosen = self.chosen
        none = self.setting('rules') in (0, 'auto')
        return alone if none else max(alone, self.fuzzy.parameter_count(axes, 0))

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        session = self.sessions[0] if self.sessions else np.zeros(len(command), dtype=np.int64)
        data = Conditions(command, error, direction, temperatures, session)
        self.structured.learn(data)
        self.state = {'structured': self.structured.to_dict(), 'fuzzy': {}}
        if self.setting('rules') == 0:
            return
        rest = error - self.structured.error(command, direction, temperatures)
        self.fuzzy.chosen, self.fuzzy.progress = self.chosen, self.progress
        self.fuzzy.learn(replace(data, error=rest, temperatures=temperatures[:, :0]))
        self.state['fuzzy'] = self.fuzzy.to_dict()

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        if not self.structured.fitted:
            self.structured = Structured.from_dict(self.state['structured'])
            if self.state['fuzzy']:
                self.fuzzy = FuzzySystem.from_dict(self.state['fuzzy'])
        error = self.structured.error(command, direction, temperatures)
        if self.state['fuzzy']:
            error = error + self.fuzzy.error(command, direction, temperatures[:, :0])
        return error

    def describe(self) -> str:
        """Both parts."""
        if self.fitted and not self.state['fuzzy']:
            return f'{self.method}: {self.structured.describe()}; nothing left for a fuzzy system'
        return f'{self.method}: {self.structured.describe()} + {self.fuzzy.describe()}'
