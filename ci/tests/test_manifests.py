"""The manifests: each package.xml as `rosdep check` reads it, and the mirror's pixi.toml with its tasks."""

import ast
import json
import os
import shutil
import sys
import sysconfig
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

import generate
import jsonschema
import pytest
from catkin_pkg.package import parse_package
from conftest import ENVIRONMENTS, ROOT, succeed

PACKAGE_XMLS = sorted(path for tree in ENVIRONMENTS for path in ROOT.glob(f'{tree}/*/package.xml'))
# Names of modules that differ from the key that brings them.
KEYS = {'PIL': 'python3-pil', 'cv2': 'python3-opencv', 'yaml': 'python3-yaml'}
OPTIONAL = {'argcomplete'}  # read_tag works without it
# rosdep has no key: pip or apt brings them, as the documents say.
WITHOUT_KEY = {'apriltag', 'greenhouse_sim', 'pydrake'}
MIRROR = ROOT / 'lupin_greenhouse_ros'
PIXI = generate.tomllib.loads((MIRROR / 'pixi.toml').read_text(encoding='utf-8'))
TOOLS = ['bash', 'cat', 'dirname', 'env', 'mkdir', 'sh', 'uname']
TOOLS += ['cc', 'c++', 'ld', 'ar', 'ranlib', 'as', 'make']


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
def test_each_manifest_is_valid(manifest):
    warnings = []
    parse_package(manifest, warnings=warnings)
    assert warnings == []


@pytest.mark.parametrize('manifest', PACKAGE_XMLS, ids=lambda path: path.parent.name)
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


def test_the_manifest_follows_the_schema_of_pixi():
    file = resources.files('validate_pyproject_schema_store') / 'resources/pixi.schema.json'
    schema = {**json.loads(file.read_text()), 'additionalProperties': False}
    jsonschema.validate(PIXI, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(PIXI | {'pypi-dependency': {}}, schema)


@pytest.fixture
def conda_prefix(tmp_path) -> Path:
    """Return an environment like one of conda: its own Python, with its headers, library, NumPy and ROS."""
    base, prefix = Path(sys.base_prefix), tmp_path / 'prefix'
    version = f'python{sys.version_info.major}.{sys.version_info.minor}'
    packages = prefix / 'lib' / version / 'site-packages'
    for folder in ('bin', 'include', f'lib/{version}/site-packages'):
        (prefix / folder).mkdir(parents=True)
    shutil.copy(base / 'bin' / version, prefix / 'bin')
    (prefix / 'bin/python3').symlink_to(version)
    (prefix / 'bin/python').symlink_to(version)
    (prefix / 'include' / version).symlink_to(base / 'include' / version)
    for library in base.glob(f'lib/lib{version}*'):
        (prefix / 'lib' / library.name).symlink_to(library)
    for module in (base / 'lib' / version).iterdir():
        if module.name.startswith('_sysconfigdata_'):  # conda writes the prefix into it
            text = module.read_text().replace(str(base), str(prefix)) if module.suffix == '.py' else ''
            (prefix / 'lib' / version / module.name).write_text(text)
        elif module.name not in ('site-packages', 'dist-packages'):
            (prefix / 'lib' / version / module.name).symlink_to(module)
    for package in Path(sysconfig.get_path('purelib')).iterdir():
        (packages / package.name).symlink_to(package)
    (packages.parent / 'dist-packages').symlink_to(packages)  # where Debian's Python looks
    (prefix / 'bin/colcon').write_text('#!/bin/sh\nexec python3 -m colcon "$@"\n')
    (prefix / 'bin/cmake').symlink_to(packages / 'cmake/data/bin/cmake')
    (prefix / 'bin/ros2').write_text(
        '#!/bin/sh\n[ "$1" = run ] && exec "${AMENT_PREFIX_PATH%%:*}/lib/$2/$3" --help\n'
    )
    for name in TOOLS:
        (prefix / 'bin' / name).symlink_to(shutil.which(name, path='/usr/bin:/bin'))
    for name in ('colcon', 'ros2'):
        (prefix / 'bin' / name).chmod(0o755)
    return prefix


@pytest.mark.heavy
@pytest.mark.skipif(
    not Path(sys.prefix, 'local_setup.bash').exists(), reason='ROS is not in this environment'
)
def test_its_tasks_build_and_run_in_an_environment_with_condas_layout(tmp_path, conda_prefix):
    """No other Python is on PATH."""
    clone = tmp_path / 'clone'
    shutil.copytree(MIRROR, clone, ignore=shutil.ignore_patterns('__pycache__', '.*'))
    environment = {
        'AMENT_PREFIX_PATH': sys.prefix,
        'CMAKE_PREFIX_PATH': sys.prefix,
        'CONDA_PREFIX': str(conda_prefix),
        'HOME': str(tmp_path),
        'LD_LIBRARY_PATH': f'{conda_prefix}/lib:{os.environ["LD_LIBRARY_PATH"]}',
        'PATH': f'{conda_prefix}/bin',
        'PIXI_ENVIRONMENT_NAME': 'default',
    }

    def run(task: str) -> str:
        return succeed('bash', '-c', task, cwd=clone, env=environment)

    assert 'Summary: 2 packages finished' in run(PIXI['tasks']['build'])
    cache = (clone / 'build/default/lupin_greenhouse_msgs/CMakeCache.txt').read_text()
    for variable in ('Python3_EXECUTABLE', 'PYTHON_EXECUTABLE'):
        assert f'{variable}:FILEPATH={conda_prefix}/bin/python3\n' in cache
    assert f'PYTHON_INCLUDE_DIR:PATH={conda_prefix}/include/' in cache
    for place in ('bin', 'include'):
        assert f'{sys.base_prefix}/{place}/python' not in cache
    assert 'usage: read_tag' in run(f'{PIXI["tasks"]["read"]} 1')
