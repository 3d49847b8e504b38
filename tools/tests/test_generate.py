"""generate.py writes both trees from the core, refuses to overwrite an edit, and reports every difference."""

import ast
import shutil

import generate
import pytest
from clones import commit, edit, git, snapshot

TREES = ('monorepo', 'lupin_greenhouse_ros')
PACKAGE = 'lupin_greenhouse_bridge'
BRIDGE = f'{PACKAGE}/{PACKAGE}'
CORE_BRIDGE = f'tools/core/{BRIDGE}'
OURS, THEIRS = (f'{tree}/{PACKAGE}' for tree in TREES)
UNITS = f'{CORE_BRIDGE}/units.py'
SETTINGS = f'{CORE_BRIDGE}/settings.py'
TABLE = 'tools/twins.toml'
README = 'lupin_greenhouse_ros/README.md'  # kept by hand, but for the address of the mirror
DIVERGENT = '    return Path(value) if value else None\n'


def run(repository, *arguments):
    return generate.main([*arguments, '--root', str(repository)])


def refusal(repository, capsys, *arguments):
    """Return the message of generate.py, which has written nothing."""
    before = snapshot(repository)
    assert run(repository, *arguments) == 2
    assert snapshot(repository) == before
    error = capsys.readouterr().err
    assert error.startswith('generate: ')
    return error


def put_a_symlink(path):
    path.rename(path.parents[3] / 'elsewhere')
    path.symlink_to(path.parents[3] / 'elsewhere')


@pytest.mark.parametrize(
    ('name', 'change', 'finding'),
    [
        (f'{OURS}/{PACKAGE}/units.py', lambda path: path.write_bytes(b''), 'units.py: differs'),
        (f'{OURS}/docs/orphan.md', lambda path: edit(path, '', 'x'), 'orphan.md: is not from the core'),
        (f'{OURS}/setup.cfg', lambda path: path.unlink(), 'setup.cfg: missing'),
        (f'{OURS}/{PACKAGE}/bridge_node.py', lambda path: path.chmod(0o755), 'bridge_node.py: has mode 755'),
        (f'{THEIRS}/setup.py', put_a_symlink, 'setup.py: missing, or not a plain file'),
        (f'{THEIRS}/package.xml', lambda path: path.write_bytes(b'\xff\xfe'), 'and is not text'),
    ],
)  # fmt: skip
def test_check_finds_and_generate_mends_a_changed_tree(repository, name, change, finding, capsys):
    assert run(repository, '--check') == 0
    assert 'generated files are what the core generates' in capsys.readouterr().out
    change(repository / name)
    before = snapshot(repository)
    assert run(repository, '--check') == 1
    output = capsys.readouterr().out
    assert finding in output
    assert output.endswith('1 finding. Edit tools/core, never a generated file; then: make generate\n')
    assert snapshot(repository) == before
    assert run(repository, '--force') == 0
    assert run(repository, '--check') == 0


@pytest.mark.parametrize(('tree', 'is_staged'), [(TREES[0], False), (TREES[1], True)])
def test_an_unknown_file_and_an_edit_are_kept_until_an_option_gives_them_up(
    repository, tree, is_staged, capsys
):
    own, path = f'{tree}/{BRIDGE}/own_experiment.py', f'{tree}/{BRIDGE}/units.py'
    edit(repository / own, '', 'a day of work')
    edit(repository / path, '', 'x = 1\n')
    if is_staged:
        git(repository, 'add', '--all')
    edit(repository / SETTINGS, '86400.0', '86401.0')  # there is something to write
    first, *rest = refusal(repository, capsys).splitlines()
    assert 'nothing was written' in first
    assert first.endswith('make generate ARGS=--force')
    assert f'{own}: is not from the core' in rest
    assert [line for line in rest if line.startswith(('+', '-'))] == [
        f'--- {path} (generated)', f'+++ {path} (in the tree)', '+x = 1'
    ]  # fmt: skip
    assert run(repository, '--force') == 0
    assert run(repository, '--check') == 0
    assert not (repository / own).exists()


def test_what_was_generated_or_committed_is_no_edit(repository, capsys):
    git(repository, 'switch', '--quiet', '--create', 'other')
    edit(repository / UNITS, '', '# x\n')  # committed, but not generated
    commit(repository)
    git(repository, 'switch', '--quiet', 'main')
    edit(repository / SETTINGS, '86400.0', '86402.0')
    edit(repository / CORE_BRIDGE / 'new/folder/extra.py', '', 'x = 1\n')
    assert run(repository) == 0
    edit(repository / CORE_BRIDGE / 'new/folder/extra.py', '', 'x = 2\n')
    assert run(repository, '--check') == 1
    assert run(repository) == 0, capsys.readouterr().err
    commit(repository)
    git(repository, 'switch', '--quiet', 'other')
    assert run(repository) == 0, capsys.readouterr().err
    assert run(repository, '--check') == 0


def test_files_that_git_ignores_and_other_interfaces_of_the_team_are_left_alone(repository):
    edit(repository / '.gitignore', '', '*.ignored\nmore.py\n')
    edit(repository / 'monorepo/lupin_msgs/msg/New.msg', '', 'bool new\n')
    left_by_editors = (
        '.DS_Store',
        'setup.py~',
        '.vscode/settings.json',
        '.idea/x',
        '.setup.py.swp',
        '.#x.py',
    )
    for folder in (*TREES, 'tools/core'):
        for name in ('setup.py.ignored', '__pycache__/settings.pyc', *left_by_editors):
            edit(repository / folder / BRIDGE / name, '', 'lupin_msgs lupin_greenhouse_msgs')
        lock_of_an_editor = repository / folder / BRIDGE / '.#units.py'
        lock_of_an_editor.symlink_to('somebody@somewhere.1234')
    before = snapshot(repository)
    assert run(repository, '--check') == run(repository) == 0
    assert snapshot(repository) == before
    edit(repository / CORE_BRIDGE / 'more.py', '', '')
    git(repository, 'add', '--force', f'{CORE_BRIDGE}/more.py')  # git does not ignore what it tracks
    assert run(repository) == 0
    assert (repository / 'monorepo' / BRIDGE / 'more.py').exists()


@pytest.mark.parametrize(
    ('name', 'old', 'new', 'message'),
    [
        (UNITS, '', f'# {generate.HEADER}\n', 'holds the line of a generated file: remove it'),
        (f'{CORE_BRIDGE}/bridge_node.py', DIVERGENT, '', 'bridge_node.py: must have'),
        (f'{CORE_BRIDGE}/bridge_node.py', DIVERGENT, 2 * DIVERGENT, 'once, but has it 2 times: this'),
        (TABLE, 'bridge_node.py', 'gone.py', 'gone.py: must have'),
        (TABLE, '[trees.monorepo]', '[trees.monorepo', 'twins.toml: '),
        (TABLE, 'address = ', 'adress = ', "twins.toml: 'address' is missing"),
        (README, 'cp -r lupin_greenhouse_ros', 'cp -r .', 'must have `git clone --branch'),
    ],
)  # fmt: skip
def test_a_table_that_does_not_fit_the_core_writes_nothing(repository, name, old, new, message, capsys):
    edit(repository / name, old, new)
    for arguments in (['--check'], []):
        assert message in refusal(repository, capsys, *arguments)


def test_a_core_of_symlinks_and_a_folder_without_git_are_refused(repository, capsys):
    put_a_symlink(repository / UNITS)
    assert 'units.py: is a symlink' in refusal(repository, capsys)
    shutil.rmtree(repository / '.git')
    assert 'not a git repository' in refusal(repository, capsys)


@pytest.mark.parametrize(
    ('name', 'first'),
    [
        ('a.py', '#!/usr/bin/env python3\n# PYTHON_ARGCOMPLETE_OK\n'),
        ('a.py', '# -*- coding: utf-8 -*-\n'),
        ('a.xml', '<?xml version="1.0"?>\n<?xml-model href="x"?>\n'),
        ('a.rst', ''),
    ],
)
def test_the_header_comes_after_what_must_stay_first(name, first):
    rest = '"""Text."""\n'
    text = generate.with_header(name, f'{first}{rest}'.encode()).decode()
    header = text.removeprefix(first).removesuffix(rest)
    assert header.strip().strip('#<!->. ') == generate.HEADER
    assert header.endswith('\n\n' if name == 'a.rst' else '\n')
    assert not name.endswith('.py') or ast.get_docstring(ast.parse(text)) == 'Text.'


def test_every_generated_file_and_no_other_is_marked_as_generated():
    """By its header; and by its attribute, so that a pull request shows an edit once."""
    rendered = generate.render(generate.ROOT)
    del rendered[README]
    starts = {path: b'\n'.join(content.split(b'\n')[:3]) for path, (content, _) in rendered.items()}
    silent = {path for path, start in starts.items() if generate.HEADER.encode() not in start}
    assert {generate.Path(path).suffix for path in silent} == {'.json', '.png', ''}
    tracked = generate.git(generate.ROOT, 'ls-files', '-z')
    attribute = ('check-attr', '-z', '--stdin', 'linguist-generated')
    cells = generate.git(generate.ROOT, *attribute, text=tracked).split('\0')
    marked = {path for path, state in zip(cells[::3], cells[2::3], strict=False) if state == 'set'}
    assert marked == rendered.keys()
