# SPDX-License-Identifier: Apache-2.0
"""Messages of any type with anything in them: extremes, contradictions, many nearly right."""

from __future__ import annotations

import array
import math
import re
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import ParameterValue
from rclpy.serialization import serialize_message
from rosidl_parser.definition import Array, BasicType, NamespacedType, UnboundedSequence
from sensor_msgs.msg import JointState, PointCloud2, PointField
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-300, 1e30, -1e30, 1e300, math.nan, math.inf, -math.inf, 5e-324)
TEXTS = ('', 'x', 'hand_base', '\x1b]0;owned\x07', '/../..', 'a' * 5000, '\u202e', "'; rm", '%s%n')
RANGES = {
    'uint8': (0, 2**8 - 1), 'int8': (-(2**7), 2**7 - 1), 'octet': (0, 2**8 - 1),
    'uint16': (0, 2**16 - 1), 'int16': (-(2**15), 2**15 - 1),
    'uint32': (0, 2**32 - 1), 'int32': (-(2**31), 2**31 - 1),
    'uint64': (0, 2**64 - 1), 'int64': (-(2**63), 2**63 - 1),
}  # fmt: skip
CONTACT_FIELDS = (
    *'xyz', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz', 'sigma_n', 'radius', 'sigma_t', 'travel',
    'sigma_travel',
)  # fmt: skip

GRASP_FIELDS = (
    'x', 'y', 'z', 'nx', 'ny', 'nz', 'push', 'closed', 'on_deformed_normals',
    'closure_probability', 'needed_friction', 'needed_friction_sigma', 'friction_given',
    'friction_sigma_given',
    'least_push', 'most_push', 'liftable_mass', 'mass_given', 'gravity_slip', 'slip_finger',
    'dent_push', 'stress_resolved', 'liftable_mass_sigma',
    'rx', 'ry', 'rz', 'fx', 'fy', 'fz', 'tx', 'ty', 'tz', 'friction_torque', 'friction_capacity',
    'later', 'force', 'sigma', 'cell',
)  # fmt: skip
JOINTS = ('spread', 'finger_1_inner', 'finger_2_inner', 'finger_3_inner', 'finger_1_outer')
NEARLY_RIGHT = 0.7


class OddMessages:
    """Makes messages; the seed fixes all of them."""

    def __init__(self, seed: int | list[int]) -> None:
        self._random = np.random.default_rng(seed)

    def pick(self, choices: Any) -> Any:
        """One of several."""
        return choices[int(self._random.integers(len(choices)))]

    def message(self, kind: type) -> Any:
        """A message of a type; most of some types are nearly what a node can use."""
        nearly = {
            PointCloud2: self._cloud,
            JointState: self._joints,
            JointTrajectory: self._trajectory,
            PoseStamped: self._pose,
        }
        if kind in nearly and self._random.random() < NEARLY_RIGHT:
            return nearly[kind]()
        made = kind()
        for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
            self._fill(made, name, slot)
        return made

    def octets(self, kind: type) -> bytes:
        """A message as it goes over the wire, cut off or with octets that are others."""
        wire = bytearray(serialize_message(self.message(kind)))
        for _ in range(int(self._random.integers(1, 6))):
            wire[int(self._random.integers(len(wire)))] = int(self._random.integers(256))
        return bytes(wire[: int(self.pick((len(wire), len(wire), len(wire) // 2, 3)))])

    def value(self, held: ParameterValue) -> ParameterValue:
        """A value for a parameter that holds another one: mostly of its type, perhaps near it."""
        if self._random.random() > NEARLY_RIGHT:
            return self.message(ParameterValue)
        made = ParameterValue(type=held.type)
        made.bool_value = bool(self._random.integers(2))
        near = held.integer_value + int(self._random.integers(-3, 4))
        made.integer_value = int(self.pick((near, near, self.whole('int64'))))
        made.double_value = self._near(held.double_value)
        made.string_value = str(self.pick((held.string_value, *TEXTS[1:])))
        made.double_array_value = [self._near(one) for one in held.double_array_value]
        made.integer_array_value = [self.whole('int8') for _ in held.integer_array_value]
        made.string_array_value = [
            str(self.pick((one, *TEXTS))) for one in held.string_array_value
        ]
        return made

    def _near(self, value: float) -> float:
        return float(self.pick((value, value * self._random.uniform(0.5, 2.0), self.number())))

    def number(self) -> float:
        """An extreme number, or a plain one."""
        if self._random.random() < 0.5:
            return float(self.pick(NUMBERS))
        return float(self._random.normal() * 10.0 ** self._random.integers(-3, 3))

    def whole(self, kind: str) -> int:
        """A whole number of a type: an end of its range, or a small one."""
        low, high = RANGES[kind]
        return int(self.pick((low, high, 0, 1, high // 2, int(self._random.integers(0, 100)))))

    def _fill(self, made: Any, name: str, slot: Any) -> None:
        if isinstance(slot, NamespacedType):
            inner = getattr(made, name)
            for part, part_slot in zip(
                inner.get_fields_and_field_types(), inner.SLOT_TYPES, strict=True
            ):
                self._fill(inner, part, part_slot)
        elif isinstance(slot, UnboundedSequence):
            setattr(made, name, self._sequence(made, name, slot.value_type))
        elif isinstance(slot, Array) and isinstance(slot.value_type, BasicType):
            kind = slot.value_type.typename
            setattr(made, name, [self._basic(kind) for _ in range(slot.size)])
        elif isinstance(slot, BasicType):
            setattr(made, name, self._basic(slot.typename))
        elif type(getattr(made, name)) is str:
            setattr(made, name, str(self.pick(TEXTS)))

    def _basic(self, kind: str) -> Any:
        if kind in ('float', 'double'):
            value = self.number()
            return value if kind == 'double' or not abs(value) > 3e38 else math.inf
        if kind == 'boolean':
            return bool(self._random.integers(2))
        if kind == 'octet':
            return bytes([int(self._random.integers(256))])
        return self.whole(kind)

    def _sequence(self, made: Any, name: str, item: Any) -> Any:
        count = int(self.pick((0, 1, 2, 3, 7)))
        if isinstance(item, BasicType):
            held = getattr(made, name)
            if isinstance(held, array.array):
                if held.typecode == 'B':
                    return array.array('B', self._random.bytes(int(self._random.integers(0, 300))))
                return array.array(
                    held.typecode, [self._basic(item.typename) for _ in range(count)]
                )
            return [self._basic(item.typename) for _ in range(count)]
        if isinstance(item, NamespacedType):
            kind = _class_of(made, name)
            return [self.message(kind) for _ in range(count)]
        return [str(self.pick(TEXTS)) for _ in range(count)]

    def _stamp(self, header: Any) -> None:
        header.frame_id = str(self.pick(('hand_base', 'hand_base', *TEXTS)))
        header.stamp.sec = self.whole('int32')
        header.stamp.nanosec = self.whole('uint32')

    def _names(self) -> list[str]:
        """Joints of the hand, perhaps one of them twice."""
        return [str(self.pick(JOINTS)) for _ in range(int(self._random.integers(1, 5)))]

    def _numbers(self, count: int) -> list[float]:
        """So many small numbers, one of them perhaps not; sometimes one too many or too few."""
        values = [float(self._random.uniform(-0.5, 2.5)) for _ in range(count)]
        if values and self._random.random() < 0.5:
            values[int(self._random.integers(len(values)))] = self.number()
        return (values + [0.0])[: max(0, len(values) + int(self.pick((0, 0, 0, 0, 1, -1))))]

    def _joints(self) -> JointState:
        """Joint states, or commands, of the hand."""
        names = self._names()
        made = JointState(name=names, position=self._numbers(len(names)))
        self._stamp(made.header)
        made.velocity = self._numbers(int(self.pick((0, len(names)))))
        return made

    def _trajectory(self) -> JointTrajectory:
        """A trajectory of the hand's joints."""
        names = self._names()
        made = JointTrajectory(joint_names=names)
        for number in range(int(self._random.integers(0, 4))):
            point = JointTrajectoryPoint(positions=self._numbers(len(names)))
            point.time_from_start.sec = int(self.pick((number, number, self.whole('int32'))))
            point.time_from_start.nanosec = int(self.pick((0, 10**8, self.whole('uint32'))))
            made.points = [*made.points, point]
        return made

    def _pose(self) -> PoseStamped:
        """A pose a little away, of which one number may be odd."""
        made = PoseStamped()
        self._stamp(made.header)
        made.pose.orientation.w = 1.0
        part = self.pick((made.pose.position, made.pose.orientation))
        value = float(self.pick((self.number(), 1e-3 * self._random.normal())))
        setattr(part, str(self.pick('xyz')), value)
        return made

    def _cloud(self) -> PointCloud2:
        """Contacts, or a scan, of which one thing is wrong."""
        count = int(self.pick((0, 1, 2, 3, 50)))
        real = str(self.pick(('<f4', '<f4', '<f4', '<f8')))
        if self._random.random() < 0.3:
            names, kinds = ['finger', *GRASP_FIELDS], [real] * (1 + len(GRASP_FIELDS))
        else:
            names = [*CONTACT_FIELDS, 'finger', 'flags', 'distance', 'ux', 'uy', 'uz']
            names += ['displacement', 'sigma']
            kinds = [('u1' if name in ('finger', 'flags') else real) for name in names]
        rows = np.zeros(count, list(zip(names, kinds, strict=True)))
        right = {'x': -0.0325, 'nx': 1.0, 'fx': 5.0, 'flags': 1, 'radius': 1e-3, 'later': 1.0}
        right |= {'sigma_n': 0.05, 'sigma_t': np.inf}
        for name in set(names) & set(right):
            rows[name] = right[name]
        # Of a grasp the first row is the whole.
        rows['finger'] = np.arange(count) % 3 + 1 if 'flags' in names else np.arange(count) - 1
        fields = [
            PointField(
                name=name, offset=int(rows.dtype.fields[name][1]), count=1,
                datatype={'u1': PointField.UINT8, '<f4': PointField.FLOAT32}.get(
                    kind, PointField.FLOAT64
                ),
            )
            for name, kind in zip(names, kinds, strict=True)
        ]  # fmt: skip
        cloud = PointCloud2(
            height=1, width=count, fields=fields, point_step=rows.dtype.itemsize,
            row_step=rows.dtype.itemsize * count,
        )  # fmt: skip
        cloud.header.frame_id = 'hand_base'
        cloud.header.stamp.sec = int(self._random.integers(1, 2**31 - 1))
        for _ in range(int(self._random.integers(1, 4))):
            self._spoil(cloud, rows)
        cloud.data = array.array('B', rows.tobytes()[: int(self.pick((10**6, 10**6, 0, 37)))])
        return cloud

    def _spoil(self, cloud: PointCloud2, rows: Any) -> None:
        what = int(self._random.integers(8))
        if what == 0 and len(rows):
            with np.errstate(over='ignore'):
                real = [name for name in rows.dtype.names if rows.dtype[name].kind == 'f']
                rows[self.pick(real)][int(self._random.integers(len(rows)))] = self.number()
        elif what == 1:
            setattr(cloud, self.pick(('height', 'width', 'point_step', 'row_step')),
                    self.whole('uint32'))  # fmt: skip
        elif what == 2:
            one = self.pick(cloud.fields) if cloud.fields else PointField()
            one.datatype, one.count = self.whole('uint8'), self.whole('uint32')
        elif what == 3:
            names = [*TEXTS, *CONTACT_FIELDS]
            more = [PointField(name=self.pick(names), datatype=7, count=1) for _ in range(2)]
            cloud.fields = [*cloud.fields, *more]
        elif what == 4:
            cloud.fields = [one for one in cloud.fields if self._random.random() < 0.9]
        elif what == 5:
            cloud.header.stamp.sec = self.whole('int32')
            cloud.header.stamp.nanosec = self.whole('uint32')
        elif what == 6:
            cloud.header.frame_id = str(self.pick(TEXTS))
        else:
            cloud.is_bigendian = True


def _class_of(made: Any, name: str) -> type:
    """The message class that a sequence of another one holds."""
    import importlib

    text = made.get_fields_and_field_types()[name]
    found = re.fullmatch(r'sequence<([\w]+)/([\w]+)>', text)
    assert found is not None, text
    return getattr(importlib.import_module(f'{found.group(1)}.msg'), found.group(2))
