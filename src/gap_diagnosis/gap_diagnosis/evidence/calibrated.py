"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = '5f4d6bcab334'
DATE = '2026-11-23'
SESSIONS = {
    'own': 12,
    'mujoco': 10,
    'handmade': 10,
}
SEEDS = '1 to 3'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': -0.213602,
        'strength': 0.387095,
    },
    'passed': {
        '1': -4.81993,
    },
    'unknown': {
        '1': -1.29928,
    },
    'none': {
        '1': 1.94591,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (1, 0),
    'servo': (1, 0),
    'kinematic': (1, 0),
    'sensor': (1, 0),
}
