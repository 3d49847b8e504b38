"""generate.py --check reports every difference between a tree and the core."""

import ast
import re
import shutil
import subprocess

import check_drift
import generate
import pytest
from commits import git

ROOT = generate.ROOT
BRIDGE = 'lupin_greenhouse_bridge/lupin_greenhouse_bridge'
README = 'lupin_greenhouse_ros/README.md'  # kept by hand, but for the address of the mirror
ADDRESS = generate.load_table(ROOT)['trees']['mirror']['address']


@pytest.fixture
def checkout(tmp_path):
    """Return a copy of the core, the table and both trees."""
    ignore = shutil.ignore_patterns('__pycache__', '.pytest_cache', '.hypothesis')
    for folder in ('tools/core', 'monorepo', 'lupin_greenhouse_ros'):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=ignore)
    for file in ('.gitignore', 'tools/twins.toml'):
        shutil.copy(ROOT / file, tmp_path / file)
    git(tmp_path, 'init', '--quiet')
    commit(tmp_path)
    return tmp_path


def commit(checkout):
    git(checkout, 'add', '--all')
    git(checkout, 'commit', '--quiet', '--message', 'x')


def check(checkout):
    return generate.main(['--check', '--root', str(checkout)])


def replace(path, old, new, count=1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


def write(path, text):
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)


def add_to_gitignore(checkout, pattern):
    with (checkout / '.gitignore').open('a') as file:
        file.write(f'{pattern}\n')


def sides(checkout):
    return ['--monorepo', str(checkout / 'monorepo'), '--mirror', str(checkout / 'lupin_greenhouse_ros')]


def snapshot(folder):
    return {
        path: (path.stat().st_mtime_ns, path.stat().st_mode, path.read_bytes())
        for path in folder.rglob('*')
        if path.is_file() and '.git' not in path.relative_to(folder).parts
    }


def test_the_committed_trees_are_what_the_core_generates(checkout, capsys):
    assert check(checkout) == 0
    assert 'generated files are what the core generates' in capsys.readouterr().out


def change_a_byte(tree):
    replace(tree / BRIDGE / 'settings.py', '86400.0', '86401.0')


def add_a_line_at_the_end(tree):
    path = tree / BRIDGE / 'simulator/simulation.py'
    path.write_text(path.read_text() + 'x = 1\n')


def drop_the_last_newline(tree):
    path = tree / BRIDGE / 'simulator/simulation.py'
    path.write_text(path.read_text().rstrip('\n'))


def leave_an_orphan(tree):
    (tree / BRIDGE / 'orphan.py').touch()


def leave_an_orphan_in_a_new_folder(tree):
    (tree / 'lupin_greenhouse_bridge/docs').mkdir()
    (tree / 'lupin_greenhouse_bridge/docs/orphan.md').touch()


def delete_a_file(tree):
    (tree / 'lupin_greenhouse_bridge/setup.cfg').unlink()


def change_a_mode(tree):
    (tree / BRIDGE / 'bridge_node.py').chmod(0o755)


def put_a_symlink(tree):
    path = tree / 'lupin_greenhouse_bridge/setup.py'
    path.rename(tree.parent / 'elsewhere.py')
    path.symlink_to(tree.parent / 'elsewhere.py')


def empty_a_file(tree):
    (tree / 'lupin_greenhouse_bridge/package.xml').write_bytes(b'')


def make_a_file_binary(tree):
    (tree / 'lupin_greenhouse_bridge/package.xml').write_bytes(b'\xff\xfe')


@pytest.mark.parametrize('tree', ['monorepo', 'lupin_greenhouse_ros'])
@pytest.mark.parametrize(
    ('mutate', 'finding'),
    [
        (change_a_byte, '-SECONDS_PER_DAY = 86401.0'),
        (add_a_line_at_the_end, '-x = 1'),
        (drop_the_last_newline, 'No newline at end of file'),
        (leave_an_orphan, 'orphan.py: not generated'),
        (leave_an_orphan_in_a_new_folder, 'orphan.md: not generated'),
        (delete_a_file, 'setup.cfg: missing'),
        (change_a_mode, 'bridge_node.py: has mode 755'),
        (put_a_symlink, 'setup.py: missing, or not a plain file'),
        (empty_a_file, 'package.xml: differs'),
        (make_a_file_binary, 'is binary: 2 and'),
    ],
    ids=lambda value: getattr(value, '__name__', ''),
)
def test_check_finds_and_generate_mends_a_changed_tree(checkout, tree, mutate, finding, capsys):
    mutate(checkout / tree)
    before = snapshot(checkout)
    assert check(checkout) == 1
    output = capsys.readouterr().out
    assert finding in output
    assert '1 finding. Edit' in output
    assert 'make generate' in output
    assert snapshot(checkout) == before
    assert generate.main(['--prune', '--force', '--root', str(checkout)]) == 0
    assert check(checkout) == 0


@pytest.mark.parametrize('tree', ['monorepo', 'lupin_greenhouse_ros'])
def test_an_unknown_file_is_kept_and_nothing_is_written(checkout, tree, capsys):
    own = checkout / tree / BRIDGE / 'own_experiment.py'
    own.write_text('a day of work')
    change_a_byte(checkout / 'tools/core')  # there is something to write
    before = snapshot(checkout)
    assert generate.main(['--root', str(checkout)]) == 2
    error = capsys.readouterr().err
    assert f'generate: {tree}/{BRIDGE}/own_experiment.py: is not from the core' in error
    assert 'nothing was written' in error
    assert 'make generate ARGS=--prune' in error
    assert snapshot(checkout) == before
    assert generate.main(['--prune', '--root', str(checkout)]) == 0
    assert not own.exists()
    assert check(checkout) == 0


def edit_the_core(checkout, value='86401.0'):
    path = checkout / 'tools/core' / BRIDGE / 'settings.py'
    path.write_text(re.sub(r'(?<=SECONDS_PER_DAY = )[\d.]+', value, path.read_text()))


@pytest.mark.parametrize('is_staged', [False, True], ids=['', 'staged'])
@pytest.mark.parametrize('tree', ['monorepo', 'lupin_greenhouse_ros'])
def test_an_edit_of_a_generated_file_is_kept_until_it_is_forced(checkout, tree, is_staged, capsys):
    add_a_line_at_the_end(checkout / tree)
    if is_staged:
        git(checkout, 'add', '--all')
    edit_the_core(checkout)
    before = snapshot(checkout)
    assert generate.main(['--root', str(checkout)]) == 2
    first, *diff = capsys.readouterr().err.splitlines()
    assert first == (
        'generate: nothing was written. Somebody has edited what is generated. Make this edit in tools/core'
        ' (of the address, in tools/twins.toml); to drop it: make generate ARGS=--force'
    )
    assert [line for line in diff if line.startswith('+')][1:] == ['+x = 1']
    assert f'--- {tree}/{BRIDGE}/simulator/simulation.py (generated)' in diff
    assert snapshot(checkout) == before
    assert generate.main(['--force', '--root', str(checkout)]) == 0
    assert check(checkout) == 0


def generate_twice(checkout):
    edit_the_core(checkout)
    assert generate.main(['--root', str(checkout)]) == 0


def add_a_file_and_generate_twice(checkout):
    (checkout / 'tools/core' / BRIDGE / 'extra.py').write_text('x = 1\n')
    assert generate.main(['--root', str(checkout)]) == 0
    (checkout / 'tools/core' / BRIDGE / 'extra.py').write_text('x = 2\n')


def forget_to_generate(checkout):
    edit_the_core(checkout)
    commit(checkout)


def switch_to_a_branch_that_was_not_generated(checkout):
    git(checkout, 'switch', '--quiet', '--create', 'other')
    forget_to_generate(checkout)
    git(checkout, 'switch', '--quiet', '-')
    generate_twice(checkout)
    commit(checkout)
    git(checkout, 'switch', '--quiet', 'other')


@pytest.mark.parametrize(
    'situation',
    [
        generate_twice,
        add_a_file_and_generate_twice,
        forget_to_generate,
        switch_to_a_branch_that_was_not_generated,
    ],
)
def test_an_edit_of_the_core_is_generated_in_every_situation(checkout, situation, capsys):
    situation(checkout)
    edit_the_core(checkout, '86403.0')
    assert check(checkout) == 1
    assert generate.main(['--root', str(checkout)]) == 0, capsys.readouterr().err
    assert check(checkout) == 0


def test_a_file_that_git_ignores_is_none_of_a_package(checkout):
    add_to_gitignore(checkout, '*.swp')
    for folder in ('monorepo', 'lupin_greenhouse_ros', 'tools/core'):
        for name in ('setup.py.swp', '__pycache__/settings.pyc'):
            write(checkout / folder / BRIDGE / name, 'lupin_msgs lupin_greenhouse_msgs')
    before = snapshot(checkout)
    assert check(checkout) == 0
    assert generate.main(['--root', str(checkout)]) == 0
    assert snapshot(checkout) == before


def test_the_generator_sees_what_the_drift_checker_takes_for_build_output(checkout, capsys):
    names = ['build/more.py', 'log/more.py', 'more.egg-info/more.py', 'more.pyc']
    for name in names:
        write(checkout / 'monorepo/lupin_greenhouse_bridge' / name, '')
    assert check_drift.main(sides(checkout)) == 0
    assert check(checkout) == 1
    output = capsys.readouterr().out
    assert all(f'{name}: not generated from the core' in output for name in names)


def test_the_drift_checker_sees_what_git_ignores(checkout, capsys):
    add_to_gitignore(checkout, 'more.py')
    write(checkout / 'monorepo' / BRIDGE / 'more.py', '')
    assert check(checkout) == 0
    assert check_drift.main(sides(checkout)) == 1
    assert 'more.py:1: [only one side]' in capsys.readouterr().out


def test_a_tracked_file_is_generated_even_if_git_ignores_its_name(checkout):
    add_to_gitignore(checkout, 'more.py')
    write(checkout / 'tools/core' / BRIDGE / 'more.py', '')
    subprocess.run(['git', 'add', '--force', 'tools/core'], cwd=checkout, check=True)
    assert generate.main(['--root', str(checkout)]) == 0
    assert (checkout / 'monorepo' / BRIDGE / 'more.py').exists()


def test_a_folder_without_git_is_refused(checkout, capsys):
    shutil.rmtree(checkout / '.git')
    assert generate.main(['--root', str(checkout)]) == 2
    assert 'not a git repository' in capsys.readouterr().err


def test_another_interface_of_the_team_is_left_alone(checkout):
    before = snapshot(checkout / 'monorepo/lupin_msgs')
    (checkout / 'monorepo/lupin_msgs/msg/New.msg').write_text('bool new\n')
    assert check(checkout) == 0
    assert generate.main(['--root', str(checkout)]) == 0
    assert snapshot(checkout / 'monorepo/lupin_msgs').items() > before.items()


def test_the_address_of_the_table_is_written_into_the_readme_and_its_repos_example(checkout, capsys):
    replace(checkout / 'tools/twins.toml', ADDRESS, 'git@example.org:other.git')
    replace(checkout / README, '## What else there is', '## What else is here')
    edited = (checkout / README).read_text()
    assert check(checkout) == 1
    assert '+    url: git@example.org:other.git' in capsys.readouterr().out
    commit(checkout)
    assert generate.main(['--root', str(checkout)]) == 0
    assert (checkout / README).read_text() == edited.replace(ADDRESS, 'git@example.org:other.git')
    assert check(checkout) == 0


def lose_the_address(checkout):
    replace(checkout / 'tools/twins.toml', 'address = ', 'adress = ')


def lose_the_place_of_the_address(checkout):
    replace(checkout / README, 'git clone --branch ready', 'git clone')


def use_the_old_name_once_more(checkout):
    path = checkout / 'tools/core' / BRIDGE / 'interfaces.py'
    path.write_text(path.read_text() + '# lupin_msgs\n')


def use_the_old_name_in_a_new_file(checkout):
    (checkout / 'tools/core' / BRIDGE / 'extra.py').write_text('import LUPIN_MSGS\n')


def name_a_file_after_the_old_package(checkout):
    (checkout / 'tools/core' / BRIDGE / 'lupin_msgs_helper.py').touch()


def use_the_mirrors_name_in_the_core(checkout):
    (checkout / 'tools/core' / BRIDGE / 'extra.py').write_text('# lupin_greenhouse_msgs\n')


def lose_the_divergent_line(checkout):
    path = checkout / 'tools/core' / BRIDGE / 'bridge_node.py'
    replace(path, 'return Path(value) if value else None', 'return Path(value) if value != "" else None')


def double_the_divergent_line(checkout):
    path = checkout / 'tools/core' / BRIDGE / 'bridge_node.py'
    line = '    return Path(value) if value else None\n'
    replace(path, line, line * 2)


def expect_one_match_too_many(checkout):
    replace(checkout / 'tools/twins.toml', 'interfaces.py" = 2', 'interfaces.py" = 3')


def list_a_file_without_a_match(checkout):
    replace(
        checkout / 'tools/twins.toml',
        '"lupin_greenhouse_bridge/package.xml" = 1',
        '"lupin_greenhouse_bridge/package.xml" = 1\n"lupin_greenhouse_bridge/setup.cfg" = 0',
    )


def add_an_unused_substitution(checkout):
    path = checkout / 'tools/twins.toml'
    addition = '\n[[trees.mirror.substitutions]]\nfind = "nowhere"\nreplace = ""\nmatches = {}\n'
    path.write_text(path.read_text() + addition)


def add_a_substitution_in_no_file(checkout):
    path = checkout / 'tools/twins.toml'
    addition = '\n[[trees.mirror.substitutions]]\nfind = "x"\nreplace = ""\nmatches = { "gone.py" = 1 }\n'
    path.write_text(path.read_text() + addition)


def break_the_table(checkout):
    (checkout / 'tools/twins.toml').write_text('[monorepo')


def lose_the_core(checkout):
    shutil.rmtree(checkout / 'tools/core')


@pytest.mark.parametrize(
    ('mutate', 'message'),
    [
        (use_the_old_name_once_more, 'must match 2 times in lupin_greenhouse_bridge'),
        (use_the_old_name_in_a_new_file, "'lupin_msgs' is left over in"),
        (name_a_file_after_the_old_package, "'lupin_msgs' is left over in"),
        (use_the_mirrors_name_in_the_core, "'lupin_greenhouse_msgs' is left over in"),
        (lose_the_divergent_line, 'must match 1 time in'),
        (double_the_divergent_line, 'and matches 2'),
        (expect_one_match_too_many, 'must match 3 times'),
        (list_a_file_without_a_match, 'must match 0 times'),
        (add_an_unused_substitution, "'nowhere' matches no file"),
        (add_a_substitution_in_no_file, 'gone.py'),
        (break_the_table, 'twins.toml'),
        (lose_the_core, 'holds no files'),
        (lose_the_address, "twins.toml: 'address' is missing"),
        (lose_the_place_of_the_address, 'README.md: must have `git clone --branch ready ADDRESS'),
    ],
    ids=lambda value: getattr(value, '__name__', ''),
)
@pytest.mark.parametrize('arguments', [['--check'], []], ids=['check', 'write'])
def test_a_table_that_does_not_fit_the_core_writes_nothing(checkout, mutate, message, arguments, capsys):
    mutate(checkout)
    before = snapshot(checkout)
    assert generate.main([*arguments, '--root', str(checkout)]) == 2
    error = capsys.readouterr().err
    assert error.startswith('generate: ')
    assert message in error
    assert snapshot(checkout) == before


def test_every_generated_file_with_comments_says_so_in_its_first_lines(checkout):
    rendered = generate.render(checkout, generate.load_table(checkout))
    silent = [
        path
        for path, (content, _) in rendered.items()
        if path != README and generate.HEADER.encode() not in b'\n'.join(content.split(b'\n')[:3])
    ]
    without_comments = {'.json', '.png', ''}
    assert {generate.Path(path).suffix for path in silent} == without_comments


@pytest.mark.parametrize(
    ('name', 'first'),
    [
        ('a.py', '#!/usr/bin/env python3\n# PYTHON_ARGCOMPLETE_OK\n'),
        ('a.py', '# -*- coding: utf-8 -*-\n'),
        ('a.xml', '<?xml version="1.0"?>\n<?xml-model href="x"?>\n'),
        ('a.html', '<!doctype html>\n'),
        ('a.rst', ''),
    ],
)
def test_the_header_comes_after_what_must_stay_first(name, first):
    rest = 'x\n'
    text = generate.with_header(name, f'{first}{rest}'.encode()).decode()
    header = text.removeprefix(first).removesuffix(rest)
    assert header.strip().strip('#<!->. ') == generate.HEADER
    assert header.endswith('\n\n' if name == 'a.rst' else '\n')


def test_a_module_keeps_its_docstring():
    text = generate.with_header('a.py', b'"""Text."""\n').decode()
    assert ast.get_docstring(ast.parse(text)) == 'Text.'


def test_a_header_in_the_core_is_refused(checkout, capsys):
    path = checkout / 'tools/core' / BRIDGE / 'settings.py'
    path.write_text(f'# {generate.HEADER}\n{path.read_text()}')
    assert generate.main(['--root', str(checkout)]) == 2
    assert 'settings.py: holds the line of a generated file: remove it' in capsys.readouterr().err


def test_every_generated_file_and_no_other_is_marked_as_generated():
    """Then a merge request on GitHub or GitLab shows an edit once."""
    rendered = generate.render(ROOT, generate.load_table(ROOT))
    tracked = subprocess.run(['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=True)
    paths = tracked.stdout.rstrip('\0').split('\0')
    for attribute in ('linguist-generated', 'gitlab-generated'):
        command = ['git', 'check-attr', '-z', '--stdin', attribute]
        result = subprocess.run(
            command, cwd=ROOT, input='\0'.join(paths), capture_output=True, text=True, check=True
        )
        cells = result.stdout.split('\0')
        marked = {path for path, state in zip(cells[::3], cells[2::3], strict=False) if state == 'set'}
        assert marked == rendered.keys() - {README}
