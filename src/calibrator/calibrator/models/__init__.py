"""The calibration methods by the name that a user chooses."""

from __future__ import annotations

from typing import Any

from calibrator.models.base import CalibrationModel
from calibrator.models.black_box import GaussianProcess, GradientBoosting, Perceptron
from calibrator.models.it2fls import FuzzySystem, Hybrid
from calibrator.models.linear import Affine, Identity, Polynomial
from calibrator.models.local_linear import LocalLinear
from calibrator.models.structured import Structured
from calibrator.models.thermal_model import Thermal
from stage_core.errors import StageError

METHODS: dict[str, type[CalibrationModel]] = {
    cls.method: cls
    for cls in (
        Identity,
        Affine,
        Polynomial,
        Structured,
        FuzzySystem,
        Hybrid,
        Thermal,
        LocalLinear,
        Perceptron,
        GaussianProcess,
        GradientBoosting,
    )
}


def make_model(method: str, **options: Any) -> CalibrationModel:
    """An unfitted model of a method.

    Raises
    ------
    StageError
        For a method or an option that does not exist.
    """
    return _class_of(method)(**options)


def model_from_dict(content: dict[str, Any]) -> CalibrationModel:
    """The model that `CalibrationModel.to_dict` described."""
    return _class_of(str(content.get('method'))).from_dict(content)


def _class_of(method: str) -> type[CalibrationModel]:
    if method not in METHODS:
        raise StageError(
            f'there is no calibration method {method}: choose one of {", ".join(METHODS)}'
        )
    return METHODS[method]
