# SPDX-License-Identifier: Apache-2.0
"""Reading the contacts of an object file that are grips: an edge, or a patch of the surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from .shell_object import GripPlace
from .yaml_reader import Entry


def read_place(entry: Entry) -> tuple[float, float, float]:
    """A place [m]."""
    x, y, z = (value.number(minimum=-1000, maximum=1000) for value in entry.items(3))
    return x, y, z


def read_grip(entry: Entry, edge: Callable[[Entry], str]) -> GripPlace:
    """A contact of kind grip; `edge` reads the name of an edge.

    Raises ObjectError, with the line, for one that is neither an edge nor a patch.
    """
    found = entry.mapping(['kind'], ['where', 'at_m', 'radius_m', 'hold', 'free'])
    at = read_place(found['at_m']) if 'at_m' in found else None
    free: list[Any] = []
    for axis in found['free'].items() if 'free' in found else []:
        free.append(axis.text(['x', 'y', 'z']))
        if free.count(free[-1]) > 1:
            raise axis.error(f'free names {free[-1]} twice')
    if 'where' in found:
        if 'radius_m' in found:
            raise found['radius_m'].error('a grip is an edge (where) or a patch (radius_m)')
        hold = cast(
            Any, found['hold'].text(['hinged', 'clamped']) if 'hold' in found else 'hinged'
        )
        return GripPlace(edge(found['where']), at, None, hold, tuple(free))
    if at is None or 'radius_m' not in found:
        raise entry.error(
            'a grip holds an edge or a plane, where: …, or a patch, at_m: … with radius_m: …'
        )
    if 'hold' in found:
        raise found['hold'].error('hold is for the edge of a grip; a patch is held as it is')
    return GripPlace(
        None, at, found['radius_m'].number(above=0.0, maximum=1000.0), 'hinged', tuple(free)
    )
