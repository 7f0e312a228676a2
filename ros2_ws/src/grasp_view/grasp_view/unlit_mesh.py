# SPDX-License-Identifier: Apache-2.0
"""Coloured bodies that no light of the browser touches, as binary glTF 2.0 in memory.

Written here because the page's own coloured meshes are lit, which would change the colours of a
quantity. The file is a few arrays and a header, so no library is needed to make it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125
_VERTICES, _INDICES = 34962, 34963


@dataclass(frozen=True)
class Body:
    """Vertices (n, 3), triangles (t, 3), colours in linear light: (n, 3), or (3,) for one.

    both: seen from both sides of its faces, else only from where they turn counter-clockwise.
    """

    vertices: npt.NDArray[np.floating]
    triangles: npt.NDArray[np.integer]
    colours: npt.NDArray[np.floating]
    both: bool = True


class _Arrays:
    """The binary part of the file, and its table of contents."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.length = 0

    def add(self, array: npt.NDArray[Any], target: int, kind: int, shape: str) -> int:
        """Number of the accessor of `array`."""
        data = array.tobytes()
        self.views.append(
            {
                'buffer': 0,
                'byteOffset': self.length,
                'byteLength': len(data),
                'target': target,
            }
        )
        data += b'\0' * (-len(data) % 4)
        self.parts.append(data)
        self.length += len(data)
        self.accessors.append(
            {
                'bufferView': len(self.views) - 1,
                'componentType': kind,
                'count': len(array),
                'type': shape,
            }
        )
        return len(self.accessors) - 1


def unlit_glb(bodies: Sequence[Body]) -> bytes:
    """The file's bytes."""
    arrays = _Arrays()
    primitives: list[dict[str, Any]] = []
    materials: list[dict[str, Any]] = []
    for body in bodies:
        position = np.ascontiguousarray(body.vertices, dtype='<f4')
        small = len(position) <= 65535
        index = np.ascontiguousarray(body.triangles, dtype='<u2' if small else '<u4').ravel()
        place = arrays.add(position, _VERTICES, _FLOAT, 'VEC3')
        low, high = position.min(axis=0).tolist(), position.max(axis=0).tolist()
        arrays.accessors[place].update(min=low, max=high)
        attributes = {'POSITION': place}
        material: dict[str, Any] = {
            'doubleSided': body.both,
            'extensions': {'KHR_materials_unlit': {}},
        }
        if body.colours.ndim == 2:
            colour = np.ascontiguousarray(body.colours, dtype='<f4')
            attributes['COLOR_0'] = arrays.add(colour, _VERTICES, _FLOAT, 'VEC3')
        else:
            factor = [*map(float, body.colours), 1.0]
            material['pbrMetallicRoughness'] = {'baseColorFactor': factor}
        primitives.append(
            {
                'attributes': attributes,
                'indices': arrays.add(index, _INDICES, _UINT16 if small else _UINT32, 'SCALAR'),
                'material': len(materials),
            }
        )
        materials.append(material)
    document = {
        'asset': {'version': '2.0'},
        'extensionsUsed': ['KHR_materials_unlit'],
        'scene': 0,
        'scenes': [{'nodes': [0]}],
        'nodes': [{'mesh': 0}],
        'meshes': [{'primitives': primitives}],
        'materials': materials,
        'accessors': arrays.accessors,
        'bufferViews': arrays.views,
        'buffers': [{'byteLength': arrays.length}],
    }
    text = json.dumps(document).encode()
    text += b' ' * (-len(text) % 4)
    return b''.join(
        [
            struct.pack('<4sII', b'glTF', 2, 12 + 8 + len(text) + 8 + arrays.length),
            struct.pack('<I4s', len(text), b'JSON'),
            text,
            struct.pack('<I4s', arrays.length, b'BIN\0'),
            *arrays.parts,
        ]
    )
