"""What a diagnosis found: everything that the reports say."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gap_diagnosis.closed_loop.channels import Channel
from gap_diagnosis.evidence.judgement import Cause
from gap_diagnosis.evidence.localise import Condition
from gap_diagnosis.input.data import Record
from gap_diagnosis.law.judged import Law
from gap_diagnosis.parameters import Parameters, plain_values
from gap_diagnosis.residuals.drive_law import DriveLaw
from gap_diagnosis.residuals.nominal import merged
from gap_diagnosis.selection.parts import Part
from stage_core.quantities import UNKNOWN
from stage_core.twin_file import TwinFile

if TYPE_CHECKING:
    from gap_diagnosis.experiment.design import Experiment
    from gap_diagnosis.report.model import Mended


@dataclass
class Diagnosis:
    """Everything that the reports say."""

    twin_name: str
    twin: TwinFile
    records: list[Record]
    parts: list[Part]
    channels: dict[str, Channel]
    windows: list[tuple[float, float]]
    before: float
    after: float
    noise_floor: float
    parameters: Parameters
    causes: list[Cause]
    verdict: list[str]
    conditions: list[Condition]
    axes_share: dict[str, float]
    link: str
    unexplained: float
    #: Wall time at which the first session begins [ns].
    started: int = 0
    warnings: list[str] = field(default_factory=list)
    laws: list[Law] = field(default_factory=list)
    #: What became of the user's own model, where the twin was read from one.
    model: Mended | None = None
    #: By axis, what stands for the forces where none are recorded.
    drives: dict[str, DriveLaw] = field(default_factory=dict)
    #: Accepted effects that the loop is run without, as no second run repeats what they do.
    unrepeated: tuple[str, ...] = ()
    #: Whether stated frictions hold and give way as the twin's file says. `before` is always of
    #: the twin of the file; the effects are judged beside the twin that rests as the machine does.
    rests_as_stated: bool = True
    #: The motion that would decide what is open, where there is one.
    experiment: Experiment | None = None

    @property
    def sessions(self) -> list[str]:
        """Names of the sessions."""
        return [record.name for record in self.records]

    @property
    def accepted(self) -> list[str]:
        """Effects of the verdict; `unknown` is none."""
        return [name for name in self.verdict if name != UNKNOWN]

    @property
    def structured(self) -> bool:
        """Whether something that no effect explains is left."""
        return UNKNOWN in self.verdict

    @property
    def shrink(self) -> float:
        """1 - after / before; 0 where there is no gap, as without any noise."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 0.0

    @property
    def simulators(self) -> list[str]:
        """The bags of a simulator that stand in place of the twin's prediction."""
        return [r.simulated.name for r in self.records if r.simulated is not None]

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """The accepted effects as a twin file holds them."""
        return plain_values({n: self.parameters[n] for n in self.accepted})

    @property
    def run_effects(self) -> dict[str, dict[str, float]]:
        """Those with which the corrected twin is run beside the record."""
        return {n: v for n, v in self.effects.items() if n not in self.unrepeated}

    @property
    def corrected_twin(self) -> TwinFile:
        """The nominal twin with the accepted effects and the laws of the remainder in it."""
        laws = [law for law in self.laws if law.runs]
        replaced = {name for law in laws for name in law.instead}
        named = {n: v for n, v in self.effects.items() if n not in replaced}
        return merged(self.twin, named | {law.effect: law.values for law in laws})
