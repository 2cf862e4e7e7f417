"""A service answers a caller that the middleware comes to know after its request."""

from __future__ import annotations

import threading
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service

from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import StageNode, make_executor, spin
from stage_core.ros.services_node import create_trigger_service

from ..patience import PATIENCE


@pytest.mark.usefixtures('ros_env')
def test_an_answer_that_is_refused_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    send, tries = Service.send_response, list[object]()

    def not_known_yet(service: Service, response: Any, header: Any) -> None:
        tries.append(header)
        if len(tries) < 3:
            raise rclpy_implementation.RCLError('client will not receive response')
        send(service, response, header)

    monkeypatch.setattr(Service, 'send_response', not_known_yet)
    rclpy.init()
    node, executor, ended = StageNode('tester', []), make_executor(), threading.Event()
    create_trigger_service(node, '~/feed', lambda: 'fed')
    executor.add_node(node)
    thread = threading.Thread(target=spin, args=(executor, ended))
    thread.start()
    try:
        with GraphClient() as client:
            assert client.trigger('/tester/feed', PATIENCE) == 'fed'
        assert len(tries) == 3
    finally:
        ended.set()
        thread.join()
        rclpy.shutdown()
