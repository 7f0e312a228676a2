# SPDX-License-Identifier: Apache-2.0
"""A coloured surface that no light touches, as binary glTF 2.0 in memory.

Written here because the page's own coloured meshes are lit, which would change the colours of a
quantity. The file is three arrays and a header, so no library is needed to make it.
"""

from __future__ import annotations

import json
import struct

import numpy as np
import numpy.typing as npt

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125
_VERTICES, _INDICES = 34962, 34963


def unlit_glb(
    vertices: npt.NDArray[np.floating],
    triangles: npt.NDArray[np.integer],
    colours: npt.NDArray[np.floating],
) -> bytes:
    """The file's bytes: vertices (n, 3), triangles (t, 3), colours (n, 3) in linear light."""
    position = np.ascontiguousarray(vertices, dtype='<f4')
    colour = np.ascontiguousarray(colours, dtype='<f4')
    small = len(position) <= 65535
    index = np.ascontiguousarray(triangles, dtype='<u2' if small else '<u4').ravel()
    parts = [position, colour, index]
    data = b''.join(part.tobytes() for part in parts)
    data += b'\0' * (-len(data) % 4)
    views, start = [], 0
    for part, target in zip(parts, (_VERTICES, _VERTICES, _INDICES), strict=True):
        views.append(
            {'buffer': 0, 'byteOffset': start, 'byteLength': part.nbytes, 'target': target}
        )
        start += part.nbytes
    document = {
        'asset': {'version': '2.0'},
        'extensionsUsed': ['KHR_materials_unlit'],
        'scene': 0,
        'scenes': [{'nodes': [0]}],
        'nodes': [{'mesh': 0}],
        'meshes': [
            {
                'primitives': [
                    {
                        'attributes': {'POSITION': 0, 'COLOR_0': 1},
                        'indices': 2,
                        'material': 0,
                    }
                ]
            }
        ],
        'materials': [{'doubleSided': True, 'extensions': {'KHR_materials_unlit': {}}}],
        'accessors': [
            {
                'bufferView': 0,
                'componentType': _FLOAT,
                'count': len(position),
                'type': 'VEC3',
                'min': position.min(axis=0).tolist(),
                'max': position.max(axis=0).tolist(),
            },
            {'bufferView': 1, 'componentType': _FLOAT, 'count': len(colour), 'type': 'VEC3'},
            {
                'bufferView': 2,
                'componentType': _UINT16 if small else _UINT32,
                'count': len(index),
                'type': 'SCALAR',
            },
        ],
        'bufferViews': views,
        'buffers': [{'byteLength': len(data)}],
    }
    text = json.dumps(document).encode()
    text += b' ' * (-len(text) % 4)
    return b''.join(
        [
            struct.pack('<4sII', b'glTF', 2, 12 + 8 + len(text) + 8 + len(data)),
            struct.pack('<I4s', len(text), b'JSON'),
            text,
            struct.pack('<I4s', len(data), b'BIN\0'),
            data,
        ]
    )
