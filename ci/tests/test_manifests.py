"""The manifests: each package.xml as `rosdep check` reads it, and the mirror's pixi.toml with its tasks."""

import ast
import json
import os
import shutil
import sys
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

import generate
import jsonschema
import pytest
from catkin_pkg.package import parse_package
from checkout import ROOT, TREES, succeed

PACKAGE_XMLS = sorted(path for tree in TREES for path in ROOT.glob(f'{tree}/*/package.xml'))
# Names of modules that differ from the key that brings them.
KEYS = {'PIL': 'python3-pil', 'cv2': 'python3-opencv', 'yaml': 'python3-yaml'}
# rosdep has no key: pip or apt brings them, as the documents say.
WITHOUT_KEY = {'apriltag', 'greenhouse_sim'}
MIRROR = ROOT / 'lupin_greenhouse_ros'
PIXI = generate.tomllib.loads((MIRROR / 'pixi.toml').read_text(encoding='utf-8'))


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
    own = {manifest.parent.name for manifest in PACKAGE_XMLS}
    needed = {key for manifest in PACKAGE_XMLS for key in dependencies(manifest)} - own
    assert needed == {line for line in lines if not line.startswith('#')}


@pytest.mark.parametrize('manifest', PACKAGE_XMLS, ids=lambda path: path.parent.name)
def test_each_manifest_is_valid_and_each_import_is_a_dependency(manifest):
    package, keys, missing, warnings = manifest.parent, dependencies(manifest), [], []
    parse_package(manifest, warnings=warnings)
    for folder in ('test', package.name, 'launch'):
        for module, path in imported_by(package / folder).items():
            kinds = keys.get(KEYS.get(module, module)) or keys.get(f'python3-{module}', set())
            of_users = folder != 'test' and 'testing' not in path.parts
            if not (kinds & {'depend', 'exec_depend'} if of_users else kinds):
                missing.append(f'{path} imports {module}')
    assert (missing, warnings) == ([], [])


def test_the_manifest_follows_the_schema_of_pixi():
    file = resources.files('validate_pyproject_schema_store') / 'resources/pixi.schema.json'
    schema = {**json.loads(file.read_text()), 'additionalProperties': False}
    jsonschema.validate(PIXI, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(PIXI | {'pypi-dependency': {}}, schema)


@pytest.mark.heavy
@pytest.mark.skipif(
    not Path(sys.prefix, 'local_setup.bash').exists(), reason='ROS is not in this environment'
)
def test_its_tasks_build_and_run_in_the_environment_of_conda(tmp_path):
    """The environment of the wheels, which is called one of conda; it lacks the commands ros2 and colcon."""
    clone, commands = tmp_path / 'clone', tmp_path / 'bin'
    shutil.copytree(MIRROR, clone, ignore=shutil.ignore_patterns('__pycache__', '.*'))
    commands.mkdir()
    (commands / 'colcon').write_text('#!/bin/sh\nexec python3 -m colcon "$@"\n')
    (commands / 'ros2').write_text('#!/bin/sh\nexec "${AMENT_PREFIX_PATH%%:*}/lib/$2/$3" --help\n')
    for each in commands.iterdir():
        each.chmod(0o755)
    setup = f"""source ci/ros_env.bash without-overlay && unset VIRTUAL_ENV && cd {clone}
    export CONDA_PREFIX={sys.prefix} PIXI_ENVIRONMENT_NAME=default PATH={commands}:$PATH"""

    def run(task: str) -> str:
        return succeed('bash', '-ec', f'{setup}\n{task}', env=os.environ | {'VENV': sys.prefix})

    assert 'Summary: 2 packages finished' in run(PIXI['tasks']['build'])
    assert 'usage: read_tag' in run(f'{PIXI["tasks"]["read"]} 1')
