"""Friction, CMAC, the learning laws and the tick against independent oracles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import butter, filtfilt

from benchmarks.paper3_rig import norm_optimal_update
from contour_ctrl import cmac, curves, friction, ilc, reference
from contour_ctrl.cmac import CmacSettings
from contour_ctrl.friction import LuGre
from contour_ctrl.learning import FIRST_BAND, Learner, LearningSettings
from contour_ctrl.reinforcement import LearningRate, defuzzified
from contour_ctrl.tick import Controller, Gains
from stage_core.errors import StageError
from stage_core.twin_file import ServoAxis

from ..config_files import section

MODEL = LuGre(20.0, 30.0, 1e-3, 1e5, 100.0, 5.0)
#: Of the closed loop of x with K_p = 40 1/s.
IMPULSE = ilc.closed_loop_impulse(ServoAxis(18.0, 40.0), 40.0, 1e-3, 4000)


def test_lugre_agrees_with_a_stiff_integrator() -> None:
    def velocity(t: float) -> float:
        return 0.02 * np.sin(2 * np.pi * t)

    def level(v: float) -> float:
        return (20.0 + 10.0 * np.exp(-((v / 1e-3) ** 2))) / 1e5

    oracle = solve_ivp(
        lambda t, z: velocity(t) - abs(velocity(t)) / level(velocity(t)) * z,
        (0, 1),
        [0.0],
        method='LSODA',
        rtol=1e-9,
        atol=1e-14,
        dense_output=True,
        max_step=1e-3,
    )
    fine = 1e-4
    t = fine * np.arange(10000)
    # The velocity of each step's middle; the force belongs to the step's end.
    force = friction.lugre_force(MODEL.packed(), 0.02 * np.sin(2 * np.pi * (t + fine / 2)), fine)
    z = oracle.sol(t + fine)[0]
    v = 0.02 * np.sin(2 * np.pi * (t + fine))
    rate = v - np.abs(v) / ((20.0 + 10.0 * np.exp(-((v / 1e-3) ** 2))) / 1e5) * z
    expected = 1e5 * z + 100.0 * rate + 5.0 * v
    assert np.sqrt(np.mean((force - expected) ** 2)) < 0.15


def test_lugre_is_stable_where_explicit_euler_diverges() -> None:
    for velocity in (0.6, -0.6, 1e-4):
        force = friction.lugre_force(MODEL.packed(), np.full(60000, velocity), 1e-3)
        # Eqs. 7 and 8 with dz/dt = 0.
        level = MODEL.coulomb + (MODEL.static - MODEL.coulomb) * np.exp(
            -((velocity / MODEL.stribeck_velocity) ** 2)
        )
        assert force[-1] == pytest.approx(level * np.sign(velocity) + MODEL.viscous * velocity)
        assert np.abs(force).max() < 200.0
    with pytest.raises(StageError, match='static at least coulomb'):
        LuGre(20.0, 10.0, 1e-3, 1e5)


def test_cmac_learns_a_function_and_generalises_locally() -> None:
    settings = CmacSettings(layers=8, cells=20, limit=10.0)
    weights = settings.empty_weights()
    rng = np.random.default_rng(0)

    def target(x: float, y: float) -> float:
        return float(np.sin(3 * x) * np.cos(2 * y))

    for x, y in rng.uniform(0, 1, (20000, 2)):
        wrong = target(x, y) - cmac.output(weights, x, y)
        cmac.update(weights, x, y, 0.5 * wrong, 1.0, 10.0)
    probes = rng.uniform(0.05, 0.95, (500, 2))
    error = [cmac.output(weights, x, y) - target(x, y) for x, y in probes]
    assert np.sqrt(np.mean(np.square(error))) < 0.03
    before = cmac.output(weights, 0.9, 0.9)
    cmac.update(weights, 0.1, 0.1, 5.0, 1.0, 10.0)
    assert cmac.output(weights, 0.9, 0.9) == before


def test_cmac_update_changes_the_output_by_the_increment_within_its_limit() -> None:
    weights = CmacSettings(layers=5, cells=10).empty_weights()
    cmac.update(weights, 0.43, 0.71, 0.02, 1.0, 0.05)
    assert cmac.output(weights, 0.43, 0.71) == pytest.approx(0.02)
    assert np.count_nonzero(weights) == 5
    for _ in range(9):
        cmac.update(weights, 0.43, 0.71, 0.02, 1.0, 0.05)
    assert cmac.output(weights, 0.43, 0.71) == pytest.approx(0.05)
    for corner in ((0.0, 0.0), (1.0, 1.0), (-3.0, 7.0)):
        assert np.isfinite(cmac.output(weights, *corner))
    with pytest.raises(StageError, match='CMAC update'):
        CmacSettings(mode='other')


def test_literal_cmac_learns_nothing_from_a_constant_contour_error() -> None:
    ref = reference.plan(curves.circle(0.02), 0.05)
    normal = np.column_stack([-np.sin(ref.angle), np.cos(ref.angle)])
    q = ref.position - 1e-5 * normal
    taught = {}
    for mode, rate in (('gradient', 2000.0), ('literal', 60.0)):
        controller = Controller(ref, Gains(cmac=CmacSettings(rate=rate, mode=mode)))
        for k in range(len(ref)):
            controller.tick(k, *q[k])
        before = controller.weights.copy()
        for k in range(len(ref)):
            controller.tick(k, *q[k])
        taught[mode] = np.abs(controller.weights - before).max()
    assert taught['gradient'] > 1e-4
    assert taught['literal'] < 1e-7


def test_tick_is_the_control_law_of_the_paper() -> None:
    ref = reference.plan(curves.eight(0.06, 0.03), 0.05)
    gains = Gains((41.0, 37.0), (0.9, 1.1), (0.01, 0.02), 25.0)
    controller = Controller(ref, gains)
    rng = np.random.default_rng(3)
    controller.learned[:] = rng.normal(size=controller.learned.shape)
    for k in (0, 5, 700, len(ref) - 1):
        e = rng.uniform(-5e-6, 5e-6, 2)
        command = controller.tick(k, *(ref.position[k] - e))
        sine, cosine = np.sin(ref.angle[k]), np.cos(ref.angle[k])
        contour = -sine * e[0] + cosine * e[1]
        expected = (
            np.array([0.9, 1.1]) * ref.velocity[k]
            + np.array([0.01, 0.02]) * ref.acceleration[k]
            + np.array([41.0, 37.0]) * e
            + controller.learned[k]
            + 25.0 * contour * np.array([-sine, cosine])
        )
        assert command == pytest.approx(expected, rel=1e-6, abs=1e-9)
        assert controller.record[k, 2:4] == pytest.approx(e, abs=1e-15)
        assert controller.record[k, 5] == pytest.approx(contour, abs=1e-15)


def test_friction_term_puts_the_models_force_through_the_velocity_loop() -> None:
    ref = reference.plan(curves.circle(0.02), 0.05)
    model = LuGre(20.0, 25.0, 2e-3, 1e6)
    pair = (3600.0, 1600.0), (90000.0, 40000.0)
    plain = Controller(ref, Gains(velocity_feedforward=(0.0, 0.0)))
    helped = Controller(
        ref,
        Gains(
            velocity_feedforward=(0.0, 0.0),
            friction=(model, model),
            velocity_gain=pair[0],
            integral_gain=pair[1],
        ),
    )
    extra = np.array(
        [
            helped.tick(k, *ref.position[k]) - plain.tick(k, *ref.position[k])
            for k in range(len(ref))
        ]
    )
    for axis in range(2):
        integral = np.concatenate([[0.0], np.cumsum(pair[1][axis] * extra[:-1, axis] * 1e-3)])
        force = pair[0][axis] * extra[:, axis] + integral
        expected = friction.lugre_force(model.packed(), ref.velocity[:, axis].copy(), 1e-3)
        assert force == pytest.approx(expected, abs=1e-6)


def test_zero_phase_filter_is_filtfilt_and_shifts_nothing() -> None:
    t = 1e-3 * np.arange(4000)
    signal = np.sin(2 * np.pi * 3 * t) + 0.3 * np.sin(2 * np.pi * 200 * t)
    found = ilc.zero_phase_lowpass(signal, 25.0, 1e-3)
    b, a = butter(2, 25.0, fs=1000.0)
    assert found[500:-500] == pytest.approx(filtfilt(b, a, signal)[500:-500], abs=1e-6)
    assert found[500:-500] == pytest.approx(np.sin(2 * np.pi * 3 * t)[500:-500], abs=2e-3)
    with pytest.raises(StageError, match='ilc_cutoff'):
        ilc.zero_phase_lowpass(signal, 600.0, 1e-3)


def test_norm_optimal_update_solves_the_dense_problem() -> None:
    rng = np.random.default_rng(1)
    axis = ServoAxis(18.0, 40.0)
    impulse = ilc.closed_loop_impulse(axis, 40.0, 1e-3, 120)
    count = 120
    dense = np.array(
        [[impulse[i - j] if i >= j else 0.0 for j in range(count)] for i in range(count)]
    )
    learned, error = rng.normal(size=count), 1e-3 * rng.normal(size=count)
    weight, change = 1e-8, 3e-8
    expected = np.linalg.solve(
        dense.T @ dense + (weight + change) * np.eye(count),
        dense.T @ (error + dense @ learned) + change * learned,
    )
    found = norm_optimal_update(learned, error, impulse, weight, change)
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_closed_loop_impulse_has_the_loops_gain() -> None:
    # A constant learned velocity of 1 m/s leaves an error of 1 / K_p at steady state.
    assert IMPULSE.sum() == pytest.approx(1 / 40.0, rel=1e-6)


def test_convergence_factor_tells_stable_from_unstable_learning() -> None:
    rng = np.random.default_rng(2)
    first = ilc.zero_phase_lowpass(rng.normal(size=3000), 20.0, 1e-3)[:, None] * 1e-5
    for gain, stable in ((20.0, True), (200.0, False)):
        factor = ilc.convergence_factor(IMPULSE, gain, 25.0, 1e-3)
        assert (factor < 1.0) == stable
        learned, norms = np.zeros_like(first), []
        for _ in range(25):
            error = first - np.convolve(learned[:, 0], IMPULSE)[: len(first), None]
            norms.append(np.linalg.norm(error))
            learned = ilc.p_type_update(learned, error, gain, 25.0, 1e-3)
        assert (norms[-1] < norms[0]) == stable


def test_designed_lead_and_cutoff_are_the_highest_that_halve_every_error() -> None:
    settings = LearningSettings()
    # The defaults of the package are the design for its default position gain.
    assert ilc.design(IMPULSE, 40.0, 1e-3) == (settings.lead, settings.cutoff)
    assert settings.gain == (40.0, 40.0)

    def best(cutoff: float) -> float:
        return min(ilc.convergence_factor(IMPULSE, 40.0, cutoff, 1e-3, m) for m in range(40))

    factor = ilc.convergence_factor(IMPULSE, 40.0, settings.cutoff, 1e-3, settings.lead)
    assert factor == best(settings.cutoff) <= 0.5 < best(settings.cutoff + 5.0)
    assert factor < 0.6 * ilc.convergence_factor(IMPULSE, 40.0, settings.cutoff, 1e-3)
    with pytest.raises(StageError, match='raise position_gain'):
        ilc.design(IMPULSE, 40.0, 1e-3, 0.01)


def wire_impulse(gain: float, delay: int, period: float) -> np.ndarray:
    """A stage that follows its velocity command `delay` ticks late, position loop closed."""
    place = np.zeros(600)
    for k in range(delay, len(place) - 1):
        place[k + 1] = place[k] + period * (float(k == delay) - gain * place[k - delay])
    return place


def test_settings_of_the_zaber_stage_follow_from_its_delay_of_one_to_two_ticks() -> None:
    _, values = section('contour_ctrl_zaber')
    period = 1.0 / values['control_rate']
    gain = values['x.position_gain']
    assert {values[f'{a}.{n}_gain'] for a in 'xy' for n in ('position', 'ilc')} == {gain}

    def sensitivity(gain: float) -> float:
        impulse = wire_impulse(gain, 2, period)
        return float(np.abs(1.0 - gain * np.fft.rfft(impulse)).max())

    # K_p: the largest whole number with max |S| <= 1.6, as for the servo stage.
    assert sensitivity(gain) <= 1.6 + 1e-3 < sensitivity(gain + 1.0)

    def factor(lead: int, cutoff: float) -> float:
        impulses = (wire_impulse(gain, delay, period) for delay in (1, 2))
        return max(ilc.convergence_factor(i, gain, cutoff, period, lead) for i in impulses)

    # Q: the highest cutoff at which some lead halves every error, and that lead.
    lead, cutoff = values['ilc_lead'], values['ilc_cutoff']
    assert factor(lead, cutoff) <= 0.5 < min(factor(m, cutoff + 0.5) for m in range(10))


def test_rule_table_at_its_corners_and_between() -> None:
    assert defuzzified(1.0, 1.0) == 1.0
    assert defuzzified(1.0, 0.0) == 0.0
    assert defuzzified(0.0, 1.0) == 0.0
    assert defuzzified(1 / 3, 1.0) == pytest.approx(2 / 3)
    # Halfway between PS (2/3) and PM (1) in the row PB.
    assert defuzzified(0.5, 1.0) == pytest.approx(5 / 6)


def test_recommended_regulator_holds_while_improving_and_backs_off_on_a_disturbance() -> None:
    regulator = LearningRate()
    factors = [regulator.after(e) for e in (100.0, 60.0, 40.0, 39.0, 60.0, 40.0)]
    assert factors[0] == factors[1] == 1.0
    assert factors[3] < 0.5
    assert factors[4] == regulator.floor and regulator.reward > 0.0
    assert factors[5] > 0.5


def test_literal_regulator_freezes_at_zero() -> None:
    regulator = LearningRate('literal')
    factors = [regulator.after(e) for e in (100.0, 60.0, 40.0, 30.0, 25.0)]
    assert factors[2:] == [0.0, 0.0, 0.0]


def test_learner_returns_to_the_best_iteration_when_its_own_signal_makes_the_error_grow() -> None:
    rng = np.random.default_rng(3)
    learner = Learner(2000, 1e-3, LearningSettings(reinforced=False, divergence=1.2))
    weights = np.ones((1, 2, 2))
    shape = ilc.zero_phase_lowpass(rng.normal(size=(2000, 2)), 20.0, 1e-3)
    learner.learn(1e-5 * shape, weights)
    # What the signal does arrives 30 ticks later and twice as strong as needed, reversed.
    first = np.roll(learner.learned, 30, axis=0)
    weights[:] = 2.0
    learner.learn(
        1e-5 * shape - 1e-5 * 3.0 * first / np.abs(first).max() * np.abs(shape).max(), weights
    )
    assert learner.returns == [False, True]
    # Rate and band are halved, and what the CMAC learned in the best iteration is forgotten.
    assert learner.rate == 0.5 and learner.band == 0.5 * FIRST_BAND and np.all(weights == 0.0)
    assert learner.lead == pytest.approx([30, 30], abs=1)
    broken = shape.copy()
    broken[4] = np.nan
    with pytest.raises(StageError, match='without a measurement'):
        learner.learn(broken, weights)


def test_a_push_is_no_divergence_and_another_machine_is_learned_anew() -> None:
    rng = np.random.default_rng(4)
    learner = Learner(2000, 1e-3, LearningSettings())
    weights = np.zeros((1, 2, 2))
    error = 1e-6 * ilc.zero_phase_lowpass(rng.normal(size=(2000, 2)), 20.0, 1e-3)
    push = 1e-5 * np.sin(2 * np.pi * 3.0 * 1e-3 * np.arange(2000))[:, None] * np.ones(2)
    learner.learn(error, weights)
    signal = learner.learn(0.9 * error, weights).copy()
    assert np.array_equal(learner.learn(error + push, weights), signal)
    learner.learn(0.8 * error, weights)
    assert not any(learner.returns) and learner.rate == 1.0
    for _ in range(5):
        learner.learn(error + push, weights)
    assert learner.best is not None
    assert learner.best.rms == pytest.approx(np.sqrt(np.mean((error + push) ** 2, axis=0)))
