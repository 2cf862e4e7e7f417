"""The user's own model: what was found goes back into its file, and MuJoCo runs it again."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gap_diagnosis.closed_loop.own_model import OwnModel, save
from gap_diagnosis.residuals.nominal import merged
from gap_diagnosis.result import Diagnosis
from stage_core.pages import Page
from stage_core.twin_file import TwinFile
from stage_core.wording import effect_words, measure
from stage_twin.models import Model
from stage_twin.models.mjcf import Mjcf
from stage_twin.models.plant import corrected, instruments
from stage_twin.models.unsaid import unsaid
from stage_twin.models.xml_text import Change

MODEL, PATCH = 'corrected_model.xml', 'corrected_model.patch'


@dataclass(frozen=True)
class Mended:
    """What became of a model.

    Attributes
    ----------
    changes : attributes of the file with their old and new values
    unsaid : effects that the file cannot say -> the reason
    notes : what of the model the twin does not have
    encoder : RMS over the held-out ticks of all axes [m] of encoder minus that of the model in
        MuJoCo itself: as it was, as it is now; None for a URDF
    """

    path: str
    form: str
    changes: list[Change]
    unsaid: dict[str, str]
    notes: list[str]
    encoder: tuple[float, float] | None

    def as_dict(self) -> dict[str, Any]:
        """The entry `model` of report.json."""
        out: dict[str, Any] = {
            'file': self.path,
            'form': self.form,
            'changes': [
                {'element': c.where, 'attribute': c.attribute, 'old': c.old, 'new': c.new}
                for c in self.changes
            ],
            'cannot_say': [{'effect': n, 'reason': why} for n, why in self.unsaid.items()],
            'not_read': self.notes,
        }
        if self.encoder is not None:
            out['encoder'] = {'unit': 'm', 'before': self.encoder[0], 'after': self.encoder[1]}
        return out


def mend(model: Model, controller: TwinFile, found: Diagnosis, out: Path) -> Mended:
    """Write the corrected model and its patch into `out`, and run both models."""
    before = model.text.text
    wanted = corrected(model.plants, found.effects)
    runs = None
    if isinstance(model, Mjcf):
        plain = OwnModel(model, instruments(controller), found.records, out / MODEL)
        mended = replace(plain, controller=instruments(merged(controller, found.effects)))
        wanted = mended.refined(wanted)
        save(out / MODEL, model.write(wanted))
        runs = plain.gap(model.path), mended.gap(out / MODEL)
    else:
        save(out / MODEL, model.write(wanted))
    save(out / PATCH, _patch(before, model.text.text, model.path.name))
    said = model.form
    return Mended(
        str(model.path), said, model.text.changes, unsaid(found.effects, said), model.notes, runs
    )


def _patch(before: str, after: str, name: str) -> str:
    old, new = before.splitlines(keepends=True), after.splitlines(keepends=True)
    return ''.join(difflib.unified_diff(old, new, f'a/{name}', f'b/{name}'))


def section(page: Page, mended: Mended) -> None:
    """What changes in the model, and what has no place in it."""
    page.heading('Your model')
    if mended.encoder is not None:
        before, after = (measure(value) for value in mended.encoder)
        page.text(
            f'Simulated by MuJoCo itself, the encoder of your model is {before} RMS off the '
            f'recorded one. With the patch it is {after}.'
        )
    if mended.changes:
        rows: list[list[object]] = [
            [c.where, c.attribute, 'default' if c.old is None else c.old, c.new]
            for c in mended.changes
        ]
        page.table(
            ['element', 'attribute', 'was', 'is'],
            rows,
            f'`{PATCH}` holds these changes; `patch -p1 < {PATCH}` makes them in the folder of '
            f'`{Path(mended.path).name}`, `{MODEL}` is the whole file',
        )
    else:
        page.text('Nothing of what was found is a number of this file: the patch is empty.')
    if mended.unsaid:
        page.table(
            ['effect', f'what {mended.form} lacks'],
            [[effect_words(name), why] for name, why in mended.unsaid.items()],
            'what this file cannot say',
        )
    page.items([f'Not read: {note}.' for note in mended.notes])
