"""check_drift.py reports every mutation of the real trees under its heading."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import check_drift
import pytest
from conftest import edit, git

TREES = {'monorepo': 'monorepo', 'mirror': 'lupin_greenhouse_ros'}
BRIDGE = 'lupin_greenhouse_bridge'
NODE = f'{BRIDGE}/{BRIDGE}/bridge_node.py'
MESSAGES = f'{BRIDGE}/{BRIDGE}/interfaces.py'
SIMULATION = f'{BRIDGE}/{BRIDGE}/simulator/simulation.py'
LAUNCH = f'{BRIDGE}/launch/greenhouse_bridge.launch.py'
SRV, READING, SENSOR = 'MSGS/srv/GetTagReading.srv', 'MSGS/msg/TagReading.msg', 'MSGS/msg/SensorReading.msg'
WRAP, PLAIN = 'return Path(value) if value else None', 'return value or None'
IMPORT, DIRECTORY = 'from pathlib import Path\n', f'script_dir=$base/lib/{BRIDGE}'
LAST_LINE = '    return run(NODE_NAME, GreenhouseBridgeNode, args)\n'
NODE_DIFFERS, PACKAGE_DIFFERS, INTERFACE = 'bridge_node.py', 'package file', 'interface'
DIVERGENCE, LEFT_OVER, ONE_SIDE = 'allowed divergence', 'left-over name', 'only one side'
IGNORE, MODE, LINK, MISSING = 'COLCON_IGNORE', 'file mode', 'symlink', 'missing'


class Trees:
    """A clone of both trees to change."""

    def __init__(self, base):
        self.base = base

    def path(self, side, name):
        """Return a file of a tree; MSGS stands for the tree's own message package."""
        return self.base / TREES[side] / name.replace('MSGS', check_drift.MSGS[side])

    def change(self, sides, name, change):
        for side in TREES if sides == 'both' else [sides]:
            change(self.path(side, name))

    def check(self, form='text'):
        sides = [word for side, folder in TREES.items() for word in (f'--{side}', str(self.base / folder))]
        return check_drift.main([*sides, '--format', form])


@pytest.fixture(scope='module')
def shared_trees(packed_repositories, tmp_path_factory):
    base = tmp_path_factory.mktemp('trees') / 'repository'
    return Trees(shutil.copytree(packed_repositories / 'repository', base, symlinks=True))


@pytest.fixture
def trees(shared_trees):
    yield shared_trees
    shutil.rmtree(shared_trees.path('mirror', '.git'), ignore_errors=True)
    shared_trees.path('mirror', '.git').unlink(missing_ok=True)  # it can be a file
    git(shared_trees.base, 'clean', '--quiet', '-ffdx')
    git(shared_trees.base, 'reset', '--quiet', '--hard')


# heading, sides, file, old text, new text
EDITS = [
    # bridge_node.py, beyond the one line
    (NODE_DIFFERS, 'mirror', NODE, 'LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 6.0'),
    (NODE_DIFFERS, 'monorepo', NODE, IMPORT, ''),
    # the one line: missing, doubled, moved, swapped
    (DIVERGENCE, 'mirror', NODE, f'    {PLAIN}\n', f'    {WRAP}\n'),
    (DIVERGENCE, 'monorepo', NODE, f'    {WRAP}\n', f'    {PLAIN}\n'),
    (DIVERGENCE, 'mirror', NODE, f'    {PLAIN}\n', ''),
    (DIVERGENCE, 'mirror', NODE, f'    {PLAIN}\n', f'    {PLAIN}\n    {PLAIN}\n'),
    (DIVERGENCE, 'both', NODE, 'def _config_path(', 'def _other(value):\n    pass\n\n\ndef _moved('),
    (DIVERGENCE, 'mirror', NODE, f'    {PLAIN}\n', f'    {PLAIN}  # text\n'),
    (DIVERGENCE, 'both', NODE, '    """Turn a path', '    value = value.strip()\n    """Turn a path'),
    # messages and services: text and meaning
    (INTERFACE, 'mirror', SENSOR, 'float64 value', 'float32 value'),
    (INTERFACE, 'mirror', SRV, 'uint8 STATUS_UNKNOWN_TAG=1', 'uint8 STATUS_UNKNOWN_TAG=2'),
    (INTERFACE, 'mirror', SRV, '# What is the climate', '# What is the weather'),
    # the rest of both packages
    (PACKAGE_DIFFERS, 'mirror', LAUNCH, "name='greenhouse_bridge'", "name='bridge'"),
    (PACKAGE_DIFFERS, 'monorepo', f'{BRIDGE}/setup.py', "version='2.", "version='3."),
    (PACKAGE_DIFFERS, 'mirror', f'{BRIDGE}/setup.cfg', f'[develop]\n{DIRECTORY}', f'{DIRECTORY}\n[develop]'),
    # the other tree's name
    (LEFT_OVER, 'mirror', MESSAGES, 'from lupin_greenhouse_msgs.msg', 'from lupin_msgs.msg'),
    (LEFT_OVER, 'monorepo', MESSAGES, 'from lupin_msgs.msg', 'from lupin_greenhouse_msgs.msg'),
    (LEFT_OVER, 'monorepo', SIMULATION, 'import math\n', 'import math  # not LUPIN_GREENHOUSE_MSGS\n'),
    (LEFT_OVER, 'mirror', 'README.md', '# lupin_greenhouse_ros', '# lupin-msgs'),
    (LEFT_OVER, 'mirror', 'MSGS/package.xml', '<name>lupin_greenhouse_msgs', '<name>lupin_msgs'),
    # invisible differences
    (NODE_DIFFERS, 'mirror', NODE, IMPORT, 'from pathlib import Path\r\n'),
    (PACKAGE_DIFFERS, 'mirror', SIMULATION, '"""Load, v', '\ufeff"""Load, v'),
    (INTERFACE, 'mirror', SENSOR, 'float64 value', 'float64 v\u0430lue'),
    (NODE_DIFFERS, 'monorepo', NODE, LAST_LINE, LAST_LINE.rstrip()),
    (PACKAGE_DIFFERS, 'monorepo', f'{BRIDGE}/setup.cfg', 'lupin_greenhouse_bridge\n', 'lupin_greenhouse_bridge  \n'),
]  # fmt: skip


def replaced(old, new):
    return lambda path: edit(path, old, new)


def added(content=''):
    """Add a file, or text at the end of it."""
    return replaced('', content)


def move_line(path):
    """Move the right line into another function."""
    line = WRAP if 'monorepo' in path.parts else PLAIN
    edit(path, f'    {line}\n', '    return _elsewhere(value)\n')
    edit(path, 'def main(', f'def _elsewhere(value):\n    {line}\n\n\ndef main(')


def linked(target):
    """Put a symlink in place of a file or folder."""

    def change(path):
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        path.symlink_to(target)

    return change


def track(path):
    """Add a file to a clone, where git knows it."""
    edit(path, '', '')
    git(path.parent, 'add', '--force', str(path))


def executable(path):
    path.chmod(0o755)


NEW, GONE = added(), Path.unlink
# heading, name of the test, sides, file, change
CHANGES = [
    (DIVERGENCE, 'the line moved in both', 'both', NODE, move_line),
    (ONE_SIDE, 'a new file in the mirror', 'mirror', f'{BRIDGE}/{BRIDGE}/extra.py', NEW),
    (ONE_SIDE, 'a new file in the monorepo', 'monorepo', f'{BRIDGE}/test/test_extra.py', NEW),
    (ONE_SIDE, 'an unlisted repository file', 'mirror', 'NOTES.md', NEW),
    (ONE_SIDE, 'a file named like build output', 'mirror', f'{BRIDGE}/log', NEW),
    (ONE_SIDE, 'a module named like build output', 'mirror', f'{BRIDGE}/{BRIDGE}/build/__init__.py', NEW),
    (ONE_SIDE, 'a deleted service', 'monorepo', SRV, GONE),
    (LEFT_OVER, 'a file named after the old package', 'mirror', f'{BRIDGE}/test/lupin_msgs.txt', NEW),
    (LEFT_OVER, 'the old package beside the new', 'mirror', 'lupin_msgs/msg/SensorReading.msg', added('bool a\n')),
    (MISSING, 'a file kept by hand', 'mirror', 'README.md', GONE),
    (MISSING, 'a file of the messages kept by hand', 'mirror', 'MSGS/CHANGELOG.rst', GONE),
    (IGNORE, 'COLCON_IGNORE not empty', 'mirror', 'COLCON_IGNORE', added('\n')),
    (IGNORE, 'COLCON_IGNORE in the monorepo', 'monorepo', 'COLCON_IGNORE', NEW),
    (IGNORE, 'COLCON_IGNORE in a package', 'mirror', f'{BRIDGE}/COLCON_IGNORE', NEW),
    (IGNORE, 'AMENT_IGNORE in both packages', 'both', f'{BRIDGE}/AMENT_IGNORE', NEW),
    (IGNORE, 'CATKIN_IGNORE in the messages', 'monorepo', 'MSGS/CATKIN_IGNORE', NEW),
    (MODE, 'executable in the mirror', 'mirror', NODE, executable),
    (MODE, 'executable in the monorepo', 'monorepo', READING, executable),
    (LINK, 'a symlink out of the tree', 'mirror', SIMULATION, linked('/etc/hostname')),
    (LINK, 'a package that is a symlink', 'monorepo', BRIDGE, linked(f'../{TREES["mirror"]}/{BRIDGE}')),
    (LINK, 'a folder of messages that is a symlink', 'monorepo', 'MSGS/msg', linked('/')),
    (LINK, 'a folder of a package that is a symlink', 'mirror', f'{BRIDGE}/doc', linked('/')),
    *((ONE_SIDE, f'{name} that git tracks', 'mirror', name, track) for name in (f'{BRIDGE}/build/a.py', 'MSGS/log/a', '.vscode/a', 'a~')),
    (PACKAGE_DIFFERS, 'a binary resource marker', 'mirror', f'{BRIDGE}/resource/{BRIDGE}', lambda path: path.write_bytes(b'\xff')),
]  # fmt: skip
MUTANTS = [
    *((heading, f'{sides}, {name}: {new!r}', sides, name, replaced(old, new)) for heading, sides, name, old, new in EDITS),
    *CHANGES,
]  # fmt: skip


@pytest.mark.parametrize(
    ('heading', 'sides', 'name', 'change'), [pytest.param(h, *how, id=test) for h, test, *how in MUTANTS]
)
def test_mutant(trees, heading, sides, name, change, capsys):
    trees.change(sides, name, change)
    assert trees.check() == 1
    findings = re.findall(r'^/.+?:([1-9]\d*): \[(.+?)\] (?=\S)', capsys.readouterr().out, re.MULTILINE)
    assert heading in [found for _, found in findings]


# What tools leave in a clone of the mirror, or in a folder of it.
LEFT_BY_TOOLS = [
    '.DS_Store', '.hypothesis/x', '.idea/x', '.mypy_cache/x', '.pixi/x', '.pytest_cache/x', '.ruff_cache/x',
    '.venv/x', '.vscode/x', '__pycache__/x.pyc', 'build/lupin_msgs/x', f'{BRIDGE}.egg-info/x', 'install/x', 'log/x',
    'pixi.lock', 'x.py.swp', 'x.py~', 'x.pyc',
]  # fmt: skip
HARMLESS = [
    ('nothing', 'mirror', '.', lambda _path: None),
    ('the git folder of a clone', 'mirror', '.git/config', added('lupin_msgs')),
    ('the git file of a submodule', 'mirror', '.git', added('gitdir: lupin_msgs')),
    *((name, 'mirror', name, added('lupin_msgs')) for name in LEFT_BY_TOOLS),
    *((f'{name} in a package', 'monorepo', f'{BRIDGE}/{name}', added('x')) for name in LEFT_BY_TOOLS),
    ('another interface of the team', 'monorepo', 'MSGS/msg/Extra.msg', added('bool extra\n')),
    ('a file kept by hand', 'both', 'MSGS/package.xml', added('<!-- x -->')),
    ('another package of the monorepo', 'monorepo', 'lupin_mission/package.xml', added('x')),
    ('the same edit in both', 'both', NODE, replaced('LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 9.0')),
    ('the same new file in both', 'both', f'{BRIDGE}/test/test_new.py', added('import lupin\n')),
    ('the mode of a folder', 'mirror', f'{BRIDGE}/test', lambda path: path.chmod(0o700)),
]


@pytest.mark.parametrize(
    ('sides', 'name', 'change'), [pytest.param(*how, id=test) for test, *how in HARMLESS]
)
def test_harmless(trees, sides, name, change, capsys):
    trees.change(sides, name, change)
    assert trees.check() == 0
    assert 'only the allowed divergence' in capsys.readouterr().out


def test_git_ignores_in_the_mirror_what_tools_leave_there(trees):
    mirror = trees.path('mirror', '.')
    git(mirror, 'init', '--quiet')
    names = [*LEFT_BY_TOOLS, *(f'{BRIDGE}/{name}' for name in LEFT_BY_TOOLS)]
    assert git(mirror, 'check-ignore', '--no-index', *names).splitlines() == names


@pytest.mark.parametrize(
    ('side', 'name', 'change', 'reason'),
    [
        ('mirror', '.', shutil.rmtree, 'ros: has no lupin_greenhouse_msgs'),
        ('monorepo', 'MSGS', shutil.rmtree, 'has no lupin_msgs: is it the monorepo?'),
        ('mirror', NODE, GONE, 'bridge_node.py: is it the mirror?'),
    ],
)  # fmt: skip
def test_trees_that_cannot_be_compared_are_exit_code_2(trees, side, name, change, reason, capsys):
    trees.change(side, name, change)
    assert trees.check() == 2
    output = capsys.readouterr()
    assert output.out == ''
    (line,) = output.err.splitlines()
    assert reason in line


def test_text_has_place_message_remedy_and_a_diff_of_what_is_invisible(trees, capsys):
    number = trees.path('mirror', NODE).read_text().splitlines(keepends=True).index(IMPORT) + 1
    edit(trees.path('mirror', NODE), IMPORT, 'from\tpathlib import P\u0430th  # \u200b \r\n')
    assert trees.check() == 1
    place, *rest = capsys.readouterr().out.splitlines()
    assert place.endswith(f'/bridge_node.py:{number}: [bridge_node.py] differs beyond the rename')
    assert r"+'from\tpathlib import P\u0430th  # \u200b \r\n'" in rest
    assert 'make generate' in rest[-3]
    assert 'tools/twins.toml' in rest[-2]
    assert re.fullmatch(r'1 finding in \d+ files compared\.', rest[-5])


def test_github_gets_one_annotation_per_finding_on_one_line(trees, capsys):
    edit(trees.path('mirror', LAUNCH), "output='screen'", "output='100%'")
    assert trees.check('github') == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert re.match(r'::error file=.*launch\.py,line=\d+,title=drift%3A package file::differs', line)
    assert '100%25' in line
    assert '%0A' in line


def test_it_runs_alone_on_any_two_checkouts(repository):
    """With the standard library only, from any folder, without git and the rest of this repository."""
    shutil.rmtree(repository / '.git')
    edit(repository / 'lupin_greenhouse_ros/build/x', '', '')
    shutil.copy(check_drift.__file__, repository)
    sides = ['--monorepo', 'monorepo', '--mirror', 'lupin_greenhouse_ros']
    command = [sys.executable, '-I', '-S', 'check_drift.py', *sides]
    result = subprocess.run(command, cwd=repository, env={}, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, '')
    assert result.stdout.endswith(' compared: only the allowed divergence\n')


def test_an_unreadable_file_is_exit_code_2(trees, monkeypatch, capsys):
    monkeypatch.setattr(Path, 'read_bytes', lambda path: path.with_name('missing').open())
    assert trees.check() == 2
    assert 'No such file' in capsys.readouterr().err
