# SPDX-License-Identifier: Apache-2.0
"""Figures and tables of a page, numbered in the order in which they stand there."""

from __future__ import annotations

import re
from itertools import count

CAPTIONS = {'figcaption': 'Figure', 'caption': 'Table'}
"""Elements whose text is begun with a number; those with attributes are left alone."""


def numbered(page: str) -> str:
    """The page with `Figure 1.`, `Table 1.` and so on before the text of every caption."""
    numbers = {element: count(1) for element in CAPTIONS}

    def begun(found: re.Match[str]) -> str:
        element = found[1]
        return f'<{element}><b>{CAPTIONS[element]} {next(numbers[element])}.</b> '

    return re.sub(f'<({"|".join(CAPTIONS)})>', begun, page)
