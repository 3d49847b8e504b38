"""The files of the monorepo's packages agree with each other; this package depends on the other two."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

MONOREPO = Path(__file__).resolve().parents[2]
PACKAGES = ('lupin_mission', 'lupin_simulation', 'lupin_tag_confirmation')


@pytest.mark.parametrize('package', PACKAGES)
def test_the_version_is_the_same_everywhere(package):
    folder = MONOREPO / package
    changelog = (folder / 'CHANGELOG.rst').read_text(encoding='utf-8')
    setup = (folder / 'setup.py').read_text(encoding='utf-8')
    versions = {
        ElementTree.parse(folder / 'package.xml').getroot().findtext('version'),
        re.search(r"version='(.+)'", setup)[1],
        re.search(r'^(\d+\.\d+\.\d+) ', changelog, re.MULTILINE)[1],
    }
    assert len(versions) == 1


@pytest.mark.parametrize('package', ['lupin_mission', 'lupin_tag_confirmation'])
def test_no_file_imports_another_package_of_the_monorepo_but_the_bridge_s(package):
    others = '|'.join(each for each in PACKAGES if each != package)
    imports = re.compile(rf'^ *(?:from|import) ({others})\b', re.MULTILINE)
    folders = (MONOREPO / package / each for each in (package, 'launch', 'test'))
    files = [file for folder in folders for file in folder.glob('*.py')]
    assert len(files) > 10
    assert [file.name for file in files if imports.search(file.read_text(encoding='utf-8'))] == []
