"""Parameters of the calibrator's node."""

from __future__ import annotations

from calibrator.models import METHODS
from calibrator.prepare import INPUTS, TARGETS
from calibrator.temperatures import STALE
from stage_core.parameters import Parameter

PARAMETERS = (
    Parameter('bag', '', 'bag or folder of bags to train from; empty: what was heard live'),
    Parameter('method', 'structured', 'calibration method', choices=tuple(METHODS)),
    Parameter('options', '{}', 'options of the method, a JSON object'),
    Parameter('input', 'reference', 'model input', choices=INPUTS),
    Parameter('target', 'tracker', 'model output', choices=TARGETS),
    Parameter('seed', 0, 'seed of the training', minimum=0, maximum=2**31 - 1),
    Parameter('machine', '', 'name of the stage; models of another one are refused'),
    Parameter(
        'model_folder', 'bags/models', 'folder that new models are written to', read_only=True
    ),
    Parameter('model_file', '', 'model to load at the start and with ~/load'),
    Parameter('max_correction', 1e-3, 'larger corrections are refused', 'm', 0.0, 1.0),
    Parameter(
        'temperature_timeout', STALE, 'a sensor not heard for longer is silent', 's', 1.0, 86_400.0
    ),
    Parameter('adapt', False, 'adapt the model to the rests heard while the stage runs'),
    Parameter('adapt_drift', 1e-6, 'size of the drift to follow', 'm', 1e-12, 1e-2),
    Parameter('adapt_noise', 1e-6, 'deviation of a measured point', 'm', 1e-12, 1e-2),
    Parameter('adapt_forgetting', 0.99, 'weight of a rest relative to the next', '', 0.5, 1.0),
    Parameter(
        'buffer_size', 300_000, 'messages kept per topic', '', 100, 10_000_000, read_only=True
    ),
)
