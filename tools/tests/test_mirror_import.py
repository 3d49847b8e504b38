"""Patches of another team's clone of the mirror are imported into the core and both trees."""

import shutil
import subprocess

import check_drift
import generate
import mirror_import
import pytest
from clones import commit, edit, git, snapshot

PACKAGE = 'lupin_greenhouse_bridge'
BRIDGE = f'{PACKAGE}/{PACKAGE}'
NEW_TITLE = ('README.md', '## All pages', '## Every page')
LOG_MORE = (f'{BRIDGE}/bridge_node.py', 'LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 2.0')


def commit_in(mirror, *edits):
    """Commit edits of files; return the patch."""
    for path, old, new in edits:
        edit(mirror / path, old, new)
    commit(mirror, 'Mend it')
    git(mirror, 'format-patch', '--output=../N.patch', '-1')
    return (mirror / '../N.patch').read_bytes().decode(errors='surrogateescape')


def write_patch(monorepo, patch):
    file = monorepo.parent / 'N.patch'
    file.write_bytes(patch.encode(errors='surrogateescape'))
    return file


def import_patch(monorepo, patch):
    """Run the command; return how it has ended."""
    file = write_patch(monorepo, patch)
    # A shell in the background ignores Ctrl-C; so would this.
    command = ['env', '--default-signal=INT', 'python', '-B', 'tools/mirror_import.py', file]
    return subprocess.run(
        command, cwd=monorepo, capture_output=True, text=True, check=False, start_new_session=True
    )


def refused(result):
    """Return the reason of a refusal, which is one line."""
    prefix = 'mirror-import: nothing was changed: '
    (line,) = result.stderr.splitlines()
    assert (result.returncode, line[: len(prefix)]) == (1, prefix)
    return line.removeprefix(prefix)


@pytest.fixture
def refusal(repositories):
    """Return a function that returns why a patch is refused, in this process: that is faster."""
    monorepo, _ = repositories
    start = git(monorepo, 'rev-parse', 'HEAD').strip()

    def told(patch):
        file = write_patch(monorepo, patch)
        with pytest.raises(generate.RefusedError, match=r"^'Mend it': ") as refused:
            mirror_import.import_patch(monorepo, file, generate.load_table(monorepo))
        shutil.rmtree(monorepo / '.git/rebase-apply', ignore_errors=True)
        git(monorepo, 'reset', '--quiet', '--hard', start)
        git(monorepo, 'clean', '--quiet', '-ffd')
        return str(refused.value)

    return told


def add_hook(monorepo, name, script):
    hook = monorepo / '.git/hooks' / name
    hook.write_text(f'#!/bin/sh\n{script}\n')
    hook.chmod(0o755)


def state(monorepo):
    """Return all of a repository that an import may change, with the files that git ignores."""
    commands = (
        ['symbolic-ref', 'HEAD'], ['for-each-ref'], ['ls-files', '--stage'], ['status', '--porcelain'],
        ['worktree', 'list'],
    )  # fmt: skip
    return snapshot(monorepo), [git(monorepo, *command) for command in commands]


def checks_pass(monorepo):
    trees = ['--monorepo', str(monorepo / 'monorepo'), '--mirror', str(monorepo / 'lupin_greenhouse_ros')]
    return generate.main(['--check', '--root', str(monorepo)]) == check_drift.main(trees) == 0


def test_every_change_of_the_mirror_arrives_in_the_core_and_both_trees(repositories):
    monorepo, mirror = repositories
    add_hook(monorepo, 'pre-commit', 'python tools/generate.py --check | grep "are what the core"')
    more = f'{PACKAGE}/test/new/folder/test_more.py'
    edit(monorepo / '.gitignore', '', 'test_more.py\n')  # which the mirror does not ignore
    commit(monorepo)
    edits = [
        NEW_TITLE,
        LOG_MORE,
        (f'{BRIDGE}/bridge_node.py', 'Turn a path parameter', 'Turn the path parameter'),
        (f'{BRIDGE}/units.py', '', '\n\ndef f(value):\n    return value or None\n'),  # no divergence there
        ('lupin_greenhouse_msgs/msg/SensorReading.msg', 'One simulated', 'A simulated'),
        # beside the header
        (f'{BRIDGE}/units.py', '"""The units', '"""All units'),
        (f'{PACKAGE}/package.xml', '<package format', '<!-- x -->\n<package format'),
        (f'{PACKAGE}/CHANGELOG.rst', 'Changelog for package', 'Changes of package'),
        (more, '', f'# {generate.HEADER}\n"""More of lupin_greenhouse_msgs."""\n'),
    ]
    (mirror / f'{BRIDGE}/interfaces.py').rename(mirror / f'{BRIDGE}/messages.py')
    (mirror / f'{PACKAGE}/setup.cfg').rename(mirror / f'{BRIDGE}/moved.cfg')
    (mirror / f'{PACKAGE}/test/test_package.py').unlink()
    (mirror / f'{BRIDGE}/units.py').chmod(0o755)
    texts = (b'a\r\nb\r\n', b'a\rb\nc\r', b'\xfcber\n', 'a\u2028b\x0cc\x85d\n'.encode(), b'\0\xff\r\n', b'')
    for number, content in enumerate(texts):
        (mirror / f'{BRIDGE}/Überblick "{number}".txt').write_bytes(content)  # git quotes this name
    result = import_patch(monorepo, commit_in(mirror, *edits))
    assert result.returncode == 0, result.stdout + result.stderr
    assert 'Another Team: Mend it' in result.stdout
    assert git(monorepo, 'status', '--porcelain') == ''
    git(mirror, 'fetch', '--quiet', str(monorepo))
    assert git(mirror, 'diff', '--stat', 'FETCH_HEAD:lupin_greenhouse_ros', 'HEAD') == ''
    assert (monorepo / 'tools/core' / more).read_text() == '"""More of lupin_msgs."""\n'
    assert checks_pass(monorepo)


ON_PURPOSE = (
    "must have 'return value or None' once, and has it 0 times:"
    ' here the trees differ on purpose, as tools/twins.toml says'
)


def test_what_the_mirror_must_keep_cannot_be_changed(repositories, refusal):
    mirror, node, units = repositories[1], f'{BRIDGE}/bridge_node.py', f'{BRIDGE}/units.py'
    renamed = 'names lupin_msgs: in the mirror, it is lupin_greenhouse_msgs'
    (mirror / 'LICENSE').unlink()
    for edits, reason in (
        ([], 'LICENSE: is missing; the mirror keeps it by hand: put it back'),
        ([(node, '    return value or None\n', '    return value\n')], f'{node}: {ON_PURPOSE}'),
        ([(units, '', '# lupin_msgs')], f'{units}: {renamed}'),
    ):
        assert refusal(commit_in(mirror, *edits)).endswith(reason)


def mail(diff):
    """Return a patch as git format-patch prints it."""
    head = f'From {"0" * 40} Mon Sep 17 00:00:00 2001\nFrom: A <a@b.c>\nSubject: [PATCH] Mend it\n\n---\n'
    return f'{head}{diff}-- \n2.34.1\n'


TEXT = '@@ -0,0 +1 @@\n+on: push\n'
NOT_OF_THE_MIRROR = [
    'NOTES.md', 'Überblick.md', '.github/workflows/more.yml', '../.github/workflows/more.yml',
    'lupin_greenhouse_bridge/../../more.py', '.git/hooks/pre-commit', 'lupin_greenhouse_bridge',
    'lupin_msgs/msg/SensorReading.msg', 'lupin_msgs/CHANGELOG.rst', 'lupin_greenhouse_msgs/msg/More.msg',
    'tools/core/lupin_greenhouse_bridge/more.py', 'doc/lupin_greenhouse_ros/lupin_greenhouse_bridge/more.py',
]  # fmt: skip


def test_a_path_that_is_not_of_the_mirror_is_refused_in_every_form_of_a_patch(repositories, refusal):
    for path in NOT_OF_THE_MIRROR:
        quoted = path.replace('Ü', r'\303\234')
        a, b = (f'"{side}/{quoted}"' if quoted != path else f'{side}/{path}' for side in 'ab')
        for diff in (
            f'diff --git {a} {b}\nnew file mode 100644\n--- /dev/null\n+++ {b}\n{TEXT}',
            f'--- /dev/null\n+++ {b}\n{TEXT}',
            f'diff --git a/README.md {b}\nsimilarity index 100%\nrename from README.md\nrename to {b[2:]}\n',
            f'diff --git a/README.md {b}\nsimilarity index 100%\ncopy from README.md\ncopy to {b[2:]}\n',
        ):
            assert refusal(mail(diff)), (path, diff)
    before = state(repositories[0])
    assert refused(import_patch(repositories[0], mail(diff))).startswith("'Mend it': ")
    assert state(repositories[0]) == before


@pytest.mark.parametrize('mode', ['120000', '160000'])
def test_a_symlink_and_a_submodule_are_refused(refusal, mode):
    path = 'lupin_greenhouse_bridge/doc/more.md'
    text = TEXT.replace('on: push', f'Subproject commit {"1" * 40}')
    diff = f'diff --git a/{path} b/{path}\nnew file mode {mode}\n--- /dev/null\n+++ b/{path}\n{text}'
    assert refusal(mail(diff)) == f"'Mend it': lupin_greenhouse_ros/{path}: is not a plain file"


def test_a_patch_without_prefixes_is_refused_with_the_fix(repositories, refusal):
    mirror = repositories[1]
    commit_in(mirror, (f'{BRIDGE}/more.py', '', ''))
    reason = refusal(git(mirror, 'format-patch', '--stdout', '--no-prefix', '-1'))
    assert 'without a/ and b/: make it with git -c diff.noprefix=false format-patch' in reason


def test_a_traditional_patch_that_was_saved_with_crlf_is_imported(repositories):
    monorepo, path = repositories[0], f'{PACKAGE}/doc/more.md'
    result = import_patch(monorepo, mail(f'--- /dev/null\n+++ b/{path}\n{TEXT}').replace('\n', '\r\n'))
    assert result.returncode == 0, result.stderr
    assert (monorepo / 'tools/core' / path).read_bytes() == b'on: push\n'
    assert checks_pass(monorepo)


def test_a_patch_that_is_cut_off_is_refused(repositories, refusal):
    patch = commit_in(repositories[1], NEW_TITLE, (f'{BRIDGE}/units.py', '"""The units', '"""All units'))
    for end in ('diff --git a/lupin', '\n@@ ', '\n+', '\n---\n'):
        assert refusal(patch[: patch.rindex(end)])


@pytest.mark.parametrize(
    ('hook', 'script', 'message'),
    [
        ('pre-commit', 'rm -r tools/core; exit 1', 'git commit: exit code 1'),
        ('pre-applypatch', 'exit 1', 'does not apply to lupin_greenhouse_ros: exit code 1'),
        ('post-applypatch', 'rm -r tools/core/*/', 'as tools/twins.toml says'),
        ('pre-commit', 'kill -INT 0', None),
    ],
    ids=['spoiling', 'pre-applypatch', 'generation', 'Ctrl-C'],
)
def test_a_failure_leaves_the_repository_as_it_was(repositories, hook, script, message):
    """It fails at the second commit of a series."""
    monorepo, mirror = repositories
    series = commit_in(mirror, LOG_MORE) + commit_in(mirror, NEW_TITLE)
    ignored = monorepo / 'monorepo' / BRIDGE / '__pycache__/own.pyc'
    ignored.parent.mkdir(exist_ok=True)
    ignored.touch()
    first = monorepo.parent / 'first'
    add_hook(monorepo, hook, f'[ -e "{first}" ] || exec touch "{first}"\n{script}')
    before = state(monorepo)
    result = import_patch(monorepo, series)
    assert result.returncode == (1 if message else 130)
    assert first.exists()
    if message:
        assert refused(result).startswith("'Mend it': ")
        assert refused(result).endswith(message)
    assert state(monorepo) == before


def test_a_series_arrives_commit_by_commit_or_not_at_all(repositories):
    monorepo, mirror = repositories
    first = commit_in(mirror, LOG_MORE)
    second = commit_in(mirror, NEW_TITLE)
    good = import_patch(monorepo, first + second)
    assert good.returncode == 0, good.stderr
    told = ['log', '-2', '--format=%an <%ae> %ad %s']
    assert git(monorepo, *told) == git(mirror, *told)
    assert checks_pass(monorepo)

    before = state(monorepo)
    again = import_patch(monorepo, first + second)
    assert (again.returncode, again.stdout) == (0, "'Mend it' is here already\n" * 2)
    third = commit_in(mirror, ('README.md', '## In a larger workspace', '## In a workspace'))
    bad = import_patch(monorepo, third + first.replace('LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 9.0'))
    assert "'Mend it': does not apply to lupin_greenhouse_ros: " in refused(bad)
    assert state(monorepo) == before


def test_a_missing_file_one_without_a_patch_and_uncommitted_changes_are_refused(repositories):
    monorepo, mirror = repositories
    page = import_patch(monorepo, '<html>sign in</html>\n')
    assert refused(page).endswith('holds no patch of git format-patch')
    edit(monorepo / 'README.md', '', 'changed')
    result = import_patch(monorepo, commit_in(mirror, NEW_TITLE))
    assert result.returncode == 2
    assert result.stderr == 'mirror-import: commit or stash your own changes first\n'
    for name, what in (('missing.patch', 'no file'), ('', 'no file'), ('tools', 'a folder')):
        command = ['python', '-B', 'tools/mirror_import.py', name]
        missing = subprocess.run(command, cwd=monorepo, capture_output=True, text=True, check=False)
        assert missing.returncode == 2
        assert missing.stderr == f'mirror-import: PATCH={name} is {what}: write PATCH=N.patch\n'
