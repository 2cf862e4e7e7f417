"""Arrays and numbers of a model's state as JSON, and back, to the bit."""

from __future__ import annotations

from typing import Any

import numpy as np


def to_json(value: Any) -> Any:
    """Arrays as tagged nested lists; other JSON values unchanged."""
    if isinstance(value, np.ndarray):
        kind = 'int' if value.dtype.kind in 'iub' else 'float'
        return {'array': value.tolist(), 'shape': list(value.shape), 'kind': kind}
    if isinstance(value, dict):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def from_json(value: Any) -> Any:
    """Inverse of :func:`to_json`."""
    if isinstance(value, dict):
        if set(value) == {'array', 'shape', 'kind'}:
            kind = np.int64 if value['kind'] == 'int' else np.float64
            return np.asarray(value['array'], dtype=kind).reshape(value['shape'])
        return {key: from_json(item) for key, item in value.items()}
    if isinstance(value, list):
        return [from_json(item) for item in value]
    return value
