"""The package's files agree with each other."""

import re
from pathlib import Path
from xml.etree import ElementTree

PACKAGE = Path(__file__).resolve().parent.parent


def test_the_version_is_the_same_everywhere():
    changelog = (PACKAGE / 'CHANGELOG.rst').read_text(encoding='utf-8')
    setup = (PACKAGE / 'setup.py').read_text(encoding='utf-8')
    versions = {
        ElementTree.parse(PACKAGE / 'package.xml').getroot().findtext('version'),
        re.search(r"version='(.+)'", setup)[1],
        re.search(r'^(\d+\.\d+\.\d+) ', changelog, re.MULTILINE)[1],
    }
    assert len(versions) == 1
