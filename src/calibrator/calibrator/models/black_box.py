"""Baselines trained by scikit-learn, stored and evaluated without it (and without pickle).

Only fitting imports scikit-learn; a loaded model needs NumPy alone, so a model file from one
release of the library works with every other and cannot run code when it is opened.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod

import numpy as np

from calibrator.models.base import CalibrationModel
from calibrator.models.inputs import scaling_of
from stage_core.arrays import Array


class BlackBox(CalibrationModel):
    """Inputs: scaled commands, and the direction and temperatures where they vary."""

    thermal = True

    def _fit(self, command: Array, error: Array, direction: Array, temperatures: Array) -> None:
        self.state['uses_direction'] = bool(np.ptp(direction, axis=0).any())
        inputs = self._inputs(command, direction, temperatures)
        centre, half = scaling_of(inputs)
        mean, deviation = error.mean(axis=0), error.std(axis=0)
        deviation = np.where(deviation > 0.0, deviation, 1.0)
        self.state.update(centre=centre, half=half, mean=mean, deviation=deviation)
        self._fit_scaled((inputs - centre) / half, (error - mean) / deviation)

    def _error(self, command: Array, direction: Array, temperatures: Array) -> Array:
        inputs = self._inputs(command, direction, temperatures)
        scaled = (inputs - self.state['centre']) / self.state['half']
        return self.state['mean'] + self.state['deviation'] * self._predict_scaled(scaled)

    def _inputs(self, command: Array, direction: Array, temperatures: Array) -> Array:
        parts = [command]
        if self.state['uses_direction']:
            parts.append(direction)
        if self.sensors:
            parts.append(temperatures)
        return np.hstack(parts)

    @abstractmethod
    def _fit_scaled(self, inputs: Array, targets: Array) -> None:
        """Learn scaled targets (n, axes) of scaled inputs (n, columns) into `state`."""

    @abstractmethod
    def _predict_scaled(self, inputs: Array) -> Array:
        """Scaled targets (n, axes)."""


class Perceptron(BlackBox):
    """One hidden layer of tanh neurons (the paper's comparison has 10), trained by L-BFGS.

    Well-trained on purpose: against the default optimiser's result any method wins.
    """

    method = 'perceptron'
    summary = 'one hidden layer of tanh neurons (scikit-learn)'
    defaults = {'neurons': 'auto', 'restarts': 3, 'iterations': 1500, 'seed': 0}
    choices = {'neurons': (2, 5, 10)}

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Weights of the hidden layer and of one output."""
        neurons = self.setting('neurons')
        return (1 if neurons == 'auto' else int(neurons)) * (axes + sensors + 2) + 1

    def _fit_scaled(self, inputs: Array, targets: Array) -> None:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.neural_network import MLPRegressor

        best = None
        for restart in range(int(self.options['restarts'])):
            network = MLPRegressor(
                hidden_layer_sizes=(int(self.setting('neurons')),),
                activation='tanh',
                solver='lbfgs',
                max_iter=int(self.options['iterations']),
                alpha=1e-6,
                random_state=int(self.options['seed']) + restart,
            )
            with warnings.catch_warnings():
                warnings.simplefilter('ignore', ConvergenceWarning)
                network.fit(inputs, targets if targets.shape[1] > 1 else targets[:, 0])
            if best is None or network.loss_ < best.loss_:
                best = network
        assert best is not None
        self.state['weights'] = [np.asarray(w) for w in best.coefs_]
        self.state['biases'] = [np.asarray(b) for b in best.intercepts_]

    def _predict_scaled(self, inputs: Array) -> Array:
        hidden = np.tanh(inputs @ self.state['weights'][0] + self.state['biases'][0])
        return hidden @ self.state['weights'][1] + self.state['biases'][1]


class GaussianProcess(BlackBox):
    """Squared-exponential kernel with one length per input, and white noise.

    Hyper-parameters maximise the marginal likelihood on at most `points` samples drawn with
    `seed`; the cost grows with the cube of their number.
    """

    method = 'gaussian_process'
    summary = 'Gaussian process regression (scikit-learn)'
    defaults = {'points': 400, 'seed': 0}

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Length scales, amplitude and noise."""
        return axes + sensors + 2

    def _fit_scaled(self, inputs: Array, targets: Array) -> None:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

        generator = np.random.default_rng(int(self.options['seed']))
        count = min(len(inputs), int(self.options['points']))
        chosen = np.sort(generator.choice(len(inputs), count, replace=False))
        x = inputs[chosen]
        amplitude, lengths, weights = [], [], []
        for output in range(targets.shape[1]):
            kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF(
                np.ones(x.shape[1]), (5e-2, 1e2)
            ) + WhiteKernel(1e-2, (1e-8, 1e1))
            process = GaussianProcessRegressor(kernel)
            with warnings.catch_warnings():
                warnings.simplefilter('ignore', ConvergenceWarning)
                process.fit(x, targets[chosen, output])
            amplitude.append(process.kernel_.k1.k1.constant_value)
            lengths.append(np.atleast_1d(process.kernel_.k1.k2.length_scale))
            weights.append(process.alpha_)
        self.state['points'] = x
        self.state['amplitude'] = np.array(amplitude)
        self.state['lengths'] = np.array(lengths)
        self.state['weights'] = np.array(weights)

    def _predict_scaled(self, inputs: Array) -> Array:
        from scipy.spatial.distance import cdist

        outputs = []
        for amplitude, length, weights in zip(
            self.state['amplitude'], self.state['lengths'], self.state['weights'], strict=True
        ):
            distance = cdist(inputs / length, self.state['points'] / length, 'sqeuclidean')
            outputs.append(amplitude * np.exp(-0.5 * distance) @ weights)
        return np.column_stack(outputs)


class GradientBoosting(BlackBox):
    """Boosted regression trees; piecewise constant, so its inverse is approximate."""

    method = 'gradient_boosting'
    summary = 'gradient boosted trees (scikit-learn)'
    defaults = {'trees': 'auto', 'depth': 4, 'rate': 0.1, 'subsample': 0.7, 'seed': 0}
    choices = {'trees': (10, 40, 150)}
    continuous = False

    def parameter_count(self, axes: int, sensors: int) -> int:
        """Leaves of one tree."""
        return 2 ** int(self.options['depth'])

    def _fit_scaled(self, inputs: Array, targets: Array) -> None:
        from sklearn import config_context
        from sklearn.ensemble import GradientBoostingRegressor

        outputs = []
        for output in range(targets.shape[1]):
            booster = GradientBoostingRegressor(
                n_estimators=int(self.setting('trees')),
                max_depth=int(self.options['depth']),
                learning_rate=float(self.options['rate']),
                subsample=float(self.options['subsample']),
                random_state=int(self.options['seed']),
                init='zero',
            )
            # Each tree would be checked anew, which takes as long as growing it.
            with config_context(skip_parameter_validation=True, assume_finite=True):
                booster.fit(inputs, targets[:, output])
            trees = [estimator.tree_ for estimator in booster.estimators_[:, 0]]
            outputs.append(
                {
                    'sizes': np.array([tree.node_count for tree in trees]),
                    'left': np.concatenate([tree.children_left for tree in trees]),
                    'right': np.concatenate([tree.children_right for tree in trees]),
                    'feature': np.concatenate([tree.feature for tree in trees]),
                    'threshold': np.concatenate([tree.threshold for tree in trees]),
                    'value': float(self.options['rate'])
                    * np.concatenate([tree.value[:, 0, 0] for tree in trees]),
                }
            )
        self.state['outputs'] = outputs

    def _predict_scaled(self, inputs: Array) -> Array:
        # The library compares single-precision inputs with double-precision thresholds.
        x = inputs.astype(np.float32)
        depth = int(self.options['depth'])
        columns = []
        for output in self.state['outputs']:
            starts = np.concatenate([[0], np.cumsum(output['sizes'])[:-1]])
            rows = np.arange(len(x))
            total = np.zeros(len(x))
            for start in starts:
                node = np.full(len(x), start)
                for _ in range(depth):
                    leaf = output['left'][node] < 0
                    below = (
                        x[rows, np.maximum(output['feature'][node], 0)]
                        <= (output['threshold'][node])
                    )
                    child = np.where(below, output['left'][node], output['right'][node]) + start
                    node = np.where(leaf, node, child)
                total += output['value'][node]
            columns.append(total)
        return np.column_stack(columns)
