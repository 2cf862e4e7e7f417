"""The rules of a selection, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from gap_diagnosis.residuals.regression import Fit
from stage_twin.effects.term import Term, Theta


@dataclass(frozen=True)
class Rules:
    """When a gain counts.

    Attributes
    ----------
    of_gap : least share of the whole gap's mean square above the noise
    of_rest : least share of what the set without the effect leaves above the noise
    of_signal : least share of the variance of the whole signal that an effect can follow
        (`Term.follows`); the step of another integrator leaves 1e-4 of the force
    of_noise : least share of the noise's mean square
    level : of the bootstrap interval
    largest : number of effects in a set
    given : effects that every set is grown with; they too are left out in the end if they can be
    kept : effects that every set holds, as their larger part was taken out before
    prefer_plain : whether a special case takes its holder's place wherever the data bear it
    """

    of_gap: float = 1e-4
    of_rest: float = 0.10
    of_signal: float = 1e-4
    of_noise: float = 0.03
    level: float = 0.98
    largest: int = 10
    given: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    prefer_plain: bool = False


@dataclass
class Evidence:
    """What speaks for one effect of the accepted set, or against a rejected one."""

    name: str
    gain: float
    interval: tuple[float, float]
    share: float  # of the residual that is left without it
    admissible: bool
    alternatives: list[str] = field(default_factory=list)


class Passed(NamedTuple):
    """An effect that another one was taken before."""

    share: float  # gain over that of the other one
    before: list[str]  # set until then
    plainer: bool  # whether it has fewer parameters than the other one


class Trial(NamedTuple):
    """An effect beside a set: what it gains, in which shape, the nonlinear parameters of all."""

    evidence: Evidence
    thetas: dict[str, Theta]
    shape: Term

    @property
    def odd(self) -> bool:
        """Whether no machine has the effect at the θ that explains most."""
        return not self.shape.usual(self.thetas[self.evidence.name])


@dataclass
class Selection:
    """Accepted effects in the order of acceptance, the fit with all of them, and evidence."""

    accepted: list[str]
    fit: Fit
    evidence: dict[str, Evidence]
    rejected: dict[str, Evidence]
