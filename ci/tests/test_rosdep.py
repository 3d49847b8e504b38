"""What `rosdep check` would say of our packages: every key exists, and every import is named by a key."""

import ast
import sys
from pathlib import Path

import pytest
import rosdep_keys
from catkin_pkg.package import parse_package

KNOWN = {
    key: set(distros)
    for key, *distros in map(str.split, (rosdep_keys.ROOT / 'ci/rosdep_keys.txt').read_text().splitlines())
}
# Names of modules that differ from the key that brings them.
KEYS = {'PIL': 'python3-pil', 'cv2': 'python3-opencv', 'yaml': 'python3-yaml'}
OPTIONAL = {'argcomplete'}  # read_tag works without it
# rosdep has no key: pip or apt brings them, as the documents say.
WITHOUT_KEY = {'apriltag', 'greenhouse_sim', 'pydrake'}


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


@pytest.mark.parametrize('key', sorted(rosdep_keys.foreign_keys()))
def test_rosdep_has_each_key_on_each_distro(key):
    assert KNOWN.get(key) == rosdep_keys.UBUNTU.keys()


@pytest.mark.parametrize('manifest', rosdep_keys.manifests(), ids=lambda path: path.parent.name)
def test_each_manifest_is_valid(manifest):
    warnings = []
    parse_package(manifest, warnings=warnings)
    assert warnings == []


@pytest.mark.parametrize('manifest', rosdep_keys.manifests(), ids=lambda path: path.parent.name)
def test_each_import_is_a_dependency(manifest):
    package = manifest.parent
    dependencies = rosdep_keys.dependencies(manifest)
    missing = []
    for folder in ('test', package.name, 'launch'):
        for module, path in imported_by(package / folder).items():
            kinds = dependencies.get(KEYS.get(module, module)) or dependencies.get(f'python3-{module}', set())
            of_users = folder != 'test' and 'testing' not in path.parts and module not in OPTIONAL
            if not (kinds & {'depend', 'exec_depend'} if of_users else kinds):
                missing.append(f'{path} imports {module}')
    assert missing == []
