# SPDX-License-Identifier: Apache-2.0
"""A page of its own in the style of the report, for what is not a whole recording."""

from __future__ import annotations

from importlib.resources import files

from markupsafe import Markup

from .numbering import numbered

FRAME = Markup(
    '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
    '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
    '<title>{title}</title><link rel="icon" href="data:,"><style>{css}</style></head>\n'
    '<body><h1>{title}</h1>\n{body}\n</body></html>\n'
)


def plain_page(title: str, body: Markup) -> str:
    """The page as text: title, then `body` (HTML) with its figures and tables numbered."""
    css = (files(__package__) / 'page.css').read_text()
    return numbered(FRAME.format(title=title, css=Markup(css), body=body))
