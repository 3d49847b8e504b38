"""Publish the mirror to a remote: no rewritten history, all or nothing, and twice is once."""

import re
from xml.etree import ElementTree

import generate
import mirror_publish
import pytest
from commits import git
from test_mirror_import import BRIDGE, LOG_MORE, NEW_TITLE, commit_in, import_patch

README = 'lupin_greenhouse_ros/README.md'
VERSION = ElementTree.parse(
    mirror_publish.ROOT / mirror_publish.MIRROR / 'lupin_greenhouse_bridge/package.xml'
).findtext('version')
REFS = ['refs/heads/main', 'refs/heads/ready']


@pytest.fixture
def remote(tmp_path):
    """Return an empty repository to publish to; like a host, it makes the first branch the default branch."""
    git(tmp_path, 'init', '--quiet', '--bare', '--initial-branch=ready', 'published.git')
    return tmp_path / 'published.git'


@pytest.fixture
def publish(repositories, remote, capsys):
    """Return a function that publishes the repository and returns exit code and output."""
    set_address(repositories[0], remote)

    def publish_to(*arguments: str, to=remote):
        code = mirror_publish.main([str(to), '--root', str(repositories[0]), *arguments])
        printed = capsys.readouterr()
        return code, printed.out.partition('only the allowed divergence\n')[2] + printed.err

    return publish_to


def set_address(folder, address):
    """Set the address of the mirror, generate and commit."""
    path = folder / 'tools/twins.toml'
    path.write_text(re.sub('(?<=^address = ).*', f'"{address}"', path.read_text(), flags=re.MULTILINE))
    assert generate.main(['--root', str(folder)]) == 0
    git(folder, 'commit', '--quiet', '--all', '--message', 'Set the address')


def change(folder, path=README, text='\nMore.\n', message='Change it'):
    """Commit a change of a file."""
    with (folder / path).open('a') as file:
        file.write(text)
    git(folder, 'add', '--all')
    git(folder, 'commit', '--quiet', '--message', message)


def finish_release(folder):
    """Give the entries since the last release, if there are any, this version."""
    paths = [folder / each for each in git(folder, 'ls-files', '*CHANGELOG.rst').splitlines()]
    heading = f'{VERSION} (2026-01-01)'
    for path in paths:
        path.write_text(
            path.read_text().replace('Forthcoming\n-----------', f'{heading}\n{"-" * len(heading)}')
        )
    if git(folder, 'status', '--porcelain'):
        change(folder)


def refs(remote) -> dict[str, str]:
    lines = git(remote, 'for-each-ref', '--format=%(refname) %(objectname)').splitlines()
    return dict(line.split() for line in lines)


def tree(folder, commit) -> str:
    return git(folder, 'rev-parse', f'{commit}^{{tree}}')


def test_main_is_the_mirror_and_ready_is_main_without_colcon_ignore(repositories, remote, publish):
    finish_release(repositories[0])
    code, printed = publish('--release', VERSION)
    assert code == 0, printed
    assert list(refs(remote)) == [*REFS, f'refs/tags/{VERSION}']
    assert tree(remote, 'main') == git(repositories[0], 'rev-parse', 'HEAD:lupin_greenhouse_ros')
    files = {
        name: git(remote, 'ls-tree', '-r', '--name-only', name).splitlines() for name in ('main', 'ready')
    }
    assert [name for name in files['main'] if name != 'COLCON_IGNORE'] == files['ready']
    assert git(remote, 'rev-parse', f'{VERSION}^{{commit}}') == git(remote, 'rev-parse', 'main')
    assert publish('--release', VERSION) == (0, 'nothing to publish\n')


def test_another_remote_than_that_of_the_address_is_refused_with_what_to_set(repositories, publish):
    other = repositories[0].parent / 'other.git'
    git(other.parent, 'init', '--quiet', '--bare', str(other))
    code, printed = publish(to=other)
    advice = (
        f'set address = "{other}" under [trees.mirror] in tools/twins.toml, run make generate, and commit\n'
    )
    assert code == 1
    assert printed.endswith(advice)
    assert refs(other) == {}
    code, printed = publish('--dry-run', to=other)
    assert (code, printed.count('would push')) == (0, 2)
    assert printed.endswith(advice)

    set_address(repositories[0], other)
    assert publish(to=other)[0] == 0
    text = git(other, 'show', 'ready:README.md')
    assert f'git clone --branch ready {other} src/lupin_greenhouse_ros' in text
    assert f'    url: {other}\n' in text


def test_a_repository_that_moved_keeps_its_history_and_gets_its_new_address(repositories, remote, publish):
    publish()
    moved = remote.parent / 'moved.git'
    git(remote.parent, 'clone', '--quiet', '--mirror', str(remote), str(moved))
    before = refs(moved)
    set_address(repositories[0], moved)
    assert publish(to=moved)[0] == 0
    assert git(moved, 'rev-parse', 'main~1').strip() == before['refs/heads/main']
    assert str(moved) in git(moved, 'show', 'main:README.md')


def test_a_clone_of_the_default_branch_has_no_colcon_ignore(remote, publish):
    """GitHub and GitLab make the first branch that they get the default branch."""
    hook = remote / 'hooks/post-receive'
    hook.write_text(
        '#!/bin/sh\n[ -e first ] || { read old new branch; git symbolic-ref HEAD $branch; touch first; }\n'
    )
    hook.chmod(0o755)
    git(remote, 'symbolic-ref', 'HEAD', 'refs/heads/other')
    assert publish()[0] == 0
    git(remote.parent, 'clone', '--quiet', str(remote), 'clone-of-a-team')
    clone = remote.parent / 'clone-of-a-team'
    assert not (clone / 'COLCON_IGNORE').exists()
    assert all((clone / package / 'package.xml').exists() for package in mirror_publish.PACKAGES)


@pytest.mark.parametrize('branch', ['main', 'gone'])
def test_another_default_branch_is_told_with_what_to_set(remote, publish, branch):
    git(remote, 'symbolic-ref', 'HEAD', f'refs/heads/{branch}')
    code, printed = publish()
    assert code == 0
    assert printed.splitlines()[-1].startswith(
        'mirror-publish: set the default branch of the remote to ready'
    )
    assert 'git symbolic-ref HEAD refs/heads/ready' in printed
    git(remote, 'symbolic-ref', 'HEAD', 'refs/heads/ready')
    assert publish() == (0, 'nothing to publish\n')


@pytest.mark.parametrize(
    ('remote', 'address'),
    [
        ('git@gitlab.com:group/sub/name.git', 'https://gitlab.com/group/sub/name.git'),
        ('ssh://git@github.com/owner/name.git', 'https://github.com/owner/name.git'),
        ('ssh://git@github.com:22/owner/name.git', 'https://github.com/owner/name.git'),
        ('git@git.example.org:owner/name.git', 'https://git.example.org/owner/name.git'),
        ('https://me:secret@gitlab.com/owner/name', 'https://gitlab.com/owner/name'),
        ('/srv/mirror.git', '/srv/mirror.git'),
    ],
)
def test_the_address_is_one_that_a_reader_can_clone(remote, address):
    assert mirror_publish.address_of(remote) == address


def test_a_dry_run_pushes_nothing(remote, publish):
    code, printed = publish('--dry-run')
    assert code == 0
    assert sorted(line.split()[2] for line in printed.splitlines()) == REFS
    assert all(line.startswith('would push') for line in printed.splitlines())
    assert refs(remote) == {}


def test_ready_moves_with_main_only(repositories, remote, publish):
    publish()
    first = refs(remote)
    change(repositories[0], 'README.md')  # of this repository, not of the mirror
    assert publish() == (0, 'nothing to publish\n')
    change(repositories[0])
    assert publish()[0] == 0
    second = refs(remote)
    parents = git(remote, 'show', '-s', '--format=%P', 'ready').split()
    assert parents == [first['refs/heads/ready'], second['refs/heads/main']]
    assert git(remote, 'rev-parse', 'main~1').strip() == first['refs/heads/main']
    assert 'COLCON_IGNORE' not in git(remote, 'ls-tree', '--name-only', 'ready')
    assert git(remote, 'show', 'ready:README.md').endswith('More.\n')


def commit_on(remote, branch):
    """Commit to a branch of the remote."""
    clone = remote.parent / f'clone-{branch}'
    git(remote.parent, 'clone', '--quiet', '--branch', branch, str(remote), str(clone))
    change(clone, 'README.md', message='Their own')
    git(clone, 'push', '--quiet', 'origin', f'HEAD:{branch}')


@pytest.mark.parametrize(
    ('branch', 'reason'),
    [
        ('main', 'main of the remote has commits that are not published from here: bring them in as patches'),
        ('ready', 'the branch ready has changes of its own: move them to main by a patch'),
    ],
)
def test_commits_of_others_are_not_overwritten(repositories, remote, publish, branch, reason):
    publish()
    commit_on(remote, branch)
    before = refs(remote)
    change(repositories[0])
    code, printed = publish()
    assert (code, reason in printed) == (1, True), printed
    assert refs(remote) == before


def spoil_generation(folder):
    change(folder, f'monorepo/{BRIDGE}/bridge_node.py', '\n# by hand\n')


def leave_uncommitted(folder):
    (folder / README).write_text('changed')


def begin_next_release(folder):
    finish_release(folder)
    path = folder / 'lupin_greenhouse_ros/lupin_greenhouse_msgs/CHANGELOG.rst'
    section = f'\n{VERSION} ('
    path.write_text(path.read_text().replace(section, f'\nForthcoming\n-----------\n* More.\n{section}', 1))
    change(folder)


@pytest.mark.parametrize(
    ('spoil', 'arguments', 'reason'),
    [
        (begin_next_release, ['--release', VERSION], 'begins with Forthcoming: give this section'),
        (spoil_generation, [], 'the trees are not what tools/core generates'),
        (leave_uncommitted, [], 'there are uncommitted changes: commit or stash them'),
        (None, ['--release', '9.9.9'], f'lupin_greenhouse_msgs/package.xml has version {VERSION}'),
    ],
    ids=['entries of the next release', 'not generated', 'uncommitted', 'another version'],
)
def test_a_spoiled_checkout_is_not_published(repositories, remote, publish, spoil, arguments, reason):
    if spoil:
        spoil(repositories[0])
    code, printed = publish(*arguments)
    assert (code, reason in printed) == (1, True), printed
    assert refs(remote) == {}


def test_a_release_is_not_moved(repositories, remote, publish):
    finish_release(repositories[0])
    publish('--release', VERSION)
    before = refs(remote)
    change(repositories[0])
    code, printed = publish('--release', VERSION)
    assert (code, 'choose another version' in printed) == (1, True), printed
    assert refs(remote) == before


@pytest.mark.usefixtures('publish')
def test_a_shallow_clone_is_not_published(repositories, remote, capsys):
    shallow = remote.parent / 'shallow'
    git(remote.parent, 'clone', '--quiet', '--depth=1', f'file://{repositories[0]}', str(shallow))
    assert mirror_publish.main([str(remote), '--root', str(shallow)]) == 1
    assert 'git fetch --unshallow' in capsys.readouterr().err


def test_a_wrong_remote_is_refused_in_one_line(repositories, capsys):
    for name in ('', 'nobody', '/nowhere/at/all'):
        assert mirror_publish.main([name, '--root', str(repositories[0])]) == 1
        assert capsys.readouterr().err.startswith('mirror-publish: ')


def test_an_imported_series_is_published_unchanged(repositories, remote, publish):
    """From a clone of the published mirror into the core by patches, and back."""
    publish()
    contributor = remote.parent / 'contributor'
    git(remote.parent, 'clone', '--quiet', str(remote), str(contributor))
    base = git(contributor, 'rev-parse', 'HEAD').strip()
    commit_in(contributor, LOG_MORE)
    commit_in(contributor, ('lupin_greenhouse_msgs/msg/SensorReading.msg', 'One simulated', 'A simulated'))
    (contributor / 'lupin_greenhouse_bridge/test/test_more.py').write_text(
        f'# {generate.HEADER}\n"""More."""\n'
    )
    commit_in(contributor, NEW_TITLE)
    series = git(contributor, 'format-patch', '--stdout', base)
    result = import_patch(repositories[0], series)
    assert result.returncode == 0, result.stderr
    assert publish()[0] == 0
    assert tree(remote, 'ready') == tree(contributor, 'HEAD')
    told = '--format=%an <%ae> %ad %s'
    assert git(remote, 'log', '--no-merges', told, f'{base}..ready') == git(
        contributor, 'log', told, f'{base}..HEAD'
    )
