"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = 'f8326f29f171'
DATE = '2026-11-25'
SESSIONS = {
    'own': 72,
    'mujoco': 72,
    'handmade': 72,
}
SEEDS = '1 to 18'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': 4.49758,
    },
    'passed': {
        '1': -6.38236,
    },
    'unknown': {
        '1': 1.40263,
        'left': 0.502965,
    },
    'none': {
        '1': 2.45674,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (8.227, 0),
    'servo': (2.868, 0),
    'kinematic': (1.264, 0.001477),
    'sensor': (1.477, 0),
}
