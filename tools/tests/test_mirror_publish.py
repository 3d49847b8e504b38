"""Publish the mirror to a remote: no rewritten history, all or nothing, and twice is once."""

import re
from xml.etree import ElementTree

import generate
import mirror_publish
import mirror_publish_check
import pytest
from clones import commit, edit, git
from test_mirror_import import BRIDGE

MIRROR = mirror_publish.ROOT / mirror_publish.MIRROR
README = 'lupin_greenhouse_ros/README.md'
NODE = f'monorepo/{BRIDGE}/bridge_node.py'
VERSION = ElementTree.parse(MIRROR / 'lupin_greenhouse_bridge/package.xml').findtext('version')
REFS = ['refs/heads/main', 'refs/heads/ready']
PAGES = [(MIRROR / path).read_text() for path in mirror_publish_check.PAGES]


@pytest.fixture
def remote(tmp_path):
    """Return an empty repository to publish to; like a host, it makes the first branch the default branch."""
    git(tmp_path, 'init', '--quiet', '--bare', '--initial-branch=ready', 'published.git')
    return tmp_path / 'published.git'


@pytest.fixture
def publish(repository, remote, capsys):
    """Return a function that publishes the repository and returns exit code and output."""
    set_address(repository, remote)

    def publish_to(*arguments: str, to=remote):
        code = mirror_publish.main([str(to), '--root', str(repository), *arguments])
        printed = capsys.readouterr()
        wait = 'mirror-publish: taking the history of lupin_greenhouse_ros (about 20 s)\n'
        assert code or wait in printed.err
        return code, printed.out.partition('only the allowed divergence\n')[2] + printed.err.replace(wait, '')

    return publish_to


def set_address(folder, address):
    """Set the address of the mirror, generate and commit."""
    path = folder / 'tools/twins.toml'
    path.write_text(re.sub('(?<=^address = ).*', f'"{address}"', path.read_text(), flags=re.MULTILINE))
    assert generate.main(['--root', str(folder)]) == 0
    commit(folder)


def change(folder, path=README, text='\nMore.\n'):
    """Commit a change of a file."""
    edit(folder / path, '', text)
    commit(folder)


def begin_changelogs_with(folder, heading):
    """Give the newest section of each changelog this heading, and commit."""
    for path in git(folder, 'ls-files', '*CHANGELOG.rst').splitlines():
        text, section = (folder / path).read_text(), f'{heading}\n{"-" * len(heading)}'
        (folder / path).write_text(mirror_publish.CHANGELOG_SECTION.sub(section, text, count=1))
    git(folder, 'commit', '--quiet', '--all', '--allow-empty', '--message', 'Change the heading')


def refs(remote) -> dict[str, str]:
    lines = git(remote, 'for-each-ref', '--format=%(refname) %(objectname)').splitlines()
    return dict(line.split() for line in lines)


def test_main_is_the_mirror_and_ready_is_main_without_colcon_ignore(repository, remote, publish):
    begin_changelogs_with(repository, f'{VERSION} (2026-01-01)')
    code, printed = publish('--dry-run')
    assert (code, refs(remote)) == (0, {})
    assert re.sub('[0-9a-f]{10}', 'COMMIT', printed) == ''.join(
        f'would push {ref} new -> COMMIT\n' for ref in REFS[::-1]
    )
    hook = remote / 'hooks/post-receive'
    hook.write_text('#!/bin/sh\ncat >> pushed; echo end of push >> pushed\n')
    hook.chmod(0o755)
    code, printed = publish('--release', VERSION)
    assert code == 0, printed
    assert list(refs(remote)) == [*REFS, f'refs/tags/{VERSION}']
    # GitHub makes the first branch that it gets the default branch.
    pushed = re.findall('refs/.*|end of push', (remote / 'pushed').read_text())
    assert pushed == [REFS[1], 'end of push', REFS[0], f'refs/tags/{VERSION}', 'end of push']
    mirror = git(repository, 'rev-parse', 'HEAD:lupin_greenhouse_ros')
    assert git(remote, 'rev-parse', 'main^{tree}') == mirror
    assert git(remote, 'diff', '--name-status', 'main', 'ready') == 'D\tCOLCON_IGNORE\n'
    assert git(remote, 'rev-parse', f'{VERSION}^{{commit}}') == git(remote, 'rev-parse', 'main')
    before = refs(remote)
    assert publish('--release', VERSION) == (0, 'nothing to publish\n')
    change(repository)
    code, printed = publish('--release', VERSION)
    assert (code, 'choose another version' in printed, refs(remote)) == (1, True, before)


def test_another_remote_than_that_of_the_address_is_refused_with_what_to_set(repository, remote, publish):
    """A repository that moved keeps its history and gets its new address."""
    publish()
    moved = remote.parent / 'moved.git'
    git(remote.parent, 'clone', '--quiet', '--mirror', str(remote), str(moved))
    before = refs(moved)
    code, printed = publish(to=moved)
    advice = f'set address = "{moved}" under [trees.mirror] in tools/twins.toml, run make generate'
    assert (code, advice in printed) == (1, True)
    change(repository)
    code, printed = publish('--dry-run', to=moved)
    assert (code, printed.count('would push')) == (0, 2)
    assert (advice in printed, refs(moved)) == (True, before)

    set_address(repository, moved)
    assert publish(to=moved)[0] == 0
    assert git(moved, 'rev-parse', 'main~2').strip() == before['refs/heads/main']
    text = git(moved, 'show', 'ready:README.md')
    assert f'git clone --branch ready {moved} src/lupin_greenhouse_ros' in text
    assert f'    url: {moved}\n' in text


@pytest.mark.parametrize('branch', ['main', 'gone'])
def test_another_default_branch_is_told_with_what_to_set(remote, publish, branch):
    git(remote, 'symbolic-ref', 'HEAD', f'refs/heads/{branch}')
    code, printed = publish()
    assert code == 0
    assert '\nmirror-publish: set the default branch of the remote to ready' in printed
    assert 'git symbolic-ref HEAD refs/heads/ready' in printed


@pytest.mark.parametrize(
    ('remote', 'address'),
    [
        ('git@github.com:group/sub/name.git', 'https://github.com/group/sub/name.git'),
        ('ssh://git@github.com/owner/name.git', 'https://github.com/owner/name.git'),
        ('ssh://git@github.com:22/owner/name.git', 'https://github.com/owner/name.git'),
        ('https://me:secret@github.com/owner/name', 'https://github.com/owner/name'),
    ],
)
def test_the_address_is_one_that_a_reader_can_clone(remote, address):
    assert mirror_publish.address_of(remote) == address


def test_ready_moves_with_main_only(repository, remote, publish):
    publish()
    first = refs(remote)
    change(repository, 'README.md')  # of this repository, not of the mirror
    assert publish() == (0, 'nothing to publish\n')
    change(repository)
    assert publish()[0] == 0
    second = refs(remote)
    parents = git(remote, 'show', '-s', '--format=%P', 'ready').split()
    assert parents == [first['refs/heads/ready'], second['refs/heads/main']]
    assert git(remote, 'rev-parse', 'main~1').strip() == first['refs/heads/main']
    assert 'COLCON_IGNORE' not in git(remote, 'ls-tree', '--name-only', 'ready')
    assert git(remote, 'show', 'ready:README.md').endswith('More.\n')


@pytest.mark.parametrize(
    ('branch', 'reason'),
    [
        ('main', 'main of the remote has commits that are not published from here: bring them in as patches'),
        ('ready', 'the branch ready has changes of its own: move them to main by a patch'),
    ],
)
def test_commits_of_others_are_not_overwritten(repository, remote, publish, branch, reason):
    publish()
    theirs = remote.parent / 'theirs'
    git(remote.parent, 'clone', '--quiet', '--branch', branch, str(remote), str(theirs))
    change(theirs, 'README.md', 'Their own.')
    git(theirs, 'push', '--quiet', 'origin', f'HEAD:{branch}')
    before = refs(remote)
    change(repository)
    code, printed = publish()
    assert (code, reason in printed) == (1, True), printed
    assert refs(remote) == before


@pytest.mark.parametrize(
    ('spoil', 'release', 'reason'),
    [
        (lambda folder: begin_changelogs_with(folder, 'Forthcoming'), VERSION, 'begins with Forthcoming: '),
        (lambda folder: change(folder, NODE), '', 'the trees are not what tools/core generates'),
        (lambda folder: edit(folder / README, '', 'x'), '', 'uncommitted changes: commit or stash them'),
        (lambda _: None, '9.9.9', f'lupin_greenhouse_msgs/package.xml has version {VERSION}\n'),
    ],
)
def test_a_spoiled_checkout_is_not_published(repository, remote, publish, spoil, release, reason):
    spoil(repository)
    code, printed = publish('--release', release)
    assert (code, reason in printed) == (1, True), printed
    assert refs(remote) == {}


@pytest.mark.parametrize(
    ('name', 'main'), [('generate', generate.main), ('mirror-publish', mirror_publish.main)]
)
def test_a_wrong_option_is_one_line(name, main, capsys):
    with pytest.raises(SystemExit) as ended:
        main(['nothere', '--dryrun'])
    assert ended.value.code == 2
    told = f'{name}: unrecognized arguments: (nothere )?--dryrun: see --help\n'
    assert re.fullmatch(told, capsys.readouterr().err)


def test_a_wrong_remote_and_a_shallow_clone_are_refused_in_one_line(repository, remote, publish, capsys):
    for name, reason in (
        ('', 'no remote: make'),
        ('https://host/OWNER/r.git', 'OWNER in REMOTE=https://host/OWNER/r.git is a placeholder: write who'),
        ('/nowhere', "REMOTE=/nowhere cannot be read: git ls-remote: fatal: '/nowhere' does"),
    ):
        code, printed = publish('--dry-run', to=name)
        assert (code, printed.count('\n'), printed.startswith(f'mirror-publish: {reason}')) == (1, 1, True)
    git(remote.parent, 'clone', '--quiet', '--depth=1', f'file://{repository}', 'shallow')
    assert mirror_publish.main([str(remote), '--root', str(remote.parent / 'shallow')]) == 1
    assert 'git fetch --unshallow' in capsys.readouterr().err


def test_the_marked_blocks_of_the_pages_are_followed_word_for_word():
    by_clone, by_vcs = mirror_publish_check.scripts(PAGES).values()
    assert 'read_tag 1' in by_clone
    assert '    version: ready\n' in by_vcs
    for page in PAGES:
        pages = [text.replace('followed by', 'x') if text is page else text for text in PAGES]
        with pytest.raises(generate.RefusedError, match=r'[12] bash blocks are marked'):
            mirror_publish_check.scripts(pages)
