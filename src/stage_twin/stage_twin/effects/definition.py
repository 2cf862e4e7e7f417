"""What an effect of the twin is: a name, its place in the chain, and physical parameters."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect, with the range in which its model holds.

    Attributes
    ----------
    default_when_on : float
        Value taken where a twin file switches the effect on without naming the parameter.
    nuisance : bool
        True for what belongs to a session and not to the machine (a phase, an offset): it is
        refitted per session.
    fitted : bool
        False for geometry that the user states (a period, a reference position) and that data
        of one session cannot determine.
    """

    name: str
    unit: str
    minimum: float
    maximum: float
    default_when_on: float
    description: str
    nuisance: bool = False
    fitted: bool = True


@dataclass(frozen=True)
class Effect:
    """One unmodelled effect.

    Attributes
    ----------
    link : str
        Link of the chain on which it acts: servo, kinematic or sensor.
    per_axis : bool
        Whether it is named with its axis, as in ``backlash.x``.
    description : str
        The model and where it comes from.
    """

    name: str
    link: str
    per_axis: bool
    parameters: tuple[EffectParameter, ...]
    description: str

    def parameter(self, name: str) -> EffectParameter:
        """The parameter of that name; KeyError where there is none."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    def defaults(self) -> dict[str, float]:
        """Every parameter at its value when on."""
        return {parameter.name: parameter.default_when_on for parameter in self.parameters}
