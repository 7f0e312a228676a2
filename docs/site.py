# SPDX-License-Identifier: Apache-2.0
"""The documentation site, `make docs`: the pages as they are, and a reference from docstrings.

MkDocs reads one folder; this puts it together in `out/docs`: the README, `docs/`, the READMEs of
the packages, and one page per room of a package with the docstrings of its modules. Links between
pages stay links; those to files that are no pages become plain text. Warnings are errors.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / 'ros2_ws' / 'src'
PAGES = ROOT / 'out' / 'docs'
SITE = ROOT / 'out' / 'site'
PICTURES = ('.png', '.gif', '.svg')
LINK = re.compile(r'(!?)\[([^\]]*)\]\(([^)\s#]*)(#[^)\s]*)?\)')


def packages() -> list[str]:
    """The packages of the workspace, by name."""
    return sorted(path.parent.name for path in SOURCES.glob('*/setup.py'))


def pages() -> dict[Path, str]:
    """Where each page of the repository stands in the site."""
    found = {ROOT / 'README.md': 'index.md', ROOT / 'CONTRIBUTING.md': 'contributing.md'}
    found |= {path: path.name for path in sorted((ROOT / 'docs').glob('*.md'))}
    tutorials = sorted((ROOT / 'docs' / 'tutorials').glob('*.md'))
    found |= {path: f'tutorials/{path.name}' for path in tutorials}
    found |= {SOURCES / name / 'README.md': f'packages/{name}.md' for name in packages()}
    found[ROOT / 'bags' / 'README.md'] = 'recordings.md'
    return found


def linked(text: str, source: Path, places: dict[Path, str]) -> str:
    """The text of a page with its links turned to where they lead in the site."""
    here = PAGES / places[source]

    def turned(match: re.Match[str]) -> str:
        mark, label, target, anchor = match.groups()
        if not target or '://' in target:
            return match.group(0)
        path = (source.parent / target).resolve()
        if path in places:
            return f'[{label}]({os.path.relpath(PAGES / places[path], here.parent)}{anchor or ""})'
        if path.suffix in PICTURES:
            copy = PAGES / 'pictures' / path.name
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)
            return f'{mark}[{label}]({os.path.relpath(copy, here.parent)})'
        return label

    return LINK.sub(turned, text)


def rooms(package: str) -> dict[str, list[str]]:
    """The modules of a package, by the room (folder or module) that they stand in."""
    base = SOURCES / package / package
    found: dict[str, list[str]] = {}
    for path in sorted(base.rglob('*.py')):
        parts = path.relative_to(base).with_suffix('').parts
        names = parts[:-1] if parts[-1] == '__init__' else parts
        room = parts[0] if len(parts) > 1 else ''
        found.setdefault(room, []).append('.'.join((package, *names)))
    return found


def reference() -> Iterator[tuple[str, str]]:
    """Path and text of every page of the reference."""
    for package in packages():
        for room, modules in rooms(package).items():
            name = f'{package}.{room}' if room else package
            body = '\n\n'.join(f'::: {module}' for module in modules)
            yield f'reference/{package}/{room or "top"}.md', f'# {name}\n\n{body}\n'


def gather() -> None:
    """Put all pages where MkDocs reads them."""
    shutil.rmtree(PAGES, ignore_errors=True)
    places = pages()
    texts = {place: linked(source.read_text(), source, places) for source, place in places.items()}
    for place, text in (*texts.items(), *reference()):
        path = PAGES / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def main() -> int:
    """Build the site; the exit code is not 0 if anything is amiss."""
    gather()
    command = [sys.executable, '-m', 'mkdocs', 'build', '--strict', '--site-dir', str(SITE)]
    done = subprocess.run([*command, '--config-file', str(ROOT / 'mkdocs.yml')], check=False)
    if done.returncode == 0:
        print(f'{SITE / "index.html"}')
    return done.returncode


if __name__ == '__main__':
    sys.exit(main())
