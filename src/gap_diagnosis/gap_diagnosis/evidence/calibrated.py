"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = '7a834c1b7126'
DATE = '2026-11-25'
SESSIONS = {
    'own': 72,
    'mujoco': 72,
    'handmade': 72,
}
SEEDS = '1 to 18'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': 0.197658,
        'strength': 0.79504,
        'away': 0.392094,
    },
    'passed': {
        '1': -6.23528,
    },
    'unknown': {
        '1': 1.36949,
    },
    'none': {
        '1': 2.45674,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (4.582, 0),
    'servo': (2.982, 0),
    'kinematic': (1.264, 0.001477),
    'sensor': (1.477, 0),
}
