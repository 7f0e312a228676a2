# SPDX-License-Identifier: Apache-2.0
"""Message types without ROS: definition texts, type hashes and decoding, through rosbags."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from grasp_replay.errors import BagError


@cache
def standard_types() -> Typestore:
    """The types that every Jazzy has, and those found so far in the ROS installation."""
    return get_typestore(Stores.ROS2_JAZZY)


def definition_of(type_name: str) -> tuple[str, str]:
    """Full definition text and RIHS01 hash of a type such as `sensor_msgs/msg/JointState`.

    Both are empty for a type that neither rosbags nor the ROS installation knows; recording such
    a topic still works, as with rosbag2.
    """
    store = standard_types()
    try:
        if type_name not in store.types:
            _register_installed(type_name, store)
        text, _ = store.generate_msgdef(type_name, ros_version=2)
        return text, store.hash_rihs01(type_name)
    except Exception:  # rosbags raises KeyError, its own and parser errors for unknown types
        return '', ''


def _register_installed(type_name: str, store: Typestore) -> None:
    """Read `share/<package>/msg/<Name>.msg` and all it refers to into `store`."""
    waiting = [type_name]
    while waiting:
        name = waiting.pop()
        if name in store.types:
            continue
        package, _, message = name.partition('/msg/')
        types = get_types_from_msg(_installed_text(package, message), name)
        # A type is registered after those it uses, so that a missing one leaves no half.
        for other in _references(types):
            if other not in store.types and other != name:
                waiting.append(other)
        store.register(types)


def _installed_text(package: str, message: str) -> str:
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        path = Path(prefix) / 'share' / package / 'msg' / f'{message}.msg'
        if path.is_file():
            return path.read_text()
    raise KeyError(f'{package}/msg/{message}')


def _references(types: Any) -> set[str]:
    """Names of the message types that the fields of parsed types refer to."""
    found: set[str] = set()

    def visit(node: Any) -> None:
        if isinstance(node, str) and '/msg/' in node:
            found.add(node)
        elif isinstance(node, list | tuple):
            for item in node:
                visit(item)

    for _constants, fields in types.values():
        visit([description for _name, description in fields])
    return found


class Decoder:
    """Turns stored CDR bytes into rosbags messages, by the definitions that the bag carries."""

    def __init__(self) -> None:
        self._stores: dict[tuple[str, str], Typestore] = {}

    def decode(self, data: bytes, type_name: str, definition: str, encoding: str) -> Any:
        """A message object with the fields of `type_name`; raises BagError."""
        store = self.store(type_name, definition, encoding)
        try:
            return store.deserialize_cdr(data, type_name)
        except Exception as error:  # foreign bytes: rosbags raises whatever they provoke
            raise BagError(
                f'a message of {len(data)} bytes is no {type_name} ({type(error).__name__}: '
                f'{error}); check the bag with `bag_check`'
            ) from error

    def store(self, type_name: str, definition: str, encoding: str) -> Typestore:
        """The types that a definition in a bag introduces; raises BagError."""
        # The bag's own definition goes first: types change between ROS versions.
        if not definition:
            if type_name in standard_types().types:
                return standard_types()
            raise BagError(f'the type {type_name} is unknown and the bag does not define it')
        key = (type_name, definition)
        if key not in self._stores:
            store = get_typestore(Stores.EMPTY)
            try:
                if encoding == 'ros2idl':
                    store.register(get_types_from_idl(definition))
                else:
                    store.register(get_types_from_msg(definition, type_name))
            except Exception as error:  # rosbags' parser errors share no base class
                raise BagError(
                    f'the definition of {type_name} in the bag cannot be read '
                    f'({type(error).__name__}: {error})'
                ) from error
            self._stores[key] = store
        return self._stores[key]


def type_differs(type_name: str, type_hash: str, definition: str, encoding: str) -> str | None:
    """Why recorded bytes do not fit the type of this ROS version; None when nothing tells.

    `type_hash` is the recorded RIHS01 hash; without it, it is computed from `definition`.
    """
    ours = definition_of(type_name)[1]
    theirs = type_hash or _hash_of(type_name, definition, encoding)
    if not ours or not theirs or ours == theirs:
        return None
    return (
        f'its {type_name} was defined differently when it was recorded (hash {theirs[:15]}..., '
        f'here {ours[:15]}...): its bytes would be misread'
    )


@dataclass(frozen=True)
class TypeRecord:
    """What a recording says of a type; hash and definition are empty where it says nothing."""

    name: str
    hash: str
    definition: str
    encoding: str


def same_type(one: TypeRecord, other: TypeRecord) -> bool:
    """Do two recordings of a type lay out the same bytes, as far as they tell?

    Comments do not matter; a missing definition contradicts none.
    """
    if one.hash and other.hash:
        return one.hash == other.hash
    if one.definition == other.definition or not (one.definition and other.definition):
        return True
    hashes = [_hash_of(item.name, item.definition, item.encoding) for item in (one, other)]
    return '' not in hashes and hashes[0] == hashes[1]


def _hash_of(type_name: str, definition: str, encoding: str) -> str:
    if not definition:
        return ''
    try:
        return Decoder().store(type_name, definition, encoding).hash_rihs01(type_name)
    except Exception:  # a definition that cannot be parsed proves nothing
        return ''
