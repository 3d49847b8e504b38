"""The package's files agree with each other."""

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

PACKAGE = Path(__file__).resolve().parent.parent
MANIFEST = ElementTree.parse(PACKAGE / 'package.xml').getroot()
KEYS = {
    'PIL': 'python3-pil',
    'cv2': 'python3-opencv',
    'hypothesis': 'python3-hypothesis',
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'yaml': 'python3-yaml',
}  # of rosdep, for each module with another name
WITHOUT_KEY = {'apriltag'}


def test_the_version_is_the_same_everywhere():
    changelog = (PACKAGE / 'CHANGELOG.rst').read_text(encoding='utf-8')
    setup = (PACKAGE / 'setup.py').read_text(encoding='utf-8')
    versions = {
        MANIFEST.findtext('version'),
        re.search(r"version='(.+)'", setup)[1],
        re.search(r'^(\d+\.\d+\.\d+) ', changelog, re.MULTILINE)[1],
    }
    assert len(versions) == 1


@pytest.mark.parametrize(
    ('folder', 'kinds'),
    [
        ('lupin_perception', ('depend', 'exec_depend')),
        ('test', ('depend', 'exec_depend', 'test_depend')),
    ],
)
def test_every_import_is_a_dependency(folder, kinds):
    declared = {depend.text for kind in kinds for depend in MANIFEST.iter(kind)}
    files = list((PACKAGE / folder).glob('*.py'))
    own = {'lupin_perception', *(file.stem for file in files)}
    imported = {module for file in files for module in imports(file)}
    modules = imported - own - WITHOUT_KEY - sys.stdlib_module_names
    assert {KEYS.get(module, module) for module in modules} <= declared


def imports(file: Path) -> set[str]:
    """Return the packages that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module)
    return {name.partition('.')[0] for name in names}


def test_the_messages_of_detectors_are_a_dependency():
    """Only a source of detections imports apriltag_msgs, through the bridge's package."""
    assert 'apriltag_msgs' in {depend.text for depend in MANIFEST.iter('exec_depend')}
