"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = '2951d3b51c14'
DATE = '2026-11-25'
SESSIONS = {
    'own': 72,
    'mujoco': 72,
    'handmade': 72,
}
SEEDS = '1 to 18'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': 0.521554,
        'away': 0.934292,
    },
    'passed': {
        '1': -6.0271,
    },
    'unknown': {
        '1': 1.51259,
    },
    'none': {
        '1': 2.45674,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (2.551, 0.02454),
    'servo': (2.982, 0),
    'kinematic': (1.264, 0.001477),
    'sensor': (1.477, 0),
}
