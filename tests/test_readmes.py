# SPDX-License-Identifier: Apache-2.0
"""What the READMEs say is what the code declares."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from docs.parameter_tables import PACKAGES, readme, renewed, table

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
