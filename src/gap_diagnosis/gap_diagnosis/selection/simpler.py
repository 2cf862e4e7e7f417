"""Simpler sets that explain as much: one effect for two, a special case for its holder."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gap_diagnosis.residuals.regression import Fit
from gap_diagnosis.selection.gains import block_gains, bootstrap_interval
from gap_diagnosis.selection.grow import grow
from gap_diagnosis.selection.possible import as_good
from stage_twin.effects import EFFECTS

if TYPE_CHECKING:
    from gap_diagnosis.selection.forward import Selector


def merge(selector: Selector, accepted: list[str], fit: Fit) -> tuple[list[str], Fit]:
    """Replace two effects, and what the single one holds, by one that explains as much."""
    for name in selector.problem.terms:
        effect, _, axis = name.partition('.')
        pair = [f'{other}.{axis}' for other in EFFECTS[effect].merges]
        if not pair or any(p not in accepted for p in pair):
            continue
        held = {*pair, *selector.replaced(name, accepted)}
        kept = selector.regression.linear({n: t for n, t in fit.thetas.items() if n not in held})
        thetas = {**kept.thetas, name: selector.regression.warm_start(kept, name)}
        shape = selector.problem.terms[name]
        other = grow(selector, selector.regression.refine(thetas, list(thetas)), [name])
        if (
            other.size < fit.size
            and as_good(selector, other, fit)
            and selector.admissible(other, name)
        ):
            return [a for a in accepted if a not in held] + [name], other
        selector.problem.terms[name] = shape
    return accepted, fit


def plain(selector: Selector, accepted: list[str], fit: Fit) -> tuple[list[str], Fit]:
    """Replace effects by special cases of theirs that lose nothing significant.

    Where the rules do not prefer what is plain, these are effects of which a pair of parameters
    has to differ (`Effect.differ`), and the loss is nothing certain at all.
    """
    prefer = selector.rules.prefer_plain
    for name in list(accepted):
        effect, _, axis = name.partition('.')
        if not prefer and not EFFECTS[effect].differ:
            continue
        for held in EFFECTS[effect].holds:
            special = f'{held}.{axis}'
            if special not in selector.problem.terms or special in accepted:
                continue
            less = selector.without_effect(fit, name)
            thetas = selector.with_effect(less, special).thetas
            other = selector.regression.refine(thetas, list(thetas))
            loss = block_gains(selector.problem, other, fit)
            gain = float(block_gains(selector.problem, less, fit).mean())
            low, _ = bootstrap_interval(loss, selector.seed, level=selector.rules.level)
            close = low <= 0.0 or (prefer and float(loss.mean()) < 0.05 * gain)
            if close and selector.admissible(other, special):
                accepted, fit = [special if a == name else a for a in accepted], other
                break
    return accepted, fit
