"""Cross-coupled control: the correction along the contour's normal (eqs. 1-2, 21-22)."""

from __future__ import annotations

from numba import njit


@njit(cache=True)
def along_normal(amount: float, sine: float, cosine: float) -> tuple[float, float]:
    """Share a correction between the axes: C_x = -sin(t), C_y = cos(t) (eqs. 1 and 2).

    `amount` is K_c E' of the classical controller [m/s], or U_cmac of eqs. 21 and 22;
    t is the tangent's angle at the current position command.
    """
    return -sine * amount, cosine * amount
