"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = 'b72277766aa6'
DATE = '2026-11-24'
SESSIONS = {
    'own': 48,
    'mujoco': 48,
    'handmade': 48,
}
SEEDS = '1 to 12'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': 0.305532,
        'away': 0.640752,
        'turns': 0.414894,
    },
    'passed': {
        '1': -5.87801,
    },
    'unknown': {
        '1': 1.40017,
        'share': 0.516939,
    },
    'none': {
        '1': 3.29583,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (2.868, 0),
    'servo': (2.982, 1e-05),
    'kinematic': (1.796, 0),
    'sensor': (1.597, 1e-05),
}
