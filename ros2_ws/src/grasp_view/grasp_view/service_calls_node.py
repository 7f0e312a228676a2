# SPDX-License-Identifier: Apache-2.0
"""Services that the page's buttons call: asked without waiting, answered in words."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

DISCOVERY_S = 2.0
TIMEOUT_S = 5.0


@dataclass
class _Call:
    name: str
    client: Client
    request: Any
    verdict: Callable[[Any], tuple[bool, str]]
    since: float
    future: Future | None = None


class ServiceCalls:
    """Calls under way; `tick` brings them forward and tells `answer` what came of each."""

    def __init__(self, node: Node, answer: Callable[[str], None]) -> None:
        self._node = node
        self._answer = answer
        self._calls: list[_Call] = []
        self._clients: dict[str, Client] = {}

    def trigger(self, name: str, service: str) -> None:
        """Call a std_srvs/Trigger service; `name` stands before its answer."""
        self._begin(name, service, Trigger, Trigger.Request(), _of_trigger)

    def set_parameter(self, name: str, node: str, parameter: Parameter) -> None:
        """Set one parameter of another node."""
        request = SetParameters.Request(parameters=[parameter.to_parameter_msg()])
        self._begin(name, f'{node}/set_parameters', SetParameters, request, _of_parameters)

    def _begin(
        self,
        name: str,
        service: str,
        kind: type,
        request: Any,
        verdict: Callable[[Any], tuple[bool, str]],
    ) -> None:
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self._node.create_client(kind, service)
        self._calls.append(_Call(name, client, request, verdict, time.monotonic()))
        self._answer(f'{name}: asked')

    def tick(self) -> None:
        """Send what can be sent, and report what was answered or given up."""
        self._calls = [call for call in self._calls if not self._settled(call)]

    def _settled(self, call: _Call) -> bool:
        waited = time.monotonic() - call.since
        if call.future is None:
            if call.client.service_is_ready():
                call.future = call.client.call_async(call.request)
            elif waited > DISCOVERY_S:
                self._answer(f'{call.name}: nobody offers {call.client.srv_name}')
                return True
            return False
        if call.future.done():
            done, text = call.verdict(call.future.result())
            self._answer(f'{call.name}: {"done" if done else "refused"}{", " * bool(text)}{text}')
            return True
        if waited > TIMEOUT_S:
            call.future.cancel()
            self._answer(f'{call.name}: no answer within {TIMEOUT_S:g} s')
            return True
        return False


def _of_trigger(answer: Trigger.Response) -> tuple[bool, str]:
    return bool(answer.success), str(answer.message)


def _of_parameters(answer: SetParameters.Response) -> tuple[bool, str]:
    refused = '; '.join(one.reason for one in answer.results if not one.successful)
    return all(one.successful for one in answer.results), refused
