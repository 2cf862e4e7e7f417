"""Pairs (f, g) of the class of fg-Bernstein bases (Section 4.2 of paper 4).

A pair belongs to the class when f and g are nonnegative on the interval, positive inside, and f/g
strictly increases. High relative accuracy asks one thing more: f_i g_k - f_k g_i for t_k < t_i
must be computed without a subtraction of computed numbers. Each pair here gives it in a
closed form in which only the data themselves are subtracted.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from stage_core.arrays import Array
from stage_core.errors import StageError


class Basis(ABC):
    """One pair (f, g); a frozen dataclass in each subclass, so that it can be compared."""

    @property
    @abstractmethod
    def domain(self) -> tuple[float, float]:
        """Closed interval of the parameter."""

    @abstractmethod
    def pair(self, t: Any, functions: Any = np) -> tuple[Any, Any]:
        """Values f(t) and g(t).

        Parameters
        ----------
        t : array, float or mpmath number in the domain.
        functions : module with ``sin`` and ``sinh``; ``mpmath`` gives the exact values.
        """

    @abstractmethod
    def differences(self, upper: Array, lower: Array) -> Array:
        """f(upper) g(lower) - f(lower) g(upper) for lower < upper, free of cancellation."""

    def g_lost(self, t: Array) -> Array:
        """Relative rounding error c of the computed g: the true one is g (1 + c).

        Zero where it is not known; high relative accuracy holds either way, with a constant that
        grows with the degree, and this keeps that constant small.
        """
        return np.zeros_like(t)

    def differences_lost(self, upper: Array, lower: Array) -> Array:
        """Relative rounding error of the computed :meth:`differences`, zero where unknown."""
        return np.zeros_like(upper)

    @abstractmethod
    def taylor(self, t: Array, order: int) -> tuple[Array, Array]:
        """Taylor coefficients of f and g about each t, two arrays of shape (m, order + 1)."""

    def contains_constants(self, degree: int) -> bool:
        """Whether the space of this degree holds the constants.

        Where it does not, a fitted curve depends on the place of the origin.
        """
        return True


def _linear(value: Array, slope: float, order: int) -> Array:
    coefficients = np.zeros((value.size, order + 1))
    coefficients[:, 0] = value
    if order > 0:
        coefficients[:, 1] = slope
    return coefficients


def _lost_in_subtraction(larger: Array, smaller: Array) -> Array:
    """Relative rounding error of larger - smaller, which is a double itself (Moller, Knuth)."""
    result = larger - smaller
    back = larger - result
    lost = (larger - (result + back)) + (back - smaller)
    return np.divide(lost, result, out=np.zeros_like(result), where=result > 0.0)


def _check_interval(lower: float, upper: float) -> None:
    if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
        raise StageError(
            f'the interval ({lower}, {upper}) is empty or not finite: give lower < upper'
        )


@dataclass(frozen=True)
class Bernstein(Basis):
    """f = (t - a)/(b - a), g = (b - t)/(b - a): the polynomials (IB1 and LSB1 of paper 4)."""

    lower: float = 0.0
    upper: float = 1.0

    def __post_init__(self) -> None:
        _check_interval(self.lower, self.upper)

    @property
    def domain(self) -> tuple[float, float]:
        """Closed interval [a, b]."""
        return self.lower, self.upper

    def pair(self, t: Any, functions: Any = np) -> tuple[Any, Any]:
        """Values f(t) and g(t)."""
        width = self.upper - self.lower
        return (t - self.lower) / width, (self.upper - t) / width

    def differences(self, upper: Array, lower: Array) -> Array:
        """(t_i - t_k)/(b - a)."""
        return (upper - lower) / (self.upper - self.lower)

    def g_lost(self, t: Array) -> Array:
        """Rounding of 1 - t, known exactly on the unit interval."""
        if (self.lower, self.upper) != (0.0, 1.0):
            return np.zeros_like(t)
        return _lost_in_subtraction(np.ones_like(t), t)

    def differences_lost(self, upper: Array, lower: Array) -> Array:
        """Rounding of t_i - t_k, known exactly; the division by b - a cancels in quotients."""
        return _lost_in_subtraction(upper, lower)

    def taylor(self, t: Array, order: int) -> tuple[Array, Array]:
        """Taylor coefficients of f and g about each t."""
        f, g = self.pair(t)
        slope = 1.0 / (self.upper - self.lower)
        return _linear(f, slope, order), _linear(g, -slope, order)


@dataclass(frozen=True)
class Rational(Basis):
    """f = t/w, g = (1 - t)/w with w = w_0 (1 - t) + w_1 t on [0, 1]: rational curves.

    The denominator w**n is common to all functions, so the basis sums to 1/w**n times one; it
    holds the constants, because the n-th power of w, a combination of t and 1 - t, is in the span.
    """

    first_weight: float = 1.0
    last_weight: float = 2.0

    def __post_init__(self) -> None:
        if not (0.0 < self.first_weight < math.inf and 0.0 < self.last_weight < math.inf):
            raise StageError(
                f'the weights {self.first_weight} and {self.last_weight} of a rational basis '
                'must be positive: give two positive numbers'
            )

    @property
    def domain(self) -> tuple[float, float]:
        """Closed interval [0, 1]."""
        return 0.0, 1.0

    def _weight(self, t: Any) -> Any:
        return self.first_weight * (1 - t) + self.last_weight * t

    def pair(self, t: Any, functions: Any = np) -> tuple[Any, Any]:
        """Values f(t) and g(t)."""
        weight = self._weight(t)
        return t / weight, (1 - t) / weight

    def differences(self, upper: Array, lower: Array) -> Array:
        """(t_i - t_k)/(w_i w_k)."""
        return (upper - lower) / (self._weight(upper) * self._weight(lower))

    def taylor(self, t: Array, order: int) -> tuple[Array, Array]:
        """Taylor coefficients of f and g about each t, by dividing by the linear series w."""
        slope = self.last_weight - self.first_weight
        weight = self._weight(t)
        reciprocal = (-slope / weight[:, None]) ** np.arange(order + 1) / weight[:, None]
        f = t[:, None] * reciprocal
        g = (1.0 - t)[:, None] * reciprocal
        f[:, 1:] += reciprocal[:, :-1]
        g[:, 1:] -= reciprocal[:, :-1]
        return f, g


@dataclass(frozen=True)
class Monomial(Basis):
    """f = t, g = 1 on [0, b]: scaled powers, whose collocation matrices are Vandermonde's."""

    upper: float = 1.0

    def __post_init__(self) -> None:
        _check_interval(0.0, self.upper)

    @property
    def domain(self) -> tuple[float, float]:
        """Closed interval [0, b]."""
        return 0.0, self.upper

    def pair(self, t: Any, functions: Any = np) -> tuple[Any, Any]:
        """Values f(t) and g(t)."""
        return t * 1.0, t * 0 + 1.0

    def differences(self, upper: Array, lower: Array) -> Array:
        """t_i - t_k."""
        return upper - lower

    def differences_lost(self, upper: Array, lower: Array) -> Array:
        """Rounding of t_i - t_k, known exactly."""
        return _lost_in_subtraction(upper, lower)

    def taylor(self, t: Array, order: int) -> tuple[Array, Array]:
        """Taylor coefficients of f and g about each t."""
        return _linear(t, 1.0, order), _linear(np.ones_like(t), 0.0, order)


@dataclass(frozen=True)
class _HalfArguments(Basis):
    """f = S((D + t)/2), g = S((D - t)/2) on [-D, D] with S'' = `sign` S and S(0) = 0.

    A subclass names S, its derivative and the sign; everything else is the same.
    """

    half_width: float
    sign: ClassVar[float]
    name: ClassVar[str]
    function: ClassVar[Callable[..., Any]]
    slope: ClassVar[Callable[..., Any]]

    @property
    def domain(self) -> tuple[float, float]:
        """Closed interval [-D, D]."""
        return -self.half_width, self.half_width

    def contains_constants(self, degree: int) -> bool:
        """Only an even degree does: an odd one spans half-integer frequencies or exponents."""
        return degree % 2 == 0

    def pair(self, t: Any, functions: Any = np) -> tuple[Any, Any]:
        """Values f(t) and g(t)."""
        function = getattr(functions, self.name)
        return function((self.half_width + t) / 2), function((self.half_width - t) / 2)

    def differences(self, upper: Array, lower: Array) -> Array:
        """S(D) S((t_i - t_k)/2)."""
        return np.asarray(
            getattr(math, self.name)(self.half_width) * self.function((upper - lower) / 2.0)
        )

    def taylor(self, t: Array, order: int) -> tuple[Array, Array]:
        """Taylor coefficients of f and g about each t."""
        rising, falling = (self.half_width + t) / 2.0, (self.half_width - t) / 2.0
        f, g = np.empty((t.size, order + 1)), np.empty((t.size, order + 1))
        for k in range(order + 1):
            derivative = self.slope if k % 2 else self.function
            scale = self.sign ** (k // 2) * 0.5**k / math.factorial(k)
            f[:, k] = scale * derivative(rising)
            g[:, k] = scale * (-1.0) ** k * derivative(falling)
        return f, g


@dataclass(frozen=True)
class Trigonometric(_HalfArguments):
    """f = sin((D + t)/2), g = sin((D - t)/2) on [-D, D], 0 < D < pi (IB2 and LSB2)."""

    half_width: float = 1.57
    sign: ClassVar[float] = -1.0
    name: ClassVar[str] = 'sin'
    function: ClassVar[Callable[..., Any]] = np.sin
    slope: ClassVar[Callable[..., Any]] = np.cos

    def __post_init__(self) -> None:
        if not 0.0 < self.half_width < math.pi:
            raise StageError(
                f'the half width {self.half_width} of a trigonometric basis must lie '
                'between 0 and pi: the paper takes 1.57'
            )


@dataclass(frozen=True)
class Hyperbolic(_HalfArguments):
    """f = sinh((D + t)/2), g = sinh((D - t)/2) on [-D, D], D > 0."""

    half_width: float = 1.0
    sign: ClassVar[float] = 1.0
    name: ClassVar[str] = 'sinh'
    function: ClassVar[Callable[..., Any]] = np.sinh
    slope: ClassVar[Callable[..., Any]] = np.cosh

    def __post_init__(self) -> None:
        if not 0.0 < self.half_width < 300.0:
            raise StageError(
                f'the half width {self.half_width} of a hyperbolic basis must lie between '
                '0 and 300: scale the parameter'
            )


BASES: dict[str, type[Basis]] = {
    'bernstein': Bernstein,
    'trigonometric': Trigonometric,
    'hyperbolic': Hyperbolic,
    'rational': Rational,
    'monomial': Monomial,
}


def basis_named(name: str) -> Basis:
    """Return the basis of this name with its default interval.

    Raises
    ------
    StageError
        If there is no such basis.
    """
    if name not in BASES:
        raise StageError(f'there is no basis {name!r}: choose one of {", ".join(BASES)}')
    return BASES[name]()
