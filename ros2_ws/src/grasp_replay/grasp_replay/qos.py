# SPDX-License-Identifier: Apache-2.0
"""QoS profiles as bags store them: rosbag2's YAML in all its versions, and override files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from grasp_common import bounded_yaml
from grasp_replay.errors import BagError

# Names in rosbag2 version 9; their places are the numbers that older versions wrote.
HISTORIES = ('system_default', 'keep_last', 'keep_all', 'unknown')
RELIABILITIES = ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available')
DURABILITIES = ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available')
LIVELINESSES = ('system_default', 'automatic', 'manual_by_node', 'manual_by_topic', 'unknown')
FOREVER = 2**63 - 1


@dataclass(frozen=True)
class QosProfile:
    """A QoS profile; durations in ns, `FOREVER` for none."""

    history: str = 'keep_last'
    depth: int = 10
    reliability: str = 'reliable'
    durability: str = 'volatile'
    deadline: int = FOREVER
    lifespan: int = FOREVER
    liveliness: str = 'automatic'
    liveliness_lease_duration: int = FOREVER


class _PlainDumper(yaml.SafeDumper):
    """Writes equal parts out each time: readers of bags need not know YAML's anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def plain_yaml(document: Any) -> str:
    """`document` as YAML without anchors, keys in their order."""
    return yaml.dump(document, Dumper=_PlainDumper, sort_keys=False)


def qos_text(*profiles: QosProfile) -> str:
    """Profiles as rosbag2's YAML list (version 9), ready for `BagWriter.add_topic`."""
    return plain_yaml(
        [
            {
                'history': profile.history,
                'depth': profile.depth,
                'reliability': profile.reliability,
                'durability': profile.durability,
                'deadline': _seconds(profile.deadline),
                'lifespan': _seconds(profile.lifespan),
                'liveliness': profile.liveliness,
                'liveliness_lease_duration': _seconds(profile.liveliness_lease_duration),
                'avoid_ros_namespace_conventions': False,
            }
            for profile in profiles
        ]
    )


def parse_qos_text(text: str) -> list[QosProfile]:
    """The profiles of rosbag2's YAML list; raises BagError when it is none."""
    try:
        document = bounded_yaml.load(text) if text else []
    except yaml.YAMLError as error:
        raise BagError(f'the QoS profiles {text[:40]!r}... are no YAML') from error
    if not isinstance(document or [], list):
        raise BagError(f'the QoS profiles {text[:40]!r}... are no list')
    return [parse_profile(item) for item in document or []]


def parse_profile(item: object) -> QosProfile:
    """One profile from its YAML table; absent keys take rclpy's defaults; raises BagError."""
    if not isinstance(item, dict):
        raise BagError(f'a QoS profile must be a table, not {item!r}')
    depth = item.get('depth', 10)
    if not isinstance(depth, int) or not 0 <= depth < 2**31:
        raise BagError(f'QoS depth {depth!r} is no whole number >= 0')
    return QosProfile(
        _choice(item, 'history', HISTORIES, 'keep_last'),
        depth,
        _choice(item, 'reliability', RELIABILITIES, 'reliable'),
        _choice(item, 'durability', DURABILITIES, 'volatile'),
        _nanoseconds(item, 'deadline'),
        _nanoseconds(item, 'lifespan'),
        _choice(item, 'liveliness', LIVELINESSES, 'automatic'),
        _nanoseconds(item, 'liveliness_lease_duration'),
    )


def read_overrides(path: Path) -> dict[str, QosProfile]:
    """QoS profiles by topic name from a YAML file as rosbag2 takes it; raises BagError."""
    try:
        document = bounded_yaml.read(path)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise BagError(f'{path}: the QoS overrides cannot be read ({reason})') from error
    if not isinstance(document, dict):
        raise BagError(f'{path}: QoS overrides are a table of topic names, not {document!r}')
    try:
        return {str(topic): parse_profile(item) for topic, item in document.items()}
    except BagError as error:
        raise BagError(f'{path}: {error}') from error


def common_offer(profiles: list[QosProfile]) -> QosProfile:
    """One profile that satisfies whoever could listen to each of the recorded publishers.

    Reliable and latched only if all of them were; the deepest history. Deadlines and lifespans
    are left out: a replay that lags must not lose messages by them.
    """
    if not profiles:
        return QosProfile()
    return QosProfile(
        'keep_all' if any(p.history == 'keep_all' for p in profiles) else 'keep_last',
        max(10, *(p.depth for p in profiles)),
        'best_effort' if any(p.reliability == 'best_effort' for p in profiles) else 'reliable',
        'transient_local'
        if all(p.durability == 'transient_local' for p in profiles)
        else 'volatile',
    )


def _choice(item: dict[str, Any], key: str, names: tuple[str, ...], default: str) -> str:
    value = item.get(key, default)
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < len(names):
        return names[value]
    if isinstance(value, str) and value.lower() in names:
        return value.lower()
    raise BagError(f'QoS {key} {value!r} is none of {", ".join(names)}')


def _nanoseconds(item: dict[str, Any], key: str) -> int:
    value = item.get(key)
    if value is None:
        return FOREVER
    try:
        total = int(value['sec']) * 1_000_000_000 + int(value['nsec'])
    except (TypeError, KeyError, ValueError) as error:
        raise BagError(f'QoS {key} {value!r} is not {{sec: ..., nsec: ...}}') from error
    # Zero and the largest numbers of each version all mean: not set.
    return total if 0 < total < 2**31 * 1_000_000_000 else FOREVER


def _seconds(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {'sec': seconds, 'nsec': rest}
