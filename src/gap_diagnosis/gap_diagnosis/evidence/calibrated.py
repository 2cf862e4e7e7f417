"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = 'e6922ae2f1c6'
DATE = '2026-11-23'
SESSIONS = {
    'own': 24,
    'mujoco': 24,
    'handmade': 24,
}
SEEDS = '1 to 6'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': -2.20281,
        'strength': 0.417343,
        'away': 0.67446,
    },
    'passed': {
        '1': -5.56055,
    },
    'unknown': {
        '1': 0.325336,
        'share': 0.397696,
    },
    'none': {
        '1': 1.94591,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (1.081, 0.00236),
    'servo': (3.625, 0),
    'kinematic': (1, 0),
    'sensor': (8.895, 0),
}
