"""Splits a command line at `--ros-args ... --`.

rclpy's own split also takes every `a:=b` for a (deprecated) remapping, and `replay --remap a:=b`
means another one.
"""

from __future__ import annotations

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
