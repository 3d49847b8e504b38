"""The package's files agree with each other."""

import re
from pathlib import Path
from xml.etree import ElementTree

PACKAGE = Path(__file__).resolve().parent.parent
MANIFEST = ElementTree.parse(PACKAGE / 'package.xml').getroot()


def test_the_version_is_the_same_everywhere():
    changelog = (PACKAGE / 'CHANGELOG.rst').read_text(encoding='utf-8')
    setup = (PACKAGE / 'setup.py').read_text(encoding='utf-8')
    versions = {
        MANIFEST.findtext('version'),
        re.search(r"version='(.+)'", setup)[1],
        re.search(r'^(\d+\.\d+\.\d+) ', changelog, re.MULTILINE)[1],
    }
    assert len(versions) == 1


def test_the_messages_of_detectors_are_a_dependency():
    """Only a source of detections imports apriltag_msgs, through the bridge's package."""
    assert 'apriltag_msgs' in {depend.text for depend in MANIFEST.iter('exec_depend')}


def test_no_file_imports_another_package_of_the_monorepo_but_the_bridge_s():
    others = re.compile(r'^ *(?:from|import) (lupin_mission|lupin_simulation)\b', re.MULTILINE)
    files = [file for folder in (PACKAGE.name, 'launch', 'test') for file in (PACKAGE / folder).glob('*.py')]
    assert {file.name for file in files if others.search(file.read_text(encoding='utf-8'))} == set()
