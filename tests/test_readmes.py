# SPDX-License-Identifier: Apache-2.0
"""What the READMEs say is what the code declares."""

from __future__ import annotations

import re
import subprocess
from functools import cache
from pathlib import Path

import pytest
from docs.parameter_tables import PACKAGES, readme, renewed, table
from tests.executables import EXECUTABLES, executable

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / 'README.md', *(ROOT / 'docs').glob('*.md'), *ROOT.glob('ros2_ws/src/*/README.md')]


@pytest.mark.parametrize('package', PACKAGES)
def test_a_readme_lists_the_declared_parameters(package: str) -> None:
    text = readme(package).read_text()
    assert renewed(text, table(package)) == text, 'run: make tables'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_to_files_lead_somewhere(page: Path) -> None:
    links = re.findall(r'\]\(([^)#:]+)(?:#[^)]*)?\)', page.read_text())
    assert [link for link in links if not (page.parent / link).exists()] == []


COMMANDS = tuple(name for names in EXECUTABLES.values() for name in names)
# What a command gets: up to the end of its code span, of its line, or of what a shell joins.
CALL = re.compile(
    rf'(?:^ *|`|run \w+ |\| |&& )({"|".join(COMMANDS)})((?: (?:[^`\n|&#\\]|\\\n)*)+)', re.MULTILINE
)


def calls(page: Path) -> list[tuple[str, str]]:
    """Command and arguments of every call that a page shows."""
    text = re.sub(r'(`[^`\n]*)\n([^`\n]*`)', r'\1 \2', page.read_text())
    found = CALL.finditer(text)
    return [(one[1], ' '.join(one[2].replace('\\', ' ').split())) for one in found]


@cache
def usage(command: str) -> str:
    """What the command itself says of its options and parameters."""
    asked = subprocess.run(
        [executable(command), '--help'],
        capture_output=True,
        text=True,
        check=True,
    )
    return asked.stdout


CALLS = sorted({call for page in PAGES for call in calls(page)})


def test_the_pages_show_calls_of_most_commands() -> None:
    assert len({command for command, _ in CALLS}) >= len(COMMANDS) - 4, CALLS


@pytest.mark.parametrize(('command', 'arguments'), CALLS, ids=[' '.join(call) for call in CALLS])
def test_a_shown_call_uses_options_and_parameters_that_the_command_has(
    command: str, arguments: str
) -> None:
    own, _, ros = arguments.partition('--ros-args')
    for option in re.findall(r'(?<![\w-])(--[a-z][a-z-]*)', own):
        known = option == '--help' or re.search(rf'{option}\b', usage(command))
        assert known, f'{command} has no {option}'
    for name in re.findall(r'-p (\w+):=', ros):
        assert re.search(rf'\b{name}\b', usage(command)), f'{command} has no parameter {name}'
