# SPDX-License-Identifier: Apache-2.0
"""What a release needs: one version everywhere, a changelog, somebody to write to."""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = sorted((ROOT / 'ros2_ws' / 'src').glob('*/package.xml'))


@pytest.mark.parametrize('path', PACKAGES, ids=lambda path: path.parent.name)
def test_a_package_names_its_people_its_version_and_its_changes(path: Path) -> None:
    about = ElementTree.parse(path).getroot()
    name, number = about.findtext('name'), about.findtext('version')
    assert name == path.parent.name and about.findtext('author')
    assert about.findtext('license') == 'Apache-2.0'
    assert 'example.org' not in path.read_text()
    assert version(path.parent.name) == number, 'run: make setup'
    changes = (path.parent / 'CHANGELOG.rst').read_text()
    assert f'Changelog for package {name}' in changes and 'Forthcoming' in changes


@pytest.mark.parametrize('path', PACKAGES, ids=lambda path: path.parent.name)
def test_what_a_package_imports_of_ours_is_declared(path: Path) -> None:
    names = [other.parent.name for other in PACKAGES if other != path]
    declared = path.read_text() + (path.parent / 'setup.py').read_text()
    sources = '\n'.join(
        file.read_text() for file in (path.parent / path.parent.name).rglob('*.py')
    )
    for name in names:
        if re.search(rf'^(?:from|import) {name}\b', sources, re.MULTILINE):
            assert declared.count(name) >= 2, f'{path.parent.name} does not declare {name}'


def test_no_package_names_a_host_that_nobody_runs() -> None:
    paper = next(
        one['url']
        for one in yaml.safe_load((ROOT / 'CITATION.cff').read_text())['references']
        if 'url' in one
    )
    for path in PACKAGES:
        assert ElementTree.parse(path).find('url') is None
        addresses = re.findall(r'https?://[^\s\'"]+', (path.parent / 'setup.py').read_text())
        assert addresses == [paper]
    assert 'no `<url>`' in (ROOT / 'CONTRIBUTING.md').read_text()


def test_the_citation_is_of_this_version_and_names_the_paper() -> None:
    cited = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    numbers = {ElementTree.parse(path).getroot().findtext('version') for path in PACKAGES}
    assert numbers == {cited['version']}
    assert any('Shell-like Objects' in one['title'] for one in cited['references'])
