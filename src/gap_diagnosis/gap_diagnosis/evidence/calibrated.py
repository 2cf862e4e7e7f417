"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = 'c29ef4bc4c4c'
DATE = '2026-11-25'
SESSIONS = {
    'own': 72,
    'mujoco': 65,
    'handmade': 63,
}
SEEDS = '1 to 18'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': 4.06781,
    },
    'passed': {
        '1': -5.95911,
    },
    'unknown': {
        '1': 1.60944,
    },
    'none': {
        '1': 2.26868,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (2.551, 0.02454),
    'servo': (2.982, 0),
    'kinematic': (1.264, 0.001477),
    'sensor': (1.477, 0),
}
