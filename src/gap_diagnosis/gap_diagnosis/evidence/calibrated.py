"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = '8e876096d60d'
DATE = '2026-11-26'
SESSIONS = {
    'own': 72,
    'mujoco': 72,
    'handmade': 72,
}
SEEDS = '1 to 18'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': 1.07362,
        'away': 0.80042,
        'rivals': -0.796001,
    },
    'passed': {
        '1': -6.23692,
    },
    'unknown': {
        '1': 2.09714,
    },
    'none': {
        '1': 3.55535,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (3.353, 0),
    'servo': (2.982, 0),
    'kinematic': (1.264, 0),
    'sensor': (1.477, 0),
}
