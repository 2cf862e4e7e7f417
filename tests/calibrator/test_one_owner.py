"""A training that ends while the model in use is being adapted: one thread owns the model."""

import threading
import time

import numpy as np
import rclpy

from calibrator import model_file
from calibrator.adaptation import LiveAdaptation
from calibrator.model_file import StoredModel
from calibrator.models import make_model
from calibrator.node import Calibrator
from stage_core.ros.node import OK, WARN, make_executor, spin

from ..patience import PATIENCE, wait
from .hearing import hear


def test_a_training_that_ends_within_an_adaptation_waits_for_it(
    ros_env, tmp_path, grid_session, monkeypatch
):
    parameters = {'adapt': 'true', 'model_folder': str(tmp_path)}
    given = [item for k, v in parameters.items() for item in ('-p', f'{k}:={v}')]
    rclpy.init(args=['--ros-args', *given])
    node = Calibrator()
    points = np.random.default_rng(0).uniform(0.0, 0.05, (50, 2))
    old = StoredModel(make_model('affine').fit(points, points), version=7)
    node._correction.stored = old
    for _ in hear(node._buffer, grid_session(40)):
        pass
    learn, answers, overlaps = LiveAdaptation.step, [], []

    def slow_step(adaptation, buffer):
        """Let a training begin and end in the middle of the step."""
        if not answers:
            answers.append(node._retrain())
            while node._trainer.running:
                time.sleep(0.01)
            time.sleep(0.2)
            overlaps.append(node._correction.stored.version)
        return learn(adaptation, buffer)

    monkeypatch.setattr(LiveAdaptation, 'step', slow_step)
    executor, ended = make_executor(), threading.Event()
    executor.add_node(node)
    spinning = threading.Thread(target=spin, args=(executor, ended))
    spinning.start()
    try:
        wait(lambda: answers, 'an adaptation')
        assert 'held-out RMS' in answers[0].result(PATIENCE)
        # The step that the training ended in still had the old model; the new one came after it.
        assert overlaps == [old.version]
        assert node._correction.stored.version == 1
        assert spinning.is_alive()
    finally:
        ended.set()
        spinning.join(PATIENCE)
        node.shutdown()
        executor.remove_node(node)
        node.destroy_node()
        rclpy.shutdown()


def test_a_failed_training_is_told_until_a_model_is_taken(ros_env, tmp_path):
    rclpy.init(args=['--ros-args', '-p', f'model_folder:={tmp_path}'])
    node = Calibrator()
    try:
        node._failure = 'the training failed'
        assert node._status()[:2] == (WARN, 'the training failed')
        points = np.random.default_rng(0).uniform(0.0, 0.05, (50, 2))
        stored = StoredModel(make_model('affine').fit(points, 1.001 * points))
        model_file.save(stored, tmp_path / 'model.json')
        node._use(tmp_path / 'model.json')
        assert node._status()[:2] == (OK, stored.model.describe())
    finally:
        node.shutdown()
        node.destroy_node()
        rclpy.shutdown()
