"""Model files of other simulators (MJCF, URDF): read into a twin, and mended as text."""

from __future__ import annotations

from pathlib import Path

from stage_core.errors import StageError
from stage_twin.models.mjcf import Mjcf
from stage_twin.models.urdf import Urdf
from stage_twin.models.xml_text import XmlText

Model = Mjcf | Urdf
ENDINGS = ('.xml', '.mjcf', '.urdf')


def is_model(path: str | Path) -> bool:
    """Whether a path names a model file and no twin file."""
    return Path(path).suffix.lower() in ENDINGS


def read_model(path: str | Path) -> Model:
    """The model of a file, by its root element.

    Raises
    ------
    StageError
        If the file is of neither form, or says what a twin cannot be made of.
    """
    root = XmlText(path).elements[0].tag
    if root not in ('mujoco', 'robot'):
        raise StageError(f'{path} is neither MJCF nor URDF (its root is <{root}>): give one')
    return Mjcf(path) if root == 'mujoco' else Urdf(path)
