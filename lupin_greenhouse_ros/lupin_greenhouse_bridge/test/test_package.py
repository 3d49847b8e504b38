"""The package's files agree with each other."""

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

PACKAGE = Path(__file__).resolve().parent.parent
KEYS = {
    name: f'python3-{name}'
    for name in ('argcomplete', 'hypothesis', 'matplotlib', 'numpy', 'packaging', 'pytest', 'yaml')
}  # of rosdep, for each module with another name
NOT_IN_ROSDEP = {'greenhouse_sim'}
OPTIONAL = {'argcomplete'}  # of the shell; the fixtures of testing/ need what their users name


def keywords_of_setup():
    """Return the literal keyword arguments of the setup() call."""
    tree = ast.parse((PACKAGE / 'setup.py').read_text(encoding='utf-8'))
    (call,) = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and getattr(n.func, 'id', '') == 'setup']
    literals = {}
    for keyword in call.keywords:
        try:
            literals[keyword.arg] = ast.literal_eval(keyword.value)
        except ValueError:
            continue
    return literals


def package_xml():
    return ElementTree.parse(PACKAGE / 'package.xml').getroot()


def test_the_version_is_the_same_everywhere():
    versions = {package_xml().findtext('version'), keywords_of_setup()['version']}
    for changelog in (PACKAGE / 'CHANGELOG.rst', *PACKAGE.parent.glob('lupin*_msgs/CHANGELOG.rst')):
        versions.add(re.search(r'^(\d+\.\d+\.\d+) ', changelog.read_text(encoding='utf-8'), re.MULTILINE)[1])
    for messages in PACKAGE.parent.glob('lupin*_msgs/package.xml'):
        versions.add(ElementTree.parse(messages).getroot().findtext('version'))
    assert len(versions) == 1


def test_the_simulator_is_pinned_for_pip_and_named_for_rosdep_users():
    assert 'mdp-greenhouse>=1.0.7' in keywords_of_setup()['install_requires']
    assert 'python3-pip' in [each.text for each in package_xml().findall('exec_depend')]


def imports(file: Path) -> set[str]:
    """Return the packages that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module)
    return {name.partition('.')[0] for name in names}


@pytest.mark.parametrize(
    ('files', 'kinds', 'besides'),
    [
        (
            [*PACKAGE.glob('lupin*/**/*.py'), *PACKAGE.glob('launch/*.py')],
            ('depend', 'exec_depend'),
            OPTIONAL,
        ),
        ([*PACKAGE.glob('test/*.py')], ('depend', 'exec_depend', 'test_depend'), set()),
    ],
    ids=['package', 'test'],
)
def test_every_import_is_a_dependency(files, kinds, besides):
    declared = {depend.text for kind in kinds for depend in package_xml().iter(kind)}
    imported = {name for file in files if file.parent.name != 'testing' for name in imports(file)}
    own = {PACKAGE.name, *(file.stem for file in files)} | sys.stdlib_module_names
    assert {KEYS.get(name, name) for name in imported - own - besides - NOT_IN_ROSDEP} <= declared
