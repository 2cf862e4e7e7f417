"""A service answers a caller that the middleware comes to know after its request."""

from __future__ import annotations

import threading
import time
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from std_srvs.srv import Trigger

from stage_core.ros.node import StageNode, make_executor, spin

from ..patience import PATIENCE

#: No caller's reliable reader is matched with the writer of such a service, as is the case where
#: what tells of the reader was lost.
UNMATCHED = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.usefixtures('ros_env')
def test_an_answer_that_the_middleware_refuses_is_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    send, tries = Service.send_response, threading.Semaphore(0)

    def sent(service: Service, response: Any, header: Any) -> None:
        tries.release()
        send(service, response, header)

    monkeypatch.setattr(Service, 'send_response', sent)
    rclpy.init()
    node, executor, ended = StageNode('tester', []), make_executor(), threading.Event()
    node.create_service(Trigger, '~/feed', lambda _, response: response, qos_profile=UNMATCHED)
    caller = rclpy.create_node('caller')
    client = caller.create_client(Trigger, '/tester/feed')
    executor.add_node(node)
    thread = threading.Thread(target=spin, args=(executor, ended))
    thread.start()
    try:
        deadline, asked = time.monotonic() + PATIENCE, False
        while not asked and time.monotonic() < deadline:
            client.call_async(Trigger.Request())
            asked = tries.acquire(timeout=1.0)
        assert asked and all(tries.acquire(timeout=PATIENCE) for _ in range(2))
        assert thread.is_alive()
    finally:
        ended.set()
        thread.join()
        caller.destroy_node()
        rclpy.shutdown()
