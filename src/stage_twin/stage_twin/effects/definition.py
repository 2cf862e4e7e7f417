"""What an effect of the twin is: a name, its place in the chain, and physical parameters."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from stage_core.quantities import LINKS

#: Per unit: factor and unit in which a report says it, where that differs.
_SAID: dict[str, tuple[float, str]] = {
    '': (100.0, '%'),
    'm': (1e6, 'µm'),
    'rad': (1e6, 'µrad'),
    'm/m': (1e6, 'µm/m'),
    '1/K': (1e6, 'µm/(m·K)'),
    's': (1e3, 'ms'),
    's/s': (1e6, 'µs/s'),
}


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, with the range in which its model holds.

    Attributes
    ----------
    when_on : float
        Value taken where a twin file switches the effect on without naming the parameter.
    meaning : str
        What it is, in a few words.
    neutral : float or None
        Value at which it does nothing; an effect whose parameters are all neutral is off. None
        for one that only shapes what others switch on (a period, a phase).
    nuisance : bool
        True for what belongs to a session and not to the machine (a phase, an offset): it is
        refitted per session.
    fitted : bool
        False for geometry that the user states (a period, a reference position) and that data
        of one session cannot determine.
    doubt : float
        Standard deviation, as a share of the value, of what a fit gets wrong beyond what it says.
    doubt_without : tuple of str and float, or None
        Another parameter, and what the doubt is where a session does not show that one.
    scanned : bool
        True for one of which a fit takes the best of many values (a period): the amplitude beside
        it is then the largest of many.
    tried : tuple of float
        Values that the closed loop is run with beside that of the force balance, which cannot
        tell it well.
    inside : bool
        True for a shape whose interval has to lie within the range: beyond it is another effect.
    """

    name: str
    unit: str
    minimum: float
    maximum: float
    when_on: float
    meaning: str
    neutral: float | None = 0.0
    nuisance: bool = False
    fitted: bool = True
    doubt: float = 0.0
    doubt_without: tuple[str, float] | None = None
    scanned: bool = False
    tried: tuple[float, ...] = ()
    inside: bool = False

    def doubted(self, shown: Collection[str]) -> float:
        """The doubt in a session that shows some parameters of the effect."""
        if self.doubt_without is None or self.doubt_without[0] in shown:
            return self.doubt
        return self.doubt_without[1]

    def said(self, value: float) -> str:
        """A value with its unit, as a report says it: `12 µm`."""
        factor, unit = _SAID.get(self.unit, (1.0, self.unit))
        return f'{factor * value:.3g} {unit}'.rstrip().replace('-', '−')


@dataclass(frozen=True)
class Effect:
    """One unmodelled effect: all that the project knows of it.

    Attributes
    ----------
    name : str
        As twin files and reports name it, without an axis.
    link : str
        Link of the chain on which it acts: servo, kinematic or sensor.
    parameters : tuple of Parameter
    model : str
        The equation and where it comes from, with year.
    sentence : str
        What a report says of a machine that has it; ``{width}`` stands for the value of a
        parameter.
    excited_by : str
        The motion that shows it, as the object of "measure".
    per_axis : bool
        Whether it is named with its axis, as in ``backlash.x``.
    reverses : bool
        Whether only a reversal of the axis shows it: a motion in one direction cannot.
    swings : bool
        Whether the loop may swing by it, at a phase that no second run repeats. The gap of a run
        then cannot confirm it, and a report lists it beside `unknown`.
    holds : tuple of str
        Effects that are special cases of this one: it must beat them clearly, and takes their
        place.
    sums : tuple of str
        Special cases whose sum may be all that there is: they are tried together in its place.
    differ : tuple of (str, str)
        Pairs of parameters; where the two of each are equal, a special case is all that there is.
    by_shape : bool
        Whether it is there is judged at the shape that was found: how large it is hangs on that.
    by_ratio : bool
        Whether it is judged at the ratio of its coefficients, too, which imitate one another.
    excludes : tuple of str
        Effects that cannot be judged beside this one, as both have the same trivial solution.
    merges : tuple of str
        Effects that together imitate this one: it is taken if it does as well as all of them.
    exact : bool
        Whether its model is exact, however large it is.
    scales : bool
        Whether it scales force against motion, as errors of other models seem to.
    along_travel : bool
        Whether it is a force along the travel.
    seen_by_encoder : bool
        False for what an encoder cannot show, which sees its own axis, and no frame or clock.
    needs_effort : str
        Why only a recorded force tells it; empty where a motion tells it, too.
    same : callable
        Values of all parameters -> effects that move encoder and tracker in the same way, with
        parameters of their own. No record tells them apart, and a report names both.
    states : tuple of str
        States of its own in the simulation of an axis, zero at the start (see
        :mod:`stage_twin.hooks`).
    order : int
        Of two effects that transform the same quantity, the lower one acts first.
    """

    name: str
    link: str
    parameters: tuple[Parameter, ...]
    model: str
    sentence: str
    excited_by: str
    per_axis: bool = True
    reverses: bool = False
    swings: bool = False
    holds: tuple[str, ...] = ()
    sums: tuple[str, ...] = ()
    differ: tuple[tuple[str, str], ...] = ()
    by_shape: bool = False
    by_ratio: bool = False
    excludes: tuple[str, ...] = ()
    merges: tuple[str, ...] = ()
    exact: bool = False
    scales: bool = False
    along_travel: bool = False
    seen_by_encoder: bool = True
    needs_effort: str = ''
    same: Callable[[Mapping[str, float]], tuple[str, ...]] = lambda values: ()
    states: tuple[str, ...] = ()
    order: int = 0

    def __post_init__(self) -> None:
        if self.link not in LINKS:
            raise ValueError(f'effect {self.name}: link must be one of {", ".join(LINKS)}')

    @property
    def scanned(self) -> bool:
        """Whether a fit takes the best of many values of a parameter."""
        return any(parameter.scanned for parameter in self.parameters)

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError where there is none."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    def defaults(self) -> dict[str, float]:
        """Every parameter at its value when on."""
        return {parameter.name: parameter.when_on for parameter in self.parameters}

    def is_on(self, values: Mapping[str, float]) -> bool:
        """Whether it does anything with these values (all its parameters)."""
        strengths = [p for p in self.parameters if p.neutral is not None]
        return not strengths or any(values[p.name] != p.neutral for p in strengths)

    def says(self, values: Mapping[str, float]) -> str:
        """The sentence with these values; a parameter not given stands at its value when on."""
        given = {**self.defaults(), **values}
        return self.sentence.format(**{p.name: p.said(given[p.name]) for p in self.parameters})
