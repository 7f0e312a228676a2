# SPDX-License-Identifier: Apache-2.0
"""What a file is before it is a scan: compressed, in another text encoding, or something else.

Compression and encoding are undone; what no reader here can take is named with the way out.
"""

from __future__ import annotations

import codecs
import re
import zlib

from grasp_common.formats.raw import ScanFileError

GZIP = b'\x1f\x8b'
LARGEST_EXPANSION = 64
"""A compressed file may hold this many times its own bytes, and SMALL_ANYWAY: text of a scan
shrinks to a fifth, meshes to a half."""
SMALL_ANYWAY = 2**24

_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF32_LE, 'utf-32-le'),
    (codecs.BOM_UTF32_BE, 'utf-32-be'),
    (codecs.BOM_UTF16_LE, 'utf-16-le'),
    (codecs.BOM_UTF16_BE, 'utf-16-be'),
)

_OTHERS: tuple[tuple[bytes, str], ...] = (
    (rb'\Aversion https://git-lfs', 'a Git LFS pointer, not the file; fetch it: `git lfs pull`'),
    (
        rb'\A\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*(<!doctype html|<(html|head|body|title)\b)',
        'a web page and not the file; download the file itself',
    ),
    (
        rb'\A(404: Not Found|\s*(<\?xml[^>]*>\s*)?<Error>)',
        'the answer of a server that does not have the file; download the file itself',
    ),
    (rb'\AASTM-E57', 'an E57 file; export PLY, PCD or XYZ from the scanner software'),
    (rb'\AglTF', 'a glTF file; export PLY, OBJ or STL'),
    (rb'\A(Kaydara FBX|; FBX)', 'an FBX file; export PLY, OBJ or STL'),
    (rb'\ALASF', 'a LAS point cloud; export PLY, PCD or XYZ'),
    (rb'\A# vtk DataFile', 'a VTK file; export PLY or STL'),
    (rb'\A\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)?<COLLADA', 'a COLLADA file; export PLY or OBJ'),
    (rb'\A\s*(<\?xml[^>]*>\s*)?(<!DOCTYPE X3D.*?>\s*)?<X3D', 'an X3D file; export VRML 2 or PLY'),
    (rb'\A\s*(<\?xml[^>]*>\s*)?<VTKFile', 'a VTK file; export PLY or STL'),
    (rb'\A\s*(<\?xml[^>]*>\s*)?<amf', 'an AMF file; export STL or PLY'),
    (rb'\A\s*<\?xml', 'an XML document and no scan; export PLY, OBJ or STL'),
    (rb'\A\s*(\{\s*["}]|\[\s*[\[{"\d-])', 'a JSON document and no scan; export the scan'),
    (rb'\AISO-10303-21', 'a STEP file; export STL or PLY'),
    (rb'\A\s*0\s+SECTION\b', 'a DXF file; export STL or PLY'),
    (rb'\ABLENDER', 'a Blender file; export PLY, OBJ or STL'),
    (rb'\A(#usda|PXR-USDC)', 'a USD file; export PLY, OBJ or STL'),
    (rb'\A\x93NUMPY', 'an array of numpy; write it with `numpy.savetxt` as XYZ'),
    (rb'\A\x89HDF', 'an HDF5 file; export PLY or XYZ'),
    (rb'\A\xd0\xcf\x11\xe0', 'a document of an office or CAD program; export CSV, STL or PLY'),
    (rb'\A\s*ncols\s+\d', 'a grid of heights (ESRI ASCII); export XYZ or PLY'),
    (rb'\A.{257}ustar', 'a tar archive; unpack it first: `tar xf`'),
    (rb'\A%PDF', 'a PDF document and no scan'),
    (rb'\A\x89PNG|\A\xff\xd8\xff', 'a picture and no scan'),
    (
        rb'\A(\x89MCAP|SQLite format 3|#ROSBAG)',
        'a recorded bag and no scan file; give it to `grasp_report`',
    ),
    (rb'\A\x28\xb5\x2f\xfd', 'compressed by zstd; unpack it first: `zstd -d`'),
    (rb'\ABZh[1-9]1AY', 'compressed by bzip2; unpack it first: `bunzip2`'),
    (rb'\A\xfd7zXZ\0', 'compressed by xz; unpack it first: `unxz`'),
    (rb"\A7z\xbc\xaf'\x1c", 'a 7z archive; unpack it first'),
    (rb'\ARar!', 'a RAR archive; unpack it first'),
)  # fmt: skip
_PATTERNS = tuple(
    (re.compile(pattern, re.IGNORECASE | re.DOTALL), what) for pattern, what in _OTHERS
)
_LOOKED_AT = 2048
_ZIP = b'PK\x03\x04'


def opened(data: bytes, suffix: str) -> tuple[bytes, tuple[str, ...]]:
    """Undo compression and text encoding of a file of type `suffix`; notes on what was undone.

    Raises ScanFileError for what is known to be something else than a scan.
    """
    notes: tuple[str, ...] = ()
    if data.startswith(GZIP):
        data, notes = _gunzipped(data), ('unpacked with gzip',)
    encoding = _encoding(data)
    if encoding:
        try:
            data = data.decode(encoding).lstrip('\ufeff').encode()
        except UnicodeDecodeError as error:
            raise ScanFileError(
                f'text in {encoding.upper()} that is cut or damaged ({error})'
            ) from None
        notes = (*notes, f'text in {encoding.upper()}')
    elif data.startswith(codecs.BOM_UTF8):
        data = data[len(codecs.BOM_UTF8) :]
    _refuse_others(data, suffix)
    return data, notes


def _gunzipped(data: bytes) -> bytes:
    """Unpack all members of a gzip file within bounded memory; raises ScanFileError."""
    most = LARGEST_EXPANSION * len(data) + SMALL_ANYWAY
    pieces: list[bytes] = []
    size = 0
    while data:
        member = zlib.decompressobj(16 + zlib.MAX_WBITS)
        try:
            pieces.append(member.decompress(data, most + 1 - size))
        except zlib.error as error:
            if pieces:
                # zeros and rubbish after the last member are common on copied media
                break
            raise ScanFileError(
                f'compressed by gzip but damaged ({error}); copy it again'
            ) from None
        size += len(pieces[-1])
        if size > most:
            raise ScanFileError(
                f'compressed by gzip to less than a {LARGEST_EXPANSION}th, as no scan is; unpack '
                'it first: `gunzip`'
            )
        if not member.eof:
            raise ScanFileError('compressed by gzip and cut; copy it again')
        data = member.unused_data
    return pieces[0] if len(pieces) == 1 else b''.join(pieces)


def _refuse_others(data: bytes, suffix: str) -> None:
    head = data[:_LOOKED_AT]
    for pattern, what in _PATTERNS:
        if pattern.match(head):
            raise ScanFileError(f'this is {what}')
    if head.startswith(_ZIP):
        if suffix.lower() == '.3mf' or b'3D/' in head or b'[Content_Types].xml' in head:
            raise ScanFileError('this is a 3MF file; export STL or PLY')
        raise ScanFileError('this is a zip archive; unpack it first: `unzip`')
    if suffix.lower() == '.ptx':
        raise ScanFileError('this is a PTX file; export PTS, PLY or XYZ')


def _encoding(data: bytes) -> str:
    """The encoding of text that is not made of single bytes, '' for all other content."""
    for mark, encoding in _BYTE_ORDER_MARKS:
        if data.startswith(mark):
            return encoding
    # without a mark: text of Latin characters has a zero in every second byte
    head = data[:512]
    head = head[: len(head) // 2 * 2]
    if len(head) >= 8 and b'\0' in head:
        even, odd = head[::2], head[1::2]
        for zeros, others, encoding in ((odd, even, 'utf-16-le'), (even, odd, 'utf-16-be')):
            if not zeros.strip(b'\0') and all(9 <= byte < 127 for byte in others):
                return encoding
    return ''
