"""Patches of another team's clone of the mirror are imported into the core and both trees."""

import subprocess
import sys

import check_drift
import generate
import pytest
from clones import commit, edit, git, snapshot

PACKAGE = 'lupin_greenhouse_bridge'
BRIDGE = f'{PACKAGE}/{PACKAGE}'
NEW_TITLE = ('README.md', '## Pages', '## Every page')
LOG_MORE = (f'{BRIDGE}/bridge_node.py', 'LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 2.0')


def patch_of(mirror, *edits, message='Mend it', settings=()):
    """Commit edits of files; return the patch."""
    for path, old, new in edits:
        edit(mirror / path, old, new)
    commit(mirror, message)
    git(mirror, *settings, 'format-patch', '--output=../N.patch', '-1')
    return (mirror.parent / 'N.patch').read_bytes().decode(errors='surrogateescape')


def import_patch(monorepo, patch):
    """Run the command; return how it has ended."""
    file = monorepo.parent / 'N.patch'
    file.write_bytes(patch.encode(errors='surrogateescape'))
    command = [sys.executable, '-B', 'tools/mirror_import.py', file]
    return subprocess.run(command, cwd=monorepo, capture_output=True, text=True, check=False)


def refused(result):
    """Return the reason of a refusal."""
    prefix = 'mirror-import: nothing was changed: '
    assert (result.returncode, result.stderr[: len(prefix)]) == (1, prefix), result.stderr
    return result.stderr.removeprefix(prefix)


def state(monorepo):
    """Return all of a repository that an import may change, with the files that git ignores."""
    commands = (['symbolic-ref', 'HEAD'], ['for-each-ref'], ['status', '--porcelain'], ['worktree', 'list'])
    return snapshot(monorepo), [git(monorepo, *command) for command in commands]


def checks_pass(monorepo):
    trees = ['--monorepo', str(monorepo / 'monorepo'), '--mirror', str(monorepo / 'lupin_greenhouse_ros')]
    return generate.main(['--check', '--root', str(monorepo)]) == check_drift.main(trees) == 0


def test_every_change_of_the_mirror_arrives_in_the_core_and_both_trees(repositories):
    monorepo, mirror = repositories
    more = f'{PACKAGE}/test/new/folder/test_more.py'
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
    for number, content in enumerate((b'\xfcber\n', 'a\u2028b\x0cc\x85d\n'.encode(), b'\0\xff\r\n', b'')):
        (mirror / f'{BRIDGE}/Überblick "{number}".txt').write_bytes(content)  # git quotes this name
    result = import_patch(monorepo, patch_of(mirror, *edits, settings=['-c', 'core.quotePath=true']))
    assert result.returncode == 0, result.stdout + result.stderr
    assert 'Another Team: Mend it' in result.stdout
    assert git(monorepo, 'status', '--porcelain') == ''
    git(mirror, 'fetch', '--quiet', str(monorepo))
    assert git(mirror, 'diff', '--stat', 'FETCH_HEAD:lupin_greenhouse_ros', 'HEAD') == ''
    assert (monorepo / 'tools/core' / more).read_text() == '"""More of lupin_msgs."""\n'
    assert checks_pass(monorepo)


PREFIX, ATTACHED = ('-c', 'format.subjectPrefix=RFC PATCH'), ('-c', 'format.attach=part')


@pytest.mark.parametrize(
    ('message', 'settings'),
    [
        ('[docs] Fix the title', ()),
        ('[docs] Fix the title', PREFIX),
        ('Fix [a] title\n\n# no comment\n\nSee [docs].\n\n-- >8 --\nStill here.', ()),
        ('Übersetze\n\nLine one,\n   and an indented one.\n\nSigned-off-by: A <a@b.c>', ATTACHED),
    ],
)
def test_a_message_arrives_as_it_was_written(repositories, message, settings):
    monorepo, mirror = repositories
    for name, value in (('mailinfo.scissors', 'true'), ('am.messageid', 'true'), ('commit.cleanup', 'strip')):
        git(monorepo, 'config', name, value)
    result = import_patch(monorepo, patch_of(mirror, NEW_TITLE, message=message, settings=settings))
    assert result.returncode == 0, result.stderr
    told = ['show', '--no-patch', '--format=%an <%ae> %ad%n%B']
    assert git(monorepo, *told) == git(mirror, *told)


def test_what_the_mirror_must_keep_cannot_be_changed(repositories):
    monorepo, mirror = repositories
    node, units = f'{BRIDGE}/bridge_node.py', f'{BRIDGE}/units.py'
    for edits, reason in (
        (
            [(node, '    return value or None\n', '    return value\n')],
            "must have 'return value or None' once",
        ),
        (
            [(units, '', '# lupin_msgs')],
            f'{units}: names lupin_msgs: in the mirror, it is lupin_greenhouse_msgs',
        ),
        ([('NOTES.md', '', 'x')], 'lupin_greenhouse_ros/NOTES.md: is not a file of the mirror'),
        ([('lupin_msgs/msg/SensorReading.msg', '', 'x')], 'SensorReading.msg: is not a file of the mirror'),
        ([('lupin_greenhouse_msgs/msg/More.msg', '', 'x')], 'More.msg: is not a file of the mirror'),
    ):
        assert reason in refused(import_patch(monorepo, patch_of(mirror, *edits)))
        git(mirror, 'reset', '--quiet', '--hard', 'HEAD~')
    (mirror / 'LICENSE').unlink()
    assert 'LICENSE: is missing' in refused(import_patch(monorepo, patch_of(mirror)))
    (mirror / units).unlink()
    (mirror / units).symlink_to('errors.py')
    assert f'{units}: is not a plain file' in refused(import_patch(monorepo, patch_of(mirror)))


@pytest.mark.parametrize(
    'path', ['../.github/workflows/more.yml', f'{PACKAGE}/../../more.py', '.git/hooks/x']
)
def test_a_path_outside_of_the_mirror_is_refused(repositories, path):
    head = f'From {"0" * 40} Mon Sep 17 00:00:00 2001\nFrom: A <a@b.c>\nSubject: [PATCH] Mend it\n\n---\n'
    diff = f'diff --git a/{path} b/{path}\nnew file mode 100644\n--- /dev/null\n+++ b/{path}\n'
    before = state(repositories[0])
    assert refused(
        import_patch(repositories[0], f'{head}{diff}@@ -0,0 +1 @@\n+on: x\n-- \n2.34.1\n')
    ).startswith('patch 1: ')
    assert state(repositories[0]) == before


def test_a_patch_that_was_saved_with_crlf_is_imported(repositories):
    monorepo, mirror = repositories
    result = import_patch(monorepo, patch_of(mirror, LOG_MORE).replace('\n', '\r\n'))
    assert result.returncode == 0, result.stderr
    assert checks_pass(monorepo)


def test_a_series_arrives_commit_by_commit_or_not_at_all(repositories):
    monorepo, mirror = repositories
    first, second = patch_of(mirror, LOG_MORE), patch_of(mirror, NEW_TITLE)
    good = import_patch(monorepo, first + second)
    assert good.returncode == 0, good.stderr
    told = ['log', '-2', '--format=%an <%ae> %ad %s']
    assert git(monorepo, *told) == git(mirror, *told)
    assert checks_pass(monorepo)

    before = state(monorepo)
    again = import_patch(monorepo, first + second)
    assert (again.returncode, again.stdout) == (0, 'the patches are here already\n')
    third = patch_of(mirror, ('README.md', '## Other ways to install', '## Other ways'))
    bad = import_patch(monorepo, third + first.replace('LOG_EVERY_SECONDS = 5.0', 'LOG_EVERY_SECONDS = 9.0'))
    assert refused(bad).startswith('patch 2: git am: ')
    assert state(monorepo) == before


def test_a_missing_file_one_without_a_patch_and_uncommitted_changes_are_refused(repositories):
    monorepo, mirror = repositories
    assert 'git mailsplit: ' in refused(import_patch(monorepo, '<html>sign in</html>\n'))
    edit(monorepo / 'README.md', '', 'changed')
    result = import_patch(monorepo, patch_of(mirror, NEW_TITLE))
    assert refused(result) == 'commit or stash your own changes first\n'
    command = [sys.executable, '-B', 'tools/mirror_import.py', 'missing.patch']
    missing = subprocess.run(command, cwd=monorepo, capture_output=True, text=True, check=False)
    assert refused(missing) == 'PATCH=missing.patch is not a file: write PATCH=N.patch\n'
