"""The package's files agree with each other."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

from lupin_mission.settings import Settings

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


def test_launch_arguments_are_the_parameters_of_the_node():
    """Name, default, type and description."""
    tree = ast.parse((PACKAGE / 'launch/mission.launch.py').read_text(encoding='utf-8'))
    (table,) = [
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == 'ARGUMENTS'
    ]
    arguments = [
        (ast.literal_eval(name), ast.literal_eval(default), kind.id, ast.literal_eval(description))
        for name, default, kind, description in (row.elts for row in table.elts)
    ]
    parameters = [
        (
            name,
            str(field.default).lower() if field.type is bool else str(field.default),
            field.type.__name__,
            field.metadata['description'],
        )
        for name, field in Settings.__dataclass_fields__.items()
    ]
    assert arguments == parameters
