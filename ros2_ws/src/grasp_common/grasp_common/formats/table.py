# SPDX-License-Identifier: Apache-2.0
"""Tables of points in text (.xyz, .txt, .asc, .csv, .pts): numpy's parser, a sniffed dialect.

The first lines tell what separates the columns, whether a comma is a decimal point, and which
columns are x, y and z: a heading decides that, not their position. What cannot be told is refused.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from grasp_common.formats.raw import (
    RawMesh,
    Rows,
    ScanFileError,
    chunks_of_lines,
    tokens_per_line,
)

SNIFFED_BYTES = 2**16
MOST_TITLES = 50
"""Lines of words that may stand in front of the numbers."""

FEWEST_COUNTED = 5
"""So many lines tell a running number from a coordinate."""

SAME_STEP = 1e-3
"""Steps of a running number or a time differ by less than this share: it is rounded."""

_COMMENT = re.compile(rb'(#|//)[^\n]*')
_NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?\Z|[+-]?(nan|inf|infinity)\Z', re.I)
_DECIMAL_COMMA = re.compile(r'[+-]?\d*,\d+([eE][+-]?\d+)?\Z')
_WHOLE = re.compile(r'\d+\Z')
_LENGTH = r'(?:mm|cm|um|µm|m|in|inch|inches|ft)'
_AXIS = re.compile(
    rf'(?:points?|pos|positions?|coords?|coordinates?|vertex|vertices)?[\s:_.\-]*([xyz])'
    rf'[\s:_.\-]*(?:coords?|coordinates?|pos|position)?[\s:_.\-/]*[\[(]?\s*{_LENGTH}?\s*[\])]?\Z',
    re.IGNORECASE,
)
_NUMBERED_AXIS = re.compile(
    r'(?:points?|coordinates?|position|vertices)\s*[:_.]?\s*([012])\Z', re.I
)

_WAY_OUT = 'export it with decimal points'


@dataclass(frozen=True)
class _Dialect:
    """How a table is written; `delimiter` None: blanks; `axes`: columns of x, y and z."""

    delimiter: str | None
    decimal_comma: bool
    columns: int
    axes: tuple[int, int, int]
    titles: int
    declared: int | None
    notes: tuple[str, ...]


def read_table(data: bytes) -> RawMesh:
    """Read the points of a table of text, one a line.

    Comments (`#`, `//`), lines of words in front and one line with the number of points are
    understood; columns other than x, y and z (colour, intensity, normal) are not looked at.
    Raises ScanFileError if a coordinate is missing or no number, if lines differ in their number
    of columns, if fewer points follow than declared, or if the table can be read in two ways.
    """
    dialect = _sniffed(data)
    points = Rows(np.float64, 3)
    skip = dialect.titles
    line = 1
    for chunk in chunks_of_lines(data):
        text, lines = chunk, chunk.count(b'\n')
        if skip:
            text, skip = _without_lines(text, skip)
        if b'#' in text or b'//' in text:
            text = _COMMENT.sub(b'', text)
        if not text.isspace() and text:
            points.add(_numbers(text, dialect, line + lines - text.count(b'\n')))
        line += lines
    if not len(points):
        raise ScanFileError('a table without any point')
    if dialect.declared is not None and dialect.declared != len(points):
        cut = len(points) < dialect.declared
        raise ScanFileError(
            f'its first line declares {dialect.declared} points but {len(points)} follow; '
            + ('the file is cut: copy' if cut else 'its count is wrong: correct')
            + ' or export it again'
        )
    return RawMesh(points.table(), None, dialect.notes)


def _without_lines(text: bytes, count: int) -> tuple[bytes, int]:
    """Drop the first `count` lines; the rest, and how many are still to be dropped."""
    position = 0
    while count:
        end = text.find(b'\n', position)
        if end < 0:
            return b'', count - 1
        position, count = end + 1, count - 1
    return text[position:], 0


def _numbers(text: bytes, dialect: _Dialect, line: int) -> np.ndarray:
    """Read x, y and z of each line of `text`, which begins at line `line` of the file."""
    _check_columns(text, dialect)
    if dialect.decimal_comma:
        text = text.replace(b',', b'.')
    try:
        return np.loadtxt(
            io.BytesIO(text),
            delimiter=dialect.delimiter,
            usecols=dialect.axes,
            comments=None,
            quotechar='"' if b'"' in text else None,
            ndmin=2,
            encoding='latin-1',
        )
    except ValueError as error:
        raise ScanFileError(_fault(str(error), text, dialect, line)) from None


def _check_columns(text: bytes, dialect: _Dialect) -> None:
    if b'"' in text:
        return  # numpy counts them: a quoted separator separates nothing
    if dialect.delimiter is None:
        counts = tokens_per_line(text)
    else:
        lines = [line for line in text.split(b'\n') if line and not line.isspace()]
        mark = dialect.delimiter.encode()
        counts = 1 + np.fromiter((line.count(mark) for line in lines), np.int64, len(lines))
    different = np.flatnonzero(counts != dialect.columns)
    if different.size:
        other = int(counts[different[0]])
        cause = 'the file is cut or not a table of points'
        if other == 1:
            cause = 'it is cut, or several scans follow each other: give each a file of its own'
        raise ScanFileError(
            f'lines have {dialect.columns} columns at first and {other} later; {cause}'
        )


def _fault(message: str, text: bytes, dialect: _Dialect, line: int) -> str:
    """Say in our words which field of which line numpy could not read."""
    place = re.search(r"'(.*)' to float64 at row (\d+), column (\d+)", message, re.DOTALL)
    if not place:
        return f'a line from line {line} on is not a row of the table ({message.splitlines()[0]})'
    rows = [number for number, row in enumerate(text.split(b'\n')) if row and not row.isspace()]
    row = int(place[2])
    where = line + (rows[row] if row < len(rows) else row)
    axis = 'xyz'[dialect.axes.index(int(place[3]) - 1)]
    field = place[1].strip()
    if not field:
        return f'line {where}: {axis} is missing; drop the line or write nan'
    if _DECIMAL_COMMA.match(field):
        return f'line {where}: {axis} {field[:40]!r} has a decimal comma; {_WAY_OUT}'
    return f'line {where}: {axis} {field[:40]!r} is not a number'


def _sniffed(data: bytes) -> _Dialect:
    """Find out from its first lines how a table is written; raises ScanFileError."""
    front = _front(data)
    rows, titles = front.rows, front.titles
    delimiter, decimal_comma = _separators(rows)
    count = len(_fields(rows[0], delimiter))
    if count < 3:
        raise ScanFileError(f'a line with {count} columns; x, y and z are needed')
    if delimiter == ',' and all(len(_fields(row, ',')) == count for row in rows):
        _refuse_split_decimals(rows, count)
    axes = _heading(titles, front.comments[-1:], delimiter, count)
    if axes is None and count > 3:
        _refuse_counted(rows, delimiter)
    notes = ['decimal commas read as points'] if decimal_comma else []
    if axes is None:
        axes = (0, 1, 2)
        if titles:
            notes.append(f'{len(titles)} lines in front passed over: {titles[-1][:40]!r}')
    elif axes != (0, 1, 2):
        notes.append(f'x, y, z in columns {axes[0] + 1}, {axes[1] + 1}, {axes[2] + 1}')
    return _Dialect(
        delimiter, decimal_comma, count, axes, front.passed, front.declared, tuple(notes)
    )


@dataclass
class _Front:
    """The first lines of a table: of words, comments, the declared number of points, rows.

    `passed` is the number of lines before the first row.
    """

    titles: list[str] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    rows: list[str] = field(default_factory=list)
    declared: int | None = None
    passed: int = 0


def _front(data: bytes) -> _Front:
    """Sort the first lines by what they are; raises ScanFileError without any row."""
    front = _Front()
    for number, (line, comment) in enumerate(_first_lines(data)):
        words = re.sub('[",;|]', ' ', line).split()
        if not words:
            front.comments += [comment] if comment and not front.rows else []
        elif front.rows:
            front.rows.append(line)
        elif _WHOLE.match(line.strip(' \t')) and not front.titles:
            if front.declared is not None:
                raise ScanFileError('two numbers alone in front, as in PTX; export PTS or PLY')
            front.declared = int(line)
        elif not any(map(_is_number, words)):
            front.titles.append(line)
            if len(front.titles) > MOST_TITLES:
                raise ScanFileError(f'no numbers in its first {MOST_TITLES} lines; no table')
        else:
            front.rows.append(line)
            front.passed = number
    if not front.rows:
        raise ScanFileError('a table without any point')
    return front


def _first_lines(data: bytes) -> Iterator[tuple[str, str]]:
    """Yield (content, comment) of the lines at the front; the last one, if cut, is left out."""
    head = data[:SNIFFED_BYTES].replace(b'\r\n', b'\n').replace(b'\r', b'\n')
    lines = head.split(b'\n')
    for line in lines[:-1] if len(data) > SNIFFED_BYTES and len(lines) > 1 else lines:
        comment = _COMMENT.search(line)
        content = line[: comment.start()] if comment else line
        said = comment[0].lstrip(b'#/') if comment else b''
        # a tab at an end separates an empty field
        yield content.decode('latin-1').strip(' '), said.decode('latin-1').strip()


def _is_number(word: str) -> bool:
    return bool(_NUMBER.match(word))


def _separators(rows: list[str]) -> tuple[str | None, bool]:
    """What separates columns (None: blanks) and whether a comma is a decimal point."""
    quoted = any('"' in row for row in rows)
    plain = [re.sub(r'"[^"]*"', '0', row) for row in rows] if quoted else rows
    commas = any(',' in row for row in plain)
    for mark in ';\t|':
        # each line has them: a stray tab among blanks separates no columns of its own
        if all(row.count(mark) >= 2 for row in plain if row.strip()):
            if commas and any(
                '.' in field and ',' in field for row in rows for field in row.split(mark)
            ):
                raise ScanFileError(
                    f'numbers with both a point and a comma, such as {rows[0][:40]!r}; {_WAY_OUT}'
                )
            return mark, commas
    if not commas:
        return None, False
    words = [word for row in plain for word in row.split()]
    # a comma at the end of a word separates it from the next
    words = [word.removesuffix(',') for word in words]
    if (
        any(len(row.split()) >= 3 for row in plain)
        and any(map(_DECIMAL_COMMA.match, words))
        and all(_DECIMAL_COMMA.match(word) or _is_number(word) for word in words)
    ):
        raise ScanFileError(f'decimal commas, as in {rows[0][:40]!r}; {_WAY_OUT}')
    return ',', False


def _refuse_split_decimals(rows: list[str], count: int) -> None:
    """Raise ScanFileError for decimal commas in a table that commas separate as well.

    Then every second column is the digits after a comma: never signed, of one length or, where
    zeros at the end were dropped, beginning with a zero here and there.
    """
    if count % 2 or count < 6:
        return
    fields = [_fields(row, ',') for row in rows if row.strip()]
    tails = [row[k] for row in fields for k in range(1, count, 2)]
    heads = [row[k] for row in fields for k in range(0, count, 2)]
    digits = all(map(str.isdigit, tails)) and (
        len({len(tail) for tail in tails}) == 1
        or any(tail[0] == '0' and len(tail) > 1 for tail in tails)
        or '-0' in heads
    )
    if digits and len(rows) > 3 and all(re.match(r'[+-]?\d+\Z', head) for head in heads):
        raise ScanFileError(
            f'whole numbers in pairs, such as {rows[0][:40]!r}: commas seem to be both decimal '
            f'points and separators; {_WAY_OUT}'
        )


def _refuse_counted(rows: list[str], delimiter: str | None) -> None:
    """Raise ScanFileError if the first of more than three unnamed columns counts or is a time.

    That is one that grows by the same step from each line to the next.
    """
    first = [_fields(row, delimiter)[0] for row in rows if row.strip()]
    if len(first) < FEWEST_COUNTED or not all(map(_is_number, first)):
        return
    with np.errstate(invalid='ignore'):
        steps = np.diff([float(word.lower().replace('d', 'e')) for word in first])
        same = steps[0] > 0.0 and np.ptp(steps) <= SAME_STEP * steps[0]
    if same:
        raise ScanFileError(
            f'its first column numbers the points ({", ".join(first[:3])}, ...) and no heading '
            'names the others; write a heading such as "n x y z", or drop that column'
        )


def _fields(line: str, delimiter: str | None) -> list[str]:
    if '"' in line and delimiter is not None:
        parts = re.findall(rf'(?:"[^"]*"|[^{re.escape(delimiter)}"])*', line)
        # every field is followed by an empty match at its separator
        return [part.strip().strip('"').strip() for part in _every_field(parts)]
    if delimiter is None:
        return [part.strip('"') for part in line.split()]
    return [part.strip() for part in line.split(delimiter)]


def _every_field(parts: list[str]) -> list[str]:
    fields, place = [], 0
    while place < len(parts):
        fields.append(parts[place])
        place += 2 if parts[place] else 1
    return fields


def _heading(
    titles: list[str], comments: list[str], delimiter: str | None, count: int
) -> tuple[int, int, int] | None:
    """The columns of x, y and z by the names in front; None without names.

    Raises ScanFileError for names that are there and do not tell; a comment need not tell.
    """
    unknown: list[str] | None = None
    for line in reversed(titles):
        for names in (_fields(line, mark) for mark in (delimiter, None, ',', ';', '\t')):
            axes = _axes(names)
            if axes is not None and len(names) == count:
                return axes
            if len(names) == count or any(map(_AXIS.match, names)):
                unknown = unknown or names
    for line in comments:
        for names in (_fields(line, delimiter), _fields(line, None)):
            axes = _axes(names)
            if axes is not None and len(names) == count:
                return axes
    if unknown is None:
        return None
    if len(unknown) != count:
        raise ScanFileError(
            f'its heading names {len(unknown)} columns ({", ".join(unknown)[:60]}), its lines '
            f'have {count}; export it again'
        )
    raise ScanFileError(
        f'its heading ({", ".join(unknown)[:60]}) does not name x, y and z; rename its columns or '
        'delete the heading'
    )


def _axes(names: list[str]) -> tuple[int, int, int] | None:
    for pattern, letters in ((_AXIS, 'xyz'), (_NUMBERED_AXIS, '012')):
        found = [match[1].lower() if (match := pattern.match(name)) else '' for name in names]
        if all(found.count(letter) == 1 for letter in letters):
            x, y, z = (found.index(letter) for letter in letters)
            return x, y, z
    return None
