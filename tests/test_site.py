# SPDX-License-Identifier: Apache-2.0
"""What `make docs` builds from: every page has its place, every public name its entry."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
PACKAGES = ('calib_model', 'selfcenter_probe', 'calib_capture', 'calib_solver')
LINK = re.compile(r'\]\((?!https?:|#)([^)#\s]+)')


@pytest.fixture(scope='module')
def settings() -> dict:
    return yaml.safe_load((ROOT / 'mkdocs.yml').read_text(encoding='utf-8'))


def pages(entries: list | str) -> list[str]:
    if isinstance(entries, str):
        return [entries]
    return [page for entry in entries for part in entry.values() for page in pages(part)]


def test_every_page_is_in_the_navigation_once(settings):
    assert sorted(pages(settings['nav'])) == sorted(path.name for path in DOCS.glob('*.md'))


def test_nothing_is_loaded_from_elsewhere(settings):
    assert settings['theme']['font'] is False
    assert 'offline' in settings['plugins']
    for script in settings['extra']['polyfills']:
        assert (DOCS / script).exists()
        assert 'iframe-worker' in script  # else the plugin asks for one of the network's
    assert 'http' not in (DOCS / script).read_text(encoding='utf-8')


def test_every_public_name_has_its_entry():
    shown = re.findall(r'^::: (\w+)\.(\w+)$', (DOCS / 'api.md').read_text(), re.MULTILINE)
    public = [
        (package, name) for package in PACKAGES for name in importlib.import_module(package).__all__
    ]
    assert sorted(shown) == sorted(public)


@pytest.mark.parametrize(
    'page', [ROOT / 'README.md', *sorted(DOCS.glob('*.md'))], ids=lambda path: path.name
)
def test_links_lead_to_files_that_are_there(page):
    for target in LINK.findall(page.read_text(encoding='utf-8')):
        assert (page.parent / target).exists(), target


def test_the_citation_and_the_site_are_of_this_version():
    cited = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert f"version = '{cited['version']}'" in (ROOT / 'pyproject.toml').read_text()
    assert cited['license'] == 'Apache-2.0'


def test_readme_s_pictures_are_small():
    pictures = re.findall(r'\]\((docs/images/\w+\.png)\)', (ROOT / 'README.md').read_text())
    assert len(pictures) == 3
    for picture in pictures:
        assert (ROOT / picture).stat().st_size < 150_000
