"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""

CODE = ''
DATE = ''
SESSIONS: dict[str, int] = {}
SEEDS: dict[str, str] = {}
WEIGHTS: dict[str, dict[str, float]] = {
    'named': {'1': 0.6, 'strength': 1.1},
    'passed': {'1': -6.0, 'rival': 4.0},
    'unknown': {'1': 1.5},
    'none': {'1': 2.2},
}
SPREAD: dict[str, tuple[float, float]] = {
    'servo': (1.0, 0.0),
    'friction': (1.0, 0.0),
    'kinematic': (1.0, 0.0),
    'sensor': (1.0, 0.0),
}
