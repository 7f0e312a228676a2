# SPDX-License-Identifier: Apache-2.0
"""Splits a command line at `--ros-args ... --`.

rclpy's own split also takes every `a:=b` for a (deprecated) remapping, and `replay --remap a:=b`
means another one.
"""

from __future__ import annotations

from collections.abc import Sequence


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
