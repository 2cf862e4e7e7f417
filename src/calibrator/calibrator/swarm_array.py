"""Fitness of a swarm in any array-API namespace, for a graphics processor where there is one.

The same steps as `swarm_fitness`, batched over particles instead of compiled, and equal to it up
to rounding. It needs `array-api-compat` and CuPy or PyTorch (extra `gpu`); without them, or
without a device, the compiled loops on the processor are used.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrator.it2_sets import LOWEST_EXPONENT
from calibrator.swarm_fitness import REDUCTION_CODES, RIDGE, SwarmFitness
from calibrator.type_reduction import SIGN_BAND
from stage_core.errors import StageError

Array = NDArray[np.float64]

DEVICES = ('auto', 'cpu')
LARGEST = 2**26
"""Numbers that one array of a batch of particles may hold: 0.5 GiB."""


class ArrayFitness:
    """Fitness of a swarm for `pso.minimise` in an array-API namespace.

    Parameters
    ----------
    xp
        The namespace, with its linear algebra extension.
    inputs, targets
        (N, n) and (N, outputs), scaled.
    reduction
        Name of the type reduction; `karnik_mendel` trains with one step, as `SwarmFitness`.
    device
        Where the arrays live, in the namespace's own terms; None is its default.
    """

    def __init__(
        self, xp: Any, inputs: Array, targets: Array, reduction: str, device: Any = None
    ) -> None:
        self._xp, self._device = xp, device
        self._code = REDUCTION_CODES[reduction]
        self._inputs = self._to_device(inputs)
        self._targets = self._to_device(targets)

    def __call__(self, particles: Array) -> Array:
        """Errors (K,) of particles (K, 3·M·n)."""
        samples, count = self._inputs.shape
        width = particles.shape[1] // (3 * count) * (count + 1)
        batch = max(1, LARGEST // (samples * width))
        return np.concatenate(
            [self._errors(particles[k : k + batch]) for k in range(0, len(particles), batch)]
        )

    def _to_device(self, values: Array) -> Any:
        values = np.ascontiguousarray(values, dtype=np.float64)
        return self._xp.asarray(values, dtype=self._xp.float64, device=self._device)

    def _errors(self, particles: Array) -> Array:
        lower, upper = self._firing(self._to_device(particles))
        first = self._plain(lower, upper)
        total = None
        for output in range(self._targets.shape[1]):
            target = self._targets[:, output]
            error, outputs = self._fitted_outputs(first, target)
            if self._code == 1:
                weights = self._signed(lower, upper, outputs)
                error = self._mean_square(weights, outputs, target)
                _, outputs = self._fitted_outputs(weights, target)
                again = self._signed(lower, upper, outputs)
                error = self._xp.minimum(error, self._mean_square(again, outputs, target))
            total = error if total is None else total + error
        return _to_numpy(total)

    def _firing(self, particles: Any) -> tuple[Any, Any]:
        """Lower and upper strengths (K, N, M), see `it2_sets`."""
        xp = self._xp
        count = self._inputs.shape[1]
        rules = particles.shape[1] // (3 * count)
        parts = xp.reshape(particles, (particles.shape[0], 3, 1, rules, count))
        wide = xp.exp(-2.0 * parts[:, 1, ...])
        narrow = wide * xp.exp(
            -2.0 * xp.minimum(parts[:, 2, ...], xp.zeros_like(parts[:, 2, ...]))
        )
        square = (self._inputs[None, :, None, :] - parts[:, 0, ...]) ** 2
        upper = -xp.sum(square * wide, axis=-1)
        lower = -xp.sum(square * narrow, axis=-1)
        strongest = xp.max(upper, axis=-1, keepdims=True)
        floor = xp.full_like(upper, LOWEST_EXPONENT)
        return (
            xp.exp(xp.maximum(lower - strongest, floor)),
            xp.exp(xp.maximum(upper - strongest, floor)),
        )

    def _plain(self, lower: Any, upper: Any) -> Any:
        if self._code == 2:
            return 0.5 * (self._normalised(lower) + self._normalised(upper))
        return self._normalised(lower + upper)

    def _signed(self, lower: Any, upper: Any, outputs: Any) -> Any:
        left = self._step(upper, lower, outputs, self._normalised(lower))
        right = self._step(lower, upper, outputs, self._normalised(upper))
        return 0.5 * (left + right)

    def _step(self, below: Any, above: Any, outputs: Any, weights: Any) -> Any:
        """Normalised strengths of one end, see `type_reduction`."""
        xp = self._xp
        mean = xp.sum(weights * outputs, axis=-1, keepdims=True)
        over, band = outputs - mean, SIGN_BAND * xp.abs(mean)
        twice = xp.where(over > band, above, below) + xp.where(over < -band, below, above)
        return self._normalised(twice)

    def _normalised(self, strengths: Any) -> Any:
        return strengths / self._xp.sum(strengths, axis=-1, keepdims=True)

    def _fitted_outputs(self, weights: Any, target: Any) -> tuple[Any, Any]:
        """Mean square error (K,) and rule outputs (K, N, M) of the ridge normal equations."""
        xp = self._xp
        particles, samples, rules = weights.shape
        columns = [weights]
        columns += [weights * self._inputs[None, :, k, None] for k in range(self._inputs.shape[1])]
        design = xp.concat(columns, axis=-1)
        turned = xp.matrix_transpose(design)
        gram = turned @ design
        size = gram.shape[-1]
        unit = xp.eye(size, dtype=xp.float64, device=self._device)
        trace = xp.sum(xp.sum(gram * unit, axis=-1), axis=-1)
        gram = gram + (RIDGE / size * trace + 1e-300)[:, None, None] * unit
        right = turned @ xp.broadcast_to(target[None, :, None], (particles, samples, 1))
        theta = xp.reshape(xp.linalg.solve(gram, right), (particles, size // rules, 1, rules))
        outputs = theta[:, 0, ...]
        for k in range(self._inputs.shape[1]):
            outputs = outputs + theta[:, k + 1, ...] * self._inputs[None, :, k, None]
        return self._mean_square(weights, outputs, target), outputs

    def _mean_square(self, weights: Any, outputs: Any, target: Any) -> Any:
        error = self._xp.sum(weights * outputs, axis=-1) - target[None, :]
        return self._xp.mean(error**2, axis=-1)


def swarm_fitness(
    inputs: Array, targets: Array, reduction: str, threads: int = 0, device: str = 'auto'
) -> Callable[[Array], Array]:
    """Fitness on the graphics processor where there is one, by the compiled loops elsewhere.

    Parameters
    ----------
    device
        `auto`, or `cpu` for the compiled loops in any case.

    Raises
    ------
    StageError
        For another device.
    """
    if device not in DEVICES:
        raise StageError(
            f'there is no device {device} for the swarm: choose one of {", ".join(DEVICES)}'
        )
    if device == 'auto':
        for name, found in (('cupy', _cupy_device), ('torch', _torch_device)):
            # Whatever keeps a driver or a library from working must not keep a stage from it.
            try:
                xp = importlib.import_module(f'array_api_compat.{name}')
                return ArrayFitness(xp, inputs, targets, reduction, found())
            except Exception:
                continue
    return SwarmFitness(inputs, targets, reduction, threads)


def _cupy_device() -> Any:
    return importlib.import_module('cupy').cuda.Device(0)


def _torch_device() -> Any:
    torch = importlib.import_module('torch')
    if not torch.cuda.is_available():
        raise StageError('PyTorch sees no graphics processor')
    return torch.device('cuda')


def _to_numpy(values: Any) -> Array:
    if hasattr(values, 'get'):
        values = values.get()
    elif hasattr(values, 'cpu'):
        values = values.cpu()
    return np.array(np.from_dlpack(values), dtype=np.float64)
