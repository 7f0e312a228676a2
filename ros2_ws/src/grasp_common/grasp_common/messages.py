# SPDX-License-Identifier: Apache-2.0
"""The ROS messages that every grasp package builds: stamps, clouds, descriptors, diagnostics."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Float64, Header

from grasp_common.parameter_table import Parameter
from grasp_common.point_cloud import DATATYPES
from grasp_common.terminal import printable

LEVELS = {
    'ok': DiagnosticStatus.OK,
    'warn': DiagnosticStatus.WARN,
    'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE,
}
_DATATYPE_OF = {code: number for number, code in DATATYPES.items()}


def nanoseconds(stamp: Time) -> int:
    """A ROS time in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def raw_stamp(message: bytes) -> int:
    """The stamp of a serialised message with a header in front [ns]; 0 where it is too short."""
    if len(message) < 12:
        return 0
    # The second octet of the encapsulation tells the order of all others.
    seconds, rest = struct.unpack_from('<iI' if message[1] & 1 else '>iI', message, 4)
    return int(seconds) * 1_000_000_000 + int(rest)


def time_message(stamp_ns: int) -> Time:
    """Nanoseconds as a ROS time; what it cannot hold becomes its earliest or latest second.

    Such times come from other messages, whose nanoseconds may be more than a second.
    """
    seconds, rest = divmod(int(stamp_ns), 1_000_000_000)
    return Time(sec=min(max(seconds, -(2**31)), 2**31 - 1), nanosec=rest)


def header(stamp_ns: int, frame: str = '') -> Header:
    """A header of a stamp in nanoseconds and a frame."""
    return Header(stamp=time_message(stamp_ns), frame_id=frame)


def number(value: float) -> Float64:
    """A Float64."""
    return Float64(data=float(value))


def named_numbers(values: Mapping[str, float], stamp_ns: int, frame: str = '') -> JointState:
    """Several named numbers of one moment, as the positions of a JointState.

    Of the standard messages this is the one with a stamp, names and float64 values. PlotJuggler
    shows it by these names, Foxglove and rqt_plot by their place in it; a Float64 has no stamp, a
    DiagnosticArray holds text, and a Float64MultiArray has names but no stamp.
    """
    return JointState(
        header=header(stamp_ns, frame),
        name=list(values),
        position=array('d', map(float, values.values())),
    )


def point_fields(layout: np.dtype[Any]) -> list[PointField]:
    """The fields of clouds of such records, one element each; names in `_` are padding."""
    assert layout.fields is not None
    return [
        PointField(
            name=name,
            offset=int(layout.fields[name][1]),
            datatype=_DATATYPE_OF[layout.fields[name][0].str[1:]],
            count=1,
        )
        for name in layout.names or ()
        if not name.startswith('_')
    ]


def cloud(
    points: NDArray[Any],
    stamp_ns: int,
    frame: str,
    fields: list[PointField] | None = None,
    dense: bool = True,
) -> PointCloud2:
    """Records (n,) of little-endian fields as a cloud; `fields` if they are known already.

    `dense`: no point holds a number that is not finite.
    """
    octets = array('B')
    octets.frombytes(points.tobytes())
    step, count = int(points.dtype.itemsize), int(len(points))
    return PointCloud2(
        header=header(stamp_ns, frame),
        height=1,
        width=count,
        fields=point_fields(points.dtype) if fields is None else fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * count,
        data=octets,
        is_dense=dense,
    )


def diagnostics(
    stamp_ns: int,
    name: str,
    level: str,
    summary: str,
    values: Mapping[str, object],
    hardware: str = '',
) -> DiagnosticArray:
    """One status with its values; `level` is a key of LEVELS, `name` from `status_name`."""
    status = DiagnosticStatus(
        level=LEVELS[level],
        name=name,
        message=printable(summary, 2000),
        hardware_id=printable(hardware),
        values=[KeyValue(key=key, value=_shown(value)) for key, value in values.items()],
    )
    return DiagnosticArray(header=header(stamp_ns), status=[status])


def _shown(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else printable(str(value))


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Descriptor with description, range and choices; the ranges of lists are only checked."""
    message = ParameterDescriptor(
        description=parameter.description,
        read_only=parameter.settable == 'start',
        additional_constraints=', '.join(parameter.choices),
    )
    low, high = parameter.lowest, parameter.highest
    if low is None or high is None or isinstance(parameter.default, list):
        return message
    if isinstance(parameter.default, int):
        message.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    else:
        message.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high))
        ]
    return message
