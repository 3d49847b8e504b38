"""What `rosdep check` would say of our packages: every key exists, and every import is named by a key."""

import ast
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from catkin_pkg.package import parse_package
from conftest import ENVIRONMENTS, ROOT

MANIFESTS = sorted(path for tree in ENVIRONMENTS for path in ROOT.glob(f'{tree}/*/package.xml'))
# Names of modules that differ from the key that brings them.
KEYS = {'PIL': 'python3-pil', 'cv2': 'python3-opencv', 'yaml': 'python3-yaml'}
OPTIONAL = {'argcomplete'}  # read_tag works without it
# rosdep has no key: pip or apt brings them, as the documents say.
WITHOUT_KEY = {'apriltag', 'greenhouse_sim', 'pydrake'}


def dependencies(manifest: Path) -> dict[str, set[str]]:
    """Return the kinds of dependency (depend, exec_depend, ...) of each key in a package.xml."""
    found = {}
    for element in ElementTree.parse(manifest).getroot():
        if element.tag.endswith('depend'):
            found.setdefault(element.text, set()).add(element.tag)
    return found


def imported_by(folder: Path) -> dict[str, Path]:
    """Return the modules from outside of Python that the files of a folder import, each with one file."""
    found = {}
    for path in sorted(folder.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module]
            else:
                continue
            found |= {name.partition('.')[0]: path for name in names}
    own = {path.stem for path in folder.rglob('*.py')} | {folder.parent.name}
    return {
        name: path for name, path in found.items() if name not in sys.stdlib_module_names | own | WITHOUT_KEY
    }


def test_rosdep_has_each_dependency_on_each_distro():
    lines = (ROOT / 'ci/rosdep_keys.txt').read_text(encoding='utf-8').splitlines()
    own = {manifest.parent.name for manifest in MANIFESTS}
    needed = {key for manifest in MANIFESTS for key in dependencies(manifest)} - own
    assert needed == {line for line in lines if not line.startswith('#')}


@pytest.mark.parametrize('manifest', MANIFESTS, ids=lambda path: path.parent.name)
def test_each_manifest_is_valid(manifest):
    warnings = []
    parse_package(manifest, warnings=warnings)
    assert warnings == []


@pytest.mark.parametrize('manifest', MANIFESTS, ids=lambda path: path.parent.name)
def test_each_import_is_a_dependency(manifest):
    package, missing = manifest.parent, []
    for folder in ('test', package.name, 'launch'):
        for module, path in imported_by(package / folder).items():
            keys = dependencies(manifest)
            kinds = keys.get(KEYS.get(module, module)) or keys.get(f'python3-{module}', set())
            of_users = folder != 'test' and 'testing' not in path.parts and module not in OPTIONAL
            if not (kinds & {'depend', 'exec_depend'} if of_users else kinds):
                missing.append(f'{path} imports {module}')
    assert missing == []
