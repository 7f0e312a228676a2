# SPDX-License-Identifier: Apache-2.0
"""How every node here starts, declares its parameters and ends."""

from __future__ import annotations

import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, Protocol, TypeVar

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from grasp_common.messages import descriptor, nanoseconds
from grasp_common.parameter_files import given_files, nodes_in, speaks_to
from grasp_common.parameter_table import Parameter, ParameterError, unknown
from grasp_common.terminal import complain, printable

WRONG_ROS_ARGUMENTS: tuple[type[Exception], ...] = (
    rclpy_implementation.UnknownROSArgsError,
    rclpy_implementation.RCLInvalidROSArgsError,
)
"""What rclpy raises when it starts with arguments that it cannot read."""

WRONG_PARAMETERS: tuple[type[Exception], ...] = (
    ParameterError,
    InvalidParameterTypeException,
    InvalidParameterValueException,
)
"""What a node raises while it declares its parameters."""

LATEST_NS = 2**31 * 1_000_000_000
"""Seconds of a stamp are an int32."""

OF_EVERY_NODE = ('use_sim_time', 'start_type_description_service')


class RosStartError(RuntimeError):
    """ROS itself does not start in this environment: domain, log folder, security."""


NOT_STARTED: tuple[type[Exception], ...] = (*WRONG_PARAMETERS, RosStartError)


class Closable(Protocol):
    """A node that owns more than ROS knows of."""

    def close(self) -> None:
        """End everything that it started."""


Owner = TypeVar('Owner', bound=Closable)
Made = TypeVar('Made')


def start_ros(arguments: Sequence[str]) -> None:
    """Start rclpy with the program's name and arguments.

    Raises RosStartError with the reason that ROS gives, or what a file of parameters lacks.
    """
    try:
        for file in given_files(arguments):
            nodes_in(file)
        rclpy.init(args=list(arguments))
    except ParameterError as error:
        raise RosStartError(str(error)) from error
    except WRONG_ROS_ARGUMENTS as error:
        raise type(error)(_reason(error)) from error
    except rclpy_implementation.RCLError as error:
        raise RosStartError(_reason(error)) from error


def made(make: Callable[[], Made], arguments: Sequence[str] = ()) -> Made:
    """What `make` makes; raises RosStartError where ROS refuses to, as security does only here.

    arguments: of the process; a node warns of files of parameters that hold none for it.
    """
    try:
        with warnings.catch_warnings():
            # rclpy complains that it cannot take back what was never made.
            warnings.filterwarnings('ignore', 'Failed to fini', RuntimeWarning)
            node = make()
    except rclpy_implementation.RCLError as error:
        # After a signal everything fails that is still being made: that is no refusal.
        if not rclpy.ok():
            raise
        raise RosStartError(_reason(error)) from error
    if isinstance(node, Node):
        guard_services(node)
        guard_clock(node)
        _warn_of_other_nodes(node, arguments)
    return node


def _warn_of_other_nodes(node: Node, arguments: Sequence[str]) -> None:
    name = node.get_fully_qualified_name()
    for file in given_files(arguments):
        others = nodes_in(file)
        if not any(speaks_to(other, name) for other in others):
            told = f'{file} holds no parameters for {name}, but for {", ".join(others)}'
            node.get_logger().warning(printable(told))


def _reason(error: Exception) -> str:
    """What rcl says, without the places in its sources."""
    said = re.sub(r', at /\S+:\d+', '', str(error))
    reason = ': '.join(line.strip() for line in said.splitlines() if line.strip())
    if 'error not set' in reason and os.environ.get('ROS_SECURITY_ENABLE') == 'true':
        # That is all that rcl says without a keystore.
        reason += (
            ' (ROS_SECURITY_ENABLE is true: ROS_SECURITY_KEYSTORE must hold an enclave for this '
            'program, given with --ros-args --enclave)'
        )
    return reason


def declare(node: Node, parameters: Iterable[Parameter]) -> None:
    """Declare the table on the node and warn of given names that are none of its parameters.

    Raises ParameterError for a value of another type.
    """
    table = tuple(parameters)
    for parameter in table:
        try:
            node.declare_parameter(parameter.name, parameter.default, descriptor(parameter))
        except InvalidParameterTypeException as error:
            given = node._parameter_overrides[parameter.name]
            raise ParameterError(
                f'{parameter.name} is {given.value!r}, of type {given.type_.name}; it must be of '
                f'the type of {parameter.default!r}: {parameter.description}'
            ) from error
    warn_of_unknown(node, [parameter.name for parameter in table])


def warn_of_unknown(node: Node, names: Iterable[str]) -> None:
    """Name what was given to the node as a parameter and is none of `names`."""
    known = [*names, *OF_EVERY_NODE]
    for name in node._parameter_overrides:
        if name not in known and not name.startswith('qos_overrides.'):
            node.get_logger().warning(unknown(name, known))


def status_name(node: Node, part: str = '') -> str:
    """Name of a diagnostic status: namespace and node, then its part, as `left/hand_bridge: hand`.

    Two nodes of one name in two namespaces stay two for whoever gathers `/diagnostics`.
    """
    name = node.get_fully_qualified_name().removeprefix('/')
    return f'{name}: {part}' if part else name


def beside_others(node: Node, judged: tuple[str, str], *topics: str) -> tuple[str, str]:
    """Level and sentence of a node's diagnostics; a warning instead of ok where others interfere.

    topics: of which more than one publisher is one too many, as of a node that was started twice.
    """
    for topic in topics if judged[0] == 'ok' else ():
        number = node.count_publishers(topic)
        if number > 1:
            return 'warn', f'{number} nodes publish {topic}: end all but one, or use namespaces'
    return judged


class QuietExecutor(SingleThreadedExecutor):
    """rclpy's, which leaves without a word also where a signal came while it was made."""

    # Its __del__ asks for this, which a constructor that was broken off has not set.
    _sigint_gc = None  # type: ignore[assignment]  # rclpy itself sets it to None at the end


def end_by_signals() -> None:
    """Let rclpy's own handlers end the context: on SIGINT and SIGTERM, and so on SIGHUP.

    Python's KeyboardInterrupt would break into whatever runs just then, and in the middle of a
    call into C++ come out as an error of that call.
    """
    signal.signal(signal.SIGINT, lambda *_: None)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: os.kill(os.getpid(), signal.SIGTERM))


def guard_services(node: Node) -> None:
    """Let no request end the node.

    rclpy's own services raise on what cannot be: a parameter of a type that there is none of, say.
    """
    for service in node.services:
        callback = service.callback
        if str(getattr(callback, '__module__', '')).startswith('rclpy.'):
            service.callback = partial(_answer, node, callback)


def guard_clock(node: Node) -> None:
    """Let no message on /clock end the node.

    rclpy raises on a time before 1970 at once, and on one after 2038 when it stamps a message.
    """
    # For a use_sim_time that is set already, and for one that is set later.
    for subscription in node.subscriptions:
        if str(getattr(subscription.callback, '__module__', '')) == 'rclpy.time_source':
            subscription.callback = partial(_set_clock, node, subscription.callback)
    source: Any = node._time_source
    source.clock_callback = partial(_set_clock, node, source.clock_callback)


def _set_clock(node: Node, callback: Callable[[Any], None], message: Any) -> None:
    time = nanoseconds(message.clock)
    if 0 <= time < LATEST_NS:
        callback(message)
    else:
        node.get_logger().error(
            f'/clock is left out: {1e-9 * time:.3f} s is no time that a stamp can hold',
            throttle_duration_sec=5.0,
        )


def _answer(node: Node, callback: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    """What `callback` answers, or a refusal."""
    try:
        # What rcl cannot use of these it logs as they came.
        label = getattr(getattr(request, 'transition', None), 'label', '')
        for text in (getattr(request, 'type_hash', ''), label):
            if not text.isprintable():
                raise ValueError(f'{text!r} names nothing')
        return callback(request, response)
    except Exception as error:
        node.get_logger().error(f'a request is refused: {printable(str(error))}')
        refused = SetParametersResult(successful=False, reason=str(error))
        if hasattr(response, 'results'):
            response.results = [refused for _ in request.parameters]
        elif hasattr(response, 'result'):
            response.result = refused
        elif hasattr(response, 'failure_reason'):
            response.failure_reason = str(error)
        return response


def spin(node: Any, executor: Executor) -> None:
    """Serve the node until the context ends."""
    executor.spin()


def run_node(
    program: str,
    make: Callable[[], Owner],
    arguments: Sequence[str] | None = None,
    *,
    usage: Callable[[], str] | None = None,
    errors: tuple[type[Exception], ...] = (),
    serve: Callable[[Owner, Executor], None] = spin,
) -> int:
    """Make a node, serve it until a signal, close it; returns the exit code.

    `arguments` default to those of the process. `errors` and wrong parameters end it with one
    sentence and exit code 1, arguments that nobody knows with 2.
    """
    everything = list(sys.argv[1:] if arguments is None else arguments)
    try:
        given = remove_ros_args(everything)
    except WRONG_ROS_ARGUMENTS as error:
        complain(program, _reason(error))
        return 2
    if usage is not None and {'-h', '--help'} & set(given):
        print(usage())
        return 0
    if given:
        complain(program, f'unknown argument {given[0]!r}; see --help')
        return 2
    end_by_signals()
    executor: SingleThreadedExecutor | None = None
    node: Owner | None = None
    try:
        start_ros([program, *everything])
        executor = QuietExecutor()
        node = made(make, everything)
        executor.add_node(node)  # type: ignore[arg-type]  # a Node that can be closed
        serve(node, executor)
    except WRONG_ROS_ARGUMENTS as error:
        complain(program, error)
        return 2
    except (*NOT_STARTED, *errors) as error:
        complain(program, error)
        return 1
    except ExternalShutdownException:
        pass
    except Exception:
        # Whatever is made, sent or waited for after the signal complains.
        if rclpy.ok():
            raise
    finally:
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.close()
            node.destroy_node()  # type: ignore[attr-defined]
        rclpy.try_shutdown()
    return 0
