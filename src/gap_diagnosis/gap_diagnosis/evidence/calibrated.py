"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = '722204b66b4b'
DATE = '2026-11-26'
SESSIONS = {
    'own': 72,
    'mujoco': 72,
    'handmade': 72,
}
SEEDS = '1 to 18'
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {
        '1': -0.00904343,
        'turns': 0.541631,
        'away': 0.583243,
    },
    'passed': {
        '1': -6.18872,
    },
    'unknown': {
        '1': 2.13163,
    },
    'none': {
        '1': 3.55535,
    },
}
SPREAD: dict[str, tuple[float, float]] = {
    'friction': (6.769, 0),
    'servo': (2.982, 0),
    'kinematic': (1.264, 0.001477),
    'sensor': (1.477, 0),
}
