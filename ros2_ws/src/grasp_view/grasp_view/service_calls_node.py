# SPDX-License-Identifier: Apache-2.0
"""Services that the page's buttons call: asked without waiting, answered in words.

DDS finds the two directions of a service one after the other: a server that already hears a
request may not know yet where its answer goes, and the answer is then lost (ros2/rmw_fastrtps
issue 842). The newest request is therefore sent again where that does no harm; an older one
would undo what was asked after it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

DISCOVERY_S = 2.0
TIMEOUT_S = 5.0
# An answer that takes so long is likely lost.
ASK_AGAIN_S = 1.0
HARMLESS_TWICE = ('pause', 'resume')


@dataclass
class _Call:
    name: str
    client: Client
    request: Any
    verdict: Callable[[Any], tuple[bool, str]]
    since: float
    again: bool
    futures: list[Future] = field(default_factory=list)


class ServiceCalls:
    """Calls under way; `tick` brings them forward and tells `answer` what came of each."""

    def __init__(self, node: Node, answer: Callable[[str], None]) -> None:
        self._node = node
        self._answer = answer
        self._calls: list[_Call] = []
        self._clients: dict[str, Client] = {}

    def trigger(self, name: str, service: str) -> None:
        """Call a std_srvs/Trigger service; `name` stands before its answer."""
        request, again = Trigger.Request(), name in HARMLESS_TWICE
        self._begin(name, service, Trigger, request, _of_trigger, again)

    def set_parameter(self, name: str, node: str, parameter: Parameter) -> None:
        """Set one parameter of another node."""
        request = SetParameters.Request(parameters=[parameter.to_parameter_msg()])
        self._begin(name, f'{node}/set_parameters', SetParameters, request, _of_parameters, True)

    def _begin(
        self,
        name: str,
        service: str,
        kind: type,
        request: Any,
        verdict: Callable[[Any], tuple[bool, str]],
        again: bool,
    ) -> None:
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self._node.create_client(kind, service)
        for older in self._calls:
            older.again = False
        self._calls.append(_Call(name, client, request, verdict, time.monotonic(), again))
        self._answer(f'{name}: asked')

    def tick(self) -> None:
        """Send what can be sent, and report what was answered or given up."""
        self._calls = [call for call in self._calls if not self._settled(call)]

    def _settled(self, call: _Call) -> bool:
        waited = time.monotonic() - call.since
        if not call.futures and not call.client.service_is_ready():
            if waited > DISCOVERY_S:
                self._answer(f'{call.name}: nobody offers {call.client.srv_name}')
            return waited > DISCOVERY_S
        answered = next((future for future in call.futures if future.done()), None)
        if answered is None and waited <= TIMEOUT_S:
            asked = len(call.futures)
            if asked == 0 or (call.again and waited > asked * ASK_AGAIN_S):
                call.futures.append(call.client.call_async(call.request))
            return False
        for future in call.futures:
            future.cancel()
        if answered is None:
            self._answer(f'{call.name}: no answer within {TIMEOUT_S:g} s')
        else:
            done, text = call.verdict(answered.result())
            self._answer(f'{call.name}: {"done" if done else "refused"}{", " * bool(text)}{text}')
        return True


def _of_trigger(answer: Trigger.Response) -> tuple[bool, str]:
    return bool(answer.success), str(answer.message)


def _of_parameters(answer: SetParameters.Response) -> tuple[bool, str]:
    refused = '; '.join(one.reason for one in answer.results if not one.successful)
    return all(one.successful for one in answer.results), refused
