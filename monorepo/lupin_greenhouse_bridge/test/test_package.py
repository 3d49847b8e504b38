"""The package's files agree with each other."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

PACKAGE = Path(__file__).resolve().parent.parent


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
