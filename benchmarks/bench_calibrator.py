"""Speed of the calibrator beside what its peers need for the same work, in the same run.

The swarm: PyIT2FLS (membership functions and type reduction, sample by sample) with pseudo-inverse
consequents inside pyswarms, on a small problem, and the compiled fitness on the same one; then one
iteration of the paper's setting (1000 particles, 2000 samples, 5 rules, both axes), from which 200
are extrapolated (`--full` runs them). Inference per sample. Stepwise regression of paper 2's size
beside a loop of ordinary regressions (one step of it is timed and multiplied).

    python benchmarks/bench_calibrator.py [--full]
"""

import argparse
import os
import sys
import time

import numpy as np
import pyswarms
import statsmodels.api as sm
from pyit2fls import EIASC_algorithm

from calibrator import pso
from calibrator.consequents import regressors, rule_outputs
from calibrator.it2_sets import AntecedentSets, vector_bounds
from calibrator.models import make_model
from calibrator.stepwise import stepwise
from calibrator.swarm_fitness import SwarmFitness
from calibrator.type_reduction import effective_weights

RULES = 5


def stage(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Scaled inputs and one or two scaled targets."""
    generator = np.random.default_rng(0)
    inputs = generator.uniform(-1.0, 1.0, (samples, 2))
    targets = np.column_stack(
        [np.sin(3 * inputs[:, 0]) * inputs[:, 1], np.cos(4 * inputs[:, 1]) + inputs[:, 0] ** 3]
    )
    return inputs, targets + generator.normal(0.0, 0.05, targets.shape)


def peer_error(vector: np.ndarray, inputs: np.ndarray, target: np.ndarray) -> float:
    """One particle with the library's type reduction for each sample, one output."""
    lower, upper = AntecedentSets.from_vector(vector, RULES, 2).firing(inputs)
    weights = effective_weights(lower, upper, np.zeros_like(lower), 'nie_tan')
    theta = np.linalg.pinv(regressors(weights, inputs)) @ target
    outputs = rule_outputs(theta, inputs)
    total = 0.0
    for k in range(len(inputs)):
        table = np.column_stack([outputs[k], outputs[k], lower[k], upper[k]])
        left, right = EIASC_algorithm(table)
        total += (target[k] - 0.5 * (left + right)) ** 2
    return total / len(inputs)


def bench_swarm(full: bool) -> None:
    """Training of the interval type-2 system."""
    inputs, targets = stage(200)
    low, high = vector_bounds(RULES, 2)
    particles, iterations = 10, 3
    started = time.perf_counter()
    optimiser = pyswarms.single.GlobalBestPSO(
        particles, len(low), {'c1': 1.496, 'c2': 1.496, 'w': 0.7298}, (low, high)
    )
    optimiser.optimize(
        lambda swarm: np.array([peer_error(p, inputs, targets[:, 0]) for p in swarm]),
        iterations,
        verbose=False,
    )
    peer = time.perf_counter() - started
    fitness = SwarmFitness(inputs, targets[:, :1], 'maclaurin', 1)
    fitness(np.random.default_rng(0).uniform(low, high, (2, len(low))))
    started = time.perf_counter()
    pso.minimise(fitness, low, high, particles, iterations - 1)
    ours = time.perf_counter() - started
    print(
        f'swarm, {particles} x {iterations}, 200 samples, one output: PyIT2FLS + pyswarms '
        f'{peer:.3f} s, here {1e3 * ours:.2f} ms, ratio {peer / ours:.0f}'
    )
    inputs, targets = stage(2000)
    swarm = np.random.default_rng(0).uniform(low, high, (1000, len(low)))
    for threads in sorted({1, os.cpu_count() or 1}):
        fitness = SwarmFitness(inputs, targets, 'maclaurin', threads)
        started = time.perf_counter()
        fitness(swarm)
        one = time.perf_counter() - started
        print(
            f'one iteration of 1000 particles, 2000 samples, both axes, {threads} thread(s): '
            f'{one:.3f} s, 200 of them {200 * one:.1f} s'
        )
        # Other work on the machine stretches a second; some of many moments it leaves alone.
        few = swarm[: 20 * threads]
        seconds = []
        for _ in range(100):
            started = time.perf_counter()
            fitness(few)
            seconds.append(time.perf_counter() - started)
        print(
            f'least of 100 batches of {len(few)}, {threads} thread(s): '
            f'{1e6 * min(seconds) / len(few):.0f} µs per particle'
        )
    if full:
        fitness = SwarmFitness(inputs, targets, 'maclaurin')
        started, used = time.perf_counter(), time.process_time()
        pso.minimise(fitness, low, high, 1000, 200)
        wall, used = time.perf_counter() - started, time.process_time() - used
        print(
            f'1000 x 200 in full: {wall:.1f} s, processor time {used:.1f} s: {used / 2:.1f} s on '
            'each of two cores'
        )


def bench_inference() -> None:
    """Prediction and inversion per sample."""
    generator = np.random.default_rng(0)
    command = generator.uniform(0.0, 0.05, (2000, 2))
    measured = command + 2e-5 * np.sin(80 * command)
    for method in ('structured', 'it2fls'):
        model = make_model(method).fit(command, measured)
        for name, function in (('predict', model.predict), ('invert', model.invert)):
            started = time.perf_counter()
            function(command)
            batch = (time.perf_counter() - started) / len(command)
            started = time.perf_counter()
            for k in range(50):
                function(command[k : k + 1])
            single = (time.perf_counter() - started) / 50
            print(f'{method} {name}: {1e6 * batch:.2f} µs per sample of 2000, '
                  f'{1e6 * single:.0f} µs alone')  # fmt: skip


def bench_stepwise() -> None:
    """217 candidates, 9701 samples."""
    generator = np.random.default_rng(0)
    columns = generator.normal(size=(9701, 217))
    truth = generator.normal(size=217) * (generator.random(217) < 0.3)
    target = columns @ truth + generator.normal(size=9701)
    seconds = []
    for _ in range(3):
        started = time.perf_counter()
        fit = stepwise(columns, target)
        seconds.append(time.perf_counter() - started)
    started = time.perf_counter()
    outside = sorted(set(range(217)) - set(fit.selected))
    for candidate in outside[:3]:
        chosen = [*fit.selected, candidate]
        _ = sm.OLS(target, sm.add_constant(columns[:, chosen])).fit().pvalues[-1]
    loop = (time.perf_counter() - started) / 3 * 217 * len(fit.path) / 2
    print(
        f'stepwise, 217 x 9701, {len(fit.path)} steps: {min(seconds):.3f} s; a loop of ordinary '
        f'regressions about {loop:.0f} s (extrapolated), ratio {loop / min(seconds):.0f}'
    )


def main() -> int:
    """Run all benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--full', action='store_true', help='run the 1000 x 200 swarm in full')
    options = parser.parse_args()
    bench_swarm(options.full)
    bench_inference()
    bench_stepwise()
    return 0


if __name__ == '__main__':
    sys.exit(main())
