"""One table of all methods on the same samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calibrator.models import METHODS
from calibrator.samples import Samples
from calibrator.training import Training, train
from stage_core.errors import StageError


def compare(
    samples: Samples,
    methods: Sequence[str] = tuple(METHODS),
    options: dict[str, dict[str, Any]] | None = None,
    seed: int = 0,
    by: str = 'position',
) -> dict[str, Training | StageError]:
    """Train each method on the same split; one that cannot be trained keeps its error."""
    results: dict[str, Training | StageError] = {}
    for method in methods:
        try:
            results[method] = train(samples, method, (options or {}).get(method), seed, by)
        except StageError as error:
            results[method] = error
    return results


def table(results: dict[str, Training | StageError]) -> str:
    """The results as text, lengths in micrometres, held-out errors, sorted by their RMS."""
    rows = []
    trained = {m: r for m, r in results.items() if isinstance(r, Training)}
    for method, result in sorted(trained.items(), key=lambda item: item[1].after.rms):
        after = result.after
        rows.append(
            f'{method:18s} {1e6 * after.rms:10.3f} {1e6 * after.mae:10.3f} '
            f'{1e6 * after.max:10.3f} {1e6 * after.sigma:10.3f} '
            f'{1e6 * result.train_after.rms:10.3f} {result.seconds:8.2f}  {result.gain}'
        )
    failures = [f'{m:18s} {r}' for m, r in results.items() if isinstance(r, StageError)]
    header = f'{"held-out µm":18s} {"RMS":>10s} {"MAE":>10s} {"max":>10s} {"sigma":>10s} '
    return '\n'.join([header + f'{"train RMS":>10s} {"fit s":>8s}', *rows, *failures])
