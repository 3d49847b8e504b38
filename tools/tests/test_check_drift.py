"""check_drift.py reports every mutation of the real trees under its heading."""

import re
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

import check_drift
import pytest
from clones import edit, git

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

    def check(self):
        sides = [word for side, folder in TREES.items() for word in (f'--{side}', str(self.base / folder))]
        return check_drift.main(sides)


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


def replaced(old, new):
    return lambda path: edit(path, old, new)


def added(content=''):
    """Add a file, or text at the end of it."""
    return replaced('', content)


def in_a_text(line):
    """Put the one line into a text, below the function's head, and let the function return something else."""
    start = 'def _config_path(value: str) -> Path | str | None:\n'

    def change(path):
        edit(path, f'    {line}\n', '    return str(value)\n')
        edit(path, '', f'\n\nTEXT = """\n{start}    {line}\n"""\n')

    return change


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


NEW, GONE = added(), Path.unlink
DOCSTRING = '    """\n    Turn a path'  # of _config_path
# heading, sides, file, change
MUTANTS = [
    # bridge_node.py, beyond the one line
    (NODE_DIFFERS, 'mirror', NODE, replaced('LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 6.0')),
    # the one line: missing, doubled, moved, swapped
    (DIVERGENCE, 'mirror', NODE, replaced(f'    {PLAIN}\n', f'    {WRAP}\n')),
    (DIVERGENCE, 'monorepo', NODE, replaced(f'    {WRAP}\n', f'    {PLAIN}\n')),
    (DIVERGENCE, 'mirror', NODE, replaced(f'    {PLAIN}\n', '')),
    (DIVERGENCE, 'mirror', NODE, replaced(f'    {PLAIN}\n', f'    {PLAIN}\n    {PLAIN}\n')),
    (DIVERGENCE, 'both', NODE, replaced('def _config_path(', 'def _config_path(value):\n    pass\n\n\ndef _moved(')),
    (DIVERGENCE, 'mirror', NODE, replaced(f'    {PLAIN}\n', f'    {PLAIN}  # text\n')),
    (DIVERGENCE, 'both', NODE, replaced(DOCSTRING, f'    value = value.strip()\n{DOCSTRING}')),
    (DIVERGENCE, 'both', NODE, replaced(DOCSTRING, f'    value = 1\n{DOCSTRING}')),
    (DIVERGENCE, 'both', NODE, replaced('def _config_path(', '@str\ndef _config_path(')),
    (DIVERGENCE, 'both', NODE, added('\n\n_config_path = str\n')),
    (DIVERGENCE, 'both', NODE, added('\n\nfrom builtins import str as _config_path\n')),
    (DIVERGENCE, 'both', NODE, added('\n\ndef _config_path (value):\n    return value\n')),
    (DIVERGENCE, 'both', NODE, added('\n\ndef _con\ufb01g_path(value):\n    return value\n')),
    (DIVERGENCE, 'both', NODE, added("\n\nsetattr(sys.modules[__name__], '_config_path', str)\n")),
    (DIVERGENCE, 'monorepo', NODE, in_a_text(WRAP)),
    (DIVERGENCE, 'mirror', NODE, in_a_text(PLAIN)),
    # messages and services: text and meaning
    (INTERFACE, 'mirror', SENSOR, replaced('float64 value', 'float32 value')),
    (INTERFACE, 'mirror', SRV, replaced('# What is the climate', '# What is the weather')),
    # the rest of both packages
    (PACKAGE_DIFFERS, 'mirror', LAUNCH, replaced("name='greenhouse_bridge'", "name='bridge'")),
    (PACKAGE_DIFFERS, 'mirror', f'{BRIDGE}/setup.cfg', replaced(f'[develop]\n{DIRECTORY}', f'{DIRECTORY}\n[develop]')),
    # the other tree's name
    (LEFT_OVER, 'mirror', MESSAGES, replaced('from lupin_greenhouse_msgs.msg', 'from lupin_msgs.msg')),
    (LEFT_OVER, 'monorepo', MESSAGES, replaced('from lupin_msgs.msg', 'from lupin_greenhouse_msgs.msg')),
    (LEFT_OVER, 'monorepo', SIMULATION, replaced('import math\n', 'import math  # not LUPIN_GREENHOUSE_MSGS\n')),
    (LEFT_OVER, 'mirror', 'README.md', replaced('# lupin_greenhouse_ros', '# lupin-msgs')),
    # invisible differences
    (NODE_DIFFERS, 'mirror', NODE, replaced(IMPORT, 'from pathlib import Path\r\n')),
    (PACKAGE_DIFFERS, 'mirror', SIMULATION, replaced('"""Load, v', '\ufeff"""Load, v')),
    (INTERFACE, 'mirror', SENSOR, replaced('float64 value', 'float64 v\u0430lue')),
    (NODE_DIFFERS, 'monorepo', NODE, replaced(LAST_LINE, LAST_LINE.rstrip())),
    (PACKAGE_DIFFERS, 'monorepo', f'{BRIDGE}/setup.cfg', replaced('lupin_greenhouse_bridge\n', 'lupin_greenhouse_bridge  \n')),
    # added, deleted, and what is no text
    (DIVERGENCE, 'both', NODE, added('\n\ndef _config_path(value):\n    return value\n')),
    (ONE_SIDE, 'mirror', f'{BRIDGE}/{BRIDGE}/extra.py', NEW),
    (ONE_SIDE, 'monorepo', f'{BRIDGE}/test/test_extra.py', NEW),
    (ONE_SIDE, 'mirror', 'NOTES.md', NEW),
    (ONE_SIDE, 'mirror', f'{BRIDGE}/log', NEW),  # like the folder of a build
    (ONE_SIDE, 'mirror', f'{BRIDGE}/{BRIDGE}/build/__init__.py', NEW),
    *((ONE_SIDE, 'mirror', name, track) for name in (f'{BRIDGE}/build/a.py', 'MSGS/log/a', '.vscode/a', 'a~')),
    (ONE_SIDE, 'monorepo', SRV, GONE),
    (LEFT_OVER, 'mirror', f'{BRIDGE}/test/lupin_msgs.txt', NEW),
    (LEFT_OVER, 'mirror', 'lupin_msgs/msg/SensorReading.msg', added('bool a\n')),
    (MISSING, 'mirror', 'README.md', GONE),
    (MISSING, 'mirror', 'MSGS/CHANGELOG.rst', GONE),
    (IGNORE, 'mirror', 'COLCON_IGNORE', added('\n')),
    (IGNORE, 'monorepo', 'COLCON_IGNORE', NEW),
    (IGNORE, 'mirror', f'{BRIDGE}/COLCON_IGNORE', NEW),
    (IGNORE, 'both', f'{BRIDGE}/AMENT_IGNORE', NEW),
    (IGNORE, 'monorepo', 'MSGS/CATKIN_IGNORE', NEW),
    (MODE, 'mirror', NODE, lambda path: path.chmod(0o755)),
    (MODE, 'monorepo', READING, lambda path: path.chmod(0o755)),
    (PACKAGE_DIFFERS, 'mirror', f'{BRIDGE}/resource/{BRIDGE}', lambda path: path.write_bytes(b'\xff')),
    (LINK, 'mirror', SIMULATION, linked('/etc/hostname')),
    (LINK, 'monorepo', BRIDGE, linked(f'../{TREES["mirror"]}/{BRIDGE}')),
    (LINK, 'monorepo', 'MSGS/msg', linked('/')),
]  # fmt: skip


# They can be made at once: one for each file, and the symlinks, below which is nothing to compare, apart.
BATCHES, seen = defaultdict(list), Counter()
for mutant in MUTANTS:
    place = mutant[2].replace('MSGS', 'lupin_msgs')
    seen[place] += mutant[0] != LINK
    BATCHES['symlinks' if mutant[0] == LINK else str(seen[place])].append(mutant)


@pytest.mark.parametrize('mutants', BATCHES.values(), ids=BATCHES)
def test_each_mutant_is_found_under_its_heading(trees, mutants, capsys):
    for _, sides, name, change in mutants:
        trees.change(sides, name, change)
    assert trees.check() == 1
    found = re.findall(r'^(/.+?):[1-9]\d*: \[(.+?)\] (?=\S)', capsys.readouterr().out, re.MULTILINE)
    for heading, sides, name, _ in mutants:
        assert any((str(trees.path(side, name)), heading) in found for side in TREES), (heading, sides, name)


def test_a_symlink_does_not_hide_the_rest(trees, capsys):
    trees.change('mirror', f'{BRIDGE}/more.md', linked('nowhere'))
    trees.change('mirror', NODE, replaced('LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 6.0'))
    assert trees.check() == 1
    assert re.findall(r'\[(symlink|bridge_node.py)\]', capsys.readouterr().out) == [LINK, NODE_DIFFERS]


# What tools leave in a clone of the mirror, or in a folder of it.
LEFT_BY_TOOLS = [
    '.#x.py', '.DS_Store', '.hypothesis/x', '.idea/x', '.mypy_cache/x', '.pixi/x', '.pytest_cache/x', '.ruff_cache/x',
    '.venv/x', '.vscode/x', '__pycache__/x.pyc', 'build/lupin_msgs/x', f'{BRIDGE}.egg-info/x', 'install/x', 'log/x',
    'pixi.lock', 'x.py.swp', 'x.py~', 'x.pyc',
]  # fmt: skip
HARMLESS = [
    *(('mirror', name, added('lupin_msgs')) for name in LEFT_BY_TOOLS),
    *(('monorepo', f'{BRIDGE}/{name}', added('x')) for name in LEFT_BY_TOOLS),
    ('mirror', f'{BRIDGE}/{BRIDGE}/.#bridge_node.py', linked('somebody@somewhere.1234')),  # an editor's lock
    ('monorepo', 'MSGS/msg/Extra.msg', added('bool extra\n')),  # of the team
    ('both', 'MSGS/package.xml', added('<!-- x -->')),
    ('monorepo', 'lupin_mission/package.xml', added('x')),
    ('both', NODE, replaced('LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 9.0')),
    ('both', f'{BRIDGE}/test/test_new.py', added('import lupin\n')),
    ('mirror', f'{BRIDGE}/test', lambda path: path.chmod(0o700)),
]


@pytest.mark.parametrize(
    'changes',
    [HARMLESS, [('mirror', '.git/config', added('lupin_msgs'))], [('mirror', '.git', added('gitdir: lupin_msgs'))]],
    ids=['files', 'the git folder of a clone', 'the git file of a submodule'],
)  # fmt: skip
def test_what_is_harmless_is_no_finding(trees, changes, capsys):
    for sides, name, change in changes:
        trees.change(sides, name, change)
    code, printed = trees.check(), capsys.readouterr().out
    assert (code, 'only the allowed divergence' in printed) == (0, True), printed


def test_git_ignores_in_the_mirror_what_tools_leave_there(trees):
    mirror = trees.path('mirror', '.')
    git(mirror, 'init', '--quiet')
    names = [*LEFT_BY_TOOLS, *(f'{BRIDGE}/{name}' for name in LEFT_BY_TOOLS)]
    assert git(mirror, 'check-ignore', '--no-index', *names).splitlines() == names


@pytest.mark.parametrize(
    ('side', 'name', 'change', 'reason'),
    [
        ('monorepo', 'MSGS', shutil.rmtree, 'has no lupin_msgs: is it the monorepo?'),
        ('mirror', NODE, GONE, 'bridge_node.py: is it the mirror?'),
    ],
)  # fmt: skip
def test_trees_that_cannot_be_compared_are_exit_code_2(trees, side, name, change, reason, capsys):
    trees.change(side, name, change)
    assert trees.check() == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count('\n'), reason in printed.err) == ('', 1, True)


def test_text_has_place_message_remedy_and_a_diff_of_what_is_invisible(trees, capsys):
    number = trees.path('mirror', NODE).read_text().splitlines(keepends=True).index(IMPORT) + 1
    edit(trees.path('mirror', NODE), IMPORT, 'from\tpathlib import P\u0430th  # \u200b \r\n')
    assert trees.check() == 1
    place, *rest = capsys.readouterr().out.splitlines()
    assert place.endswith(f'/bridge_node.py:{number}: [bridge_node.py] differs beyond the rename')
    assert r"+'from\tpathlib import P\u0430th  # \u200b \r\n'" in rest
    assert re.fullmatch(r'1 finding in \d+ files compared\.', rest[-5])
    assert rest[-4:] == check_drift.WHAT_TO_DO.splitlines()


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


def test_a_clone_whose_files_git_does_not_list_is_exit_code_2(trees, monkeypatch, capsys):
    monkeypatch.setenv('GIT_TEST_ASSUME_DIFFERENT_OWNER', 'true')  # as in a container of the CI
    assert trees.check() == 2
    assert 'dubious ownership' in capsys.readouterr().err


def test_an_unreadable_file_is_exit_code_2(trees, monkeypatch, capsys):
    monkeypatch.setattr(Path, 'read_bytes', lambda path: path.with_name('missing').open())
    assert trees.check() == 2
    assert 'No such file' in capsys.readouterr().err
