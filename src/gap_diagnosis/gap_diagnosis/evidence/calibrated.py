"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = '9f9da69ae160'
DATE = '2026-11-30'
SESSIONS = {
    'own': 300,
    'mujoco': 300,
    'handmade': 300,
}
SEEDS = '1 to 75'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': -1.21638,
        'strength': 0.589398,
        'away': 0.65248,
    },
    'passed': {
        '1': -6.30177,
    },
    'unknown': {
        '1': 1.99712,
        'share': 0.59863,
    },
    'none': {
        '1': 0.904302,
        'turns': 0.753357,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (3.769, 0),
    'servo': (2.653, 0),
    'kinematic': (1, 0),
    'sensor': (1.04, 0),
}
