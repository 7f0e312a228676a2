# SPDX-License-Identifier: Apache-2.0
"""The report page: one offline HTML file and one picture per row of the table.

`write_report` is the whole interface; a `Report` is what it writes, the dataclasses of `scene`
what it draws.
"""

from __future__ import annotations

from .scene import Curve, LinearityTrace, PublishedRow, ReportError, RowScene, Section
from .write import Report, write_report

__all__ = [
    'Curve',
    'LinearityTrace',
    'PublishedRow',
    'Report',
    'ReportError',
    'RowScene',
    'Section',
    'write_report',
]
