"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = 'bd8aa0fe6b0e'
DATE = '2026-11-25'
SESSIONS = {
    'own': 72,
    'mujoco': 72,
    'handmade': 72,
}
SEEDS = '1 to 18'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': 4.97673,
    },
    'passed': {
        '1': -6.06502,
    },
    'unknown': {
        '1': 1.36949,
    },
    'none': {
        '1': 2.45674,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (4.075, 0),
    'servo': (2.982, 0),
    'kinematic': (1.264, 0.001477),
    'sensor': (1.477, 0),
}
