# SPDX-License-Identifier: Apache-2.0
"""What the page's buttons ask, over DDS, of a server that loses answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from grasp_view import service_calls_node
from grasp_view.service_calls_node import ServiceCalls


class Deaf:
    """A server whose requests are taken by hand, so that an answer can be lost."""

    def __init__(self, node: Node) -> None:
        self._services = [
            node.create_service(Trigger, name, lambda _request, answer: answer)
            for name in ('pause', 'resume', 'step')
        ]
        for service in self._services:
            node._services.remove(service)
        self.asked: list[str] = []
        self.answering = False

    def take(self) -> None:
        """Note what was asked, and answer it or not."""
        for service in self._services:
            with service.handle:
                request, header = service.handle.service_take_request(Trigger.Request)
                if header is None:
                    continue
                self.asked.append(service.srv_name.lstrip('/'))
                if self.answering:
                    reply = Trigger.Response(success=True, message='heard')
                    service.handle.service_send_response(reply, header.request_id)


@pytest.fixture
def pair(domain_id: int) -> Iterator[tuple[ServiceCalls, Deaf, list[str], Callable[[], None]]]:
    """Calls, the server, the answers told, and what brings all of it forward."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('page', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    told: list[str] = []
    calls, server = ServiceCalls(node, told.append), Deaf(node)

    def forward() -> None:
        server.take()
        executor.spin_once(timeout_sec=0.01)
        calls.tick()

    yield calls, server, told, forward
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_calls_node, 'ASK_AGAIN_S', 0.05)
    monkeypatch.setattr(service_calls_node, 'DISCOVERY_S', 60.0)


def test_a_lost_answer_of_what_does_no_harm_twice_is_asked_for_again(pair, wait_until) -> None:
    calls, server, told, forward = pair
    calls.trigger('pause', 'pause')

    def asked_twice() -> bool:
        forward()
        server.answering = len(server.asked) >= 1
        return told[-1] == 'pause: done, heard'

    wait_until(asked_twice, 60, lambda: f'{told}, {server.asked}')
    assert len(server.asked) >= 2


def test_a_step_and_what_is_no_longer_the_newest_wish_are_asked_once(
    pair, wait_until, monkeypatch
) -> None:
    calls, server, told, forward = pair
    monkeypatch.setattr(service_calls_node, 'TIMEOUT_S', 0.5)

    calls.trigger('pause', 'pause')
    wait_until(lambda: forward() or 'pause' in server.asked, 60)
    calls.trigger('step', 'step')
    wait_until(lambda: forward() or 'step: no answer within 0.5 s' in told, 60, lambda: f'{told}')
    assert server.asked.count('step') == 1
    before = server.asked.count('pause')
    wait_until(lambda: forward() or not calls._calls, 60)
    assert server.asked.count('pause') == before
