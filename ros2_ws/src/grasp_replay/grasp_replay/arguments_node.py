"""Splits a command line at `--ros-args ... --`, and lets signals end a program of rclpy.

rclpy's own split also takes every `a:=b` for a (deprecated) remapping, and `replay --remap a:=b`
means another one.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence

from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.impl.implementation_singleton import rclpy_implementation

# What rclpy raises for them when it starts or a node declares its parameters.
WRONG_ROS_ARGUMENTS = (
    rclpy_implementation.UnknownROSArgsError,
    rclpy_implementation.RCLInvalidROSArgsError,
    InvalidParameterTypeException,
    InvalidParameterValueException,
)


def split_ros_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The program's own arguments, and those for `rclpy.init`."""
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for argument in arguments:
        if not inside and argument == '--ros-args':
            inside = True
            ros.append(argument)
        elif inside and argument == '--':
            inside = False
            ros.append(argument)
        else:
            (ros if inside else own).append(argument)
    return own, ros


def end_by_signals() -> None:
    """Let rclpy's own handlers end the context: on SIGINT and SIGTERM, and so on SIGHUP.

    Python's KeyboardInterrupt would break into whatever runs just then, and in the middle of a
    call into C++ come out as an error of that call.
    """
    signal.signal(signal.SIGINT, lambda *_: None)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: os.kill(os.getpid(), signal.SIGTERM))
