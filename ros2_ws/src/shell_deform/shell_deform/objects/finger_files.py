# SPDX-License-Identifier: Apache-2.0
"""Where the files of fingertips are: those that come with the package, by name, and any other."""

from __future__ import annotations

from pathlib import Path

_SHIPPED = Path(__file__).parent / 'fingers'


def body_names() -> list[str]:
    """Names of the bodies that come with the package."""
    return sorted(path.stem for path in _SHIPPED.glob('*.yaml'))


def find_body(text: str, folder: Path) -> Path | None:
    """The file of a shipped body by name, or one named from `folder`; None where there is none."""
    if text in body_names():
        return _SHIPPED / f'{text}.yaml'
    path = folder / text
    return path if path.is_file() else None
