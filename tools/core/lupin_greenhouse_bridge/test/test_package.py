"""The package's files agree with each other."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

PACKAGE = Path(__file__).resolve().parent.parent
MODULES = PACKAGE / 'lupin_greenhouse_bridge'
# The rows of the table of folders in tools/core/README.md of the monorepo.
ROWS = (
    ('errors', 'units'),
    ('runtime',),
    ('settings', 'interfaces', 'contract'),
    ('simulator',),
    ('bridge_node',),
    ('reading',),
    ('testing',),
)
SETUP = (PACKAGE / 'setup.py').read_text(encoding='utf-8')


def package_xml():
    return ElementTree.parse(PACKAGE / 'package.xml').getroot()


def test_the_version_is_the_same_everywhere():
    versions = {package_xml().findtext('version'), re.search("version='(.*?)'", SETUP)[1]}
    for changelog in (PACKAGE / 'CHANGELOG.rst', *PACKAGE.parent.glob('lupin*_msgs/CHANGELOG.rst')):
        versions.add(re.search(r'^(\d+\.\d+\.\d+) ', changelog.read_text(encoding='utf-8'), re.MULTILINE)[1])
    for messages in PACKAGE.parent.glob('lupin*_msgs/package.xml'):
        versions.add(ElementTree.parse(messages).getroot().findtext('version'))
    assert len(versions) == 1


def test_the_simulator_is_pinned_for_pip_and_named_for_rosdep_users():
    assert "'mdp-greenhouse>=1.0.7'" in SETUP
    assert 'python3-pip' in [each.text for each in package_xml().findall('exec_depend')]


def imports(file: Path) -> set[str]:
    """Return the modules that a file imports, and what it imports from them, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
    return names


def test_every_room_has_its_row():
    named = {name for row in ROWS for name in row} | {'__init__'}
    paths = [file.relative_to(MODULES).parts[0] for file in MODULES.rglob('*.py')]
    assert {path.removesuffix('.py') for path in paths} == named


@pytest.mark.parametrize('row', ROWS, ids=' '.join)
def test_a_module_imports_only_from_its_row_and_those_above_it(row):
    above = set().union(*ROWS[: ROWS.index(row) + 1])
    files = [file for name in row for file in (*MODULES.glob(f'{name}.py'), *MODULES.glob(f'{name}/*.py'))]
    room = re.compile(r'\blupin_greenhouse_bridge\.(\w+)')
    found = {file.name: {*room.findall(' '.join(imports(file)))} - above for file in files}
    assert not {name: rooms for name, rooms in found.items() if rooms}


def test_one_module_imports_what_rclpy_keeps_for_itself():
    private = re.compile(r'rclpy\.(impl|event_handler|qos_event)\b|rclpy\.(\w+\.)*_')
    files = [file.name for file in MODULES.glob('**/*.py') if any(map(private.match, imports(file)))]
    assert files == ['rclpy_internals.py']
