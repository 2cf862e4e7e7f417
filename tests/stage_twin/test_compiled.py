"""What compiled loops of the twin may do."""

from __future__ import annotations

from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import config

import stage_twin.compiled
from stage_twin.compiled import compiled


def filled(values: np.ndarray) -> None:
    values[:] = 1.0


def allocated(count: int) -> np.ndarray:
    return np.zeros(count)


def test_a_compiled_loop_that_allocates_does_not_compile() -> None:
    values = np.zeros(3)
    compiled(filled)(values)
    assert values.tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(numba.core.errors.NumbaError, match='zeros'):
        compiled(allocated)(3)


@pytest.mark.parametrize('folder', ['', 'kept'])
def test_a_cache_belongs_to_one_state_of_the_sources(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, folder: str
) -> None:
    """With a folder for caches and without one, where they lie beside the sources."""
    outer = str(tmp_path / folder) if folder else ''
    monkeypatch.setattr(config, 'CACHE_DIR', outer)
    here = Path(compiled(filled)._cache.cache_path)  # type: ignore[attr-defined]
    beside = Path(stage_twin.compiled.__file__).parent / '__pycache__'
    assert here.parent == (Path(outer) if outer else beside) / f'twin-{stage_twin.compiled._STATE}'
    assert outer == config.CACHE_DIR
