"""What compiled loops of the twin may do."""

from __future__ import annotations

import numba
import numpy as np
import pytest

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
