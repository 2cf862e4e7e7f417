"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = 'b09aac0051ed'
DATE = '2026-11-24'
SESSIONS = {
    'own': 48,
    'mujoco': 48,
    'handmade': 48,
}
SEEDS = '1 to 12'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': -0.0485761,
        'away': 0.656278,
        'surely': 0.626509,
    },
    'passed': {
        '1': -5.61705,
    },
    'unknown': {
        '1': 0.463846,
        'share': 0.539252,
    },
    'none': {
        '1': 3.13549,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (4.582, 0),
    'servo': (3.625, 0),
    'kinematic': (1.264, 0),
    'sensor': (9.249, 0),
}
