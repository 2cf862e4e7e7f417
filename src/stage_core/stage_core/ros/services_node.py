"""Trigger services that answer at once, and services that answer when a job is done.

The executor calls the callback and then `send_response`; for the latter that response waits for a
future. So `~/stop` is served while `~/home` still waits. (rclpy's EventsExecutor takes no
coroutines.)
"""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from std_srvs.srv import Trigger

from stage_core.errors import StageError

#: How long an answer waits for its caller to be known here, which is how long a caller waits if it
#: says nothing else (`GraphClient.trigger`), and how often it is sent [s].
KNOWN_WITHIN, SENT_EVERY = 30.0, 0.5


def answering_late(service: Any, warn: Callable[[str], Any]) -> Any:
    """The service, whose answer waits for a caller that the middleware does not know yet.

    Where packets are lost a request may come before what tells of its caller's reader. The
    middleware then refuses to send the answer, of which rclpy warns and no more: the caller would
    wait in vain. As an error the warning is the cause of a SystemError.
    """
    warnings.filterwarnings('error', 'failed to send response', RuntimeWarning)
    send_now = service.send_response

    def sent(response: Any, header: Any) -> bool:
        try:
            send_now(response, header)
        except SystemError as error:
            if not isinstance(error.__cause__, RuntimeWarning):
                raise
            return False
        except rclpy_implementation.InvalidHandle:
            pass  # The node has ended meanwhile.
        return True

    def send_again(response: Any, header: Any) -> None:
        until = time.monotonic() + KNOWN_WITHIN
        while time.monotonic() < until:
            time.sleep(SENT_EVERY)
            if sent(response, header):
                return
        warn(f'{service.srv_name}: the caller is not known here and got no answer')

    def send(response: Any, header: Any) -> None:
        if not sent(response, header):
            threading.Thread(target=send_again, args=(response, header), daemon=True).start()

    service.send_response = send
    return service


def create_trigger_service(node: Any, name: str, action: Callable[[], str]) -> None:
    """Create a Trigger service that answers with what `action` returns, or its error."""

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = action(), True
        except Exception as error:
            response.message = _said(error)
        return response

    node.create_service(Trigger, name, answer)


def _said(error: BaseException) -> str:
    """An error for the caller; a mistake in here is theirs to hear, not the end of the node."""
    return str(error) if isinstance(error, StageError) else f'internal error: {error!r}'


def create_deferred_service(
    node: Any, service_type: type, name: str, begin: Callable[[Any], Future[str]]
) -> None:
    """Create a service whose response is the outcome of the future that `begin(request)` returns.

    A result is the message of a success; a StageError the message of a failure.
    """
    waiting: dict[int, Future[str]] = {}

    def callback(request: Any, response: Any) -> Any:
        try:
            waiting[id(response)] = begin(request)
        except Exception as error:
            # A mistake in here is the caller's to hear, not the end of the node.
            failed: Future[str] = Future()
            waiting[id(response)] = failed
            failed.set_exception(error)
        return response

    service = node.create_service(service_type, name, callback)
    send_now = service.send_response

    def send_when_done(response: Any, header: Any) -> None:
        future = waiting.pop(id(response))

        def answer(done: Future[str]) -> None:
            error = done.exception()
            response.success = error is None
            response.message = done.result() if error is None else _said(error)
            send_now(response, header)

        future.add_done_callback(answer)

    service.send_response = send_when_done
