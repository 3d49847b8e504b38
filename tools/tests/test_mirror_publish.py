"""Publish the mirror to a remote: no rewritten history, all or nothing, and twice is once."""

import os
import re
import subprocess
from xml.etree import ElementTree

import generate
import mirror_publish
import pytest
from clones import ROOT, commit, edit, git
from test_mirror_import import BRIDGE, LOG_MORE, checks_pass, import_patch, patch_of

README = 'lupin_greenhouse_ros/README.md'
NODE = f'monorepo/{BRIDGE}/bridge_node.py'
MANIFEST = ROOT / 'lupin_greenhouse_ros/lupin_greenhouse_bridge/package.xml'
VERSION = ElementTree.parse(MANIFEST).findtext('version')
REFS = ['refs/heads/main', 'refs/heads/ready']
GPG = """#!/bin/sh
case "$*" in *--verify*) echo 'gpg: Good signature' >&2; exit 0;; esac
cat > /dev/null
printf '\\n[GNUPG:] SIG_CREATED \\n' >&2
printf -- '-----BEGIN PGP SIGNATURE-----\\n\\nx\\n-----END PGP SIGNATURE-----\\n'
"""


@pytest.fixture
def remote(tmp_path):
    """Return an empty repository to publish to."""
    git(tmp_path, 'init', '--quiet', '--bare', '--initial-branch=ready', 'published.git')
    return tmp_path / 'published.git'


@pytest.fixture
def publish(repository, remote, capsys):
    """Return a function that publishes the repository and returns exit code and output."""
    set_address(repository, remote)

    def publish_to(*arguments: str, to=remote):
        code = mirror_publish.main([str(to), '--root', str(repository), *arguments])
        printed = capsys.readouterr()
        told = printed.err.replace('mirror-publish: splitting the history of lupin_greenhouse_ros\n', '')
        return code, printed.out.partition('only the allowed divergence\n')[2] + told

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


def begin_changelogs_with(folder, section):
    """Put this in place of the heading of the newest section of each changelog, and commit."""
    for path in git(folder, 'ls-files', '*CHANGELOG.rst').splitlines():
        text = (folder / path).read_text()
        (folder / path).write_text(re.sub(r'^.+\n-+$', section, text, count=1, flags=re.MULTILINE))
    git(folder, 'commit', '--quiet', '--all', '--allow-empty', '--message', 'Change the heading')


def heading(text):
    return f'{text}\n{"-" * len(text)}'


def remove_sections(folder):
    """Leave no section in any changelog."""
    for path in git(folder, 'ls-files', '*CHANGELOG.rst').splitlines():
        (folder / path).write_text((folder / path).read_text().replace('---', '   '))
    git(folder, 'commit', '--quiet', '--all', '--message', 'Remove the sections')


def refs(remote) -> dict[str, str]:
    lines = git(remote, 'for-each-ref', '--format=%(refname) %(objectname)').splitlines()
    return dict(line.split() for line in lines)


def test_main_is_the_mirror_and_ready_is_main_without_colcon_ignore(repository, remote, publish):
    begin_changelogs_with(repository, heading(f'{VERSION} (2026-01-01)'))
    code, printed = publish('--dry-run')
    assert (code, refs(remote)) == (0, {})
    assert re.sub('[0-9a-f]{10}', 'COMMIT', printed) == ''.join(
        f'would push {ref} new -> COMMIT\n' for ref in REFS
    )
    code, printed = publish('--release', VERSION)
    assert code == 0, printed
    assert list(refs(remote)) == [*REFS, f'refs/tags/{VERSION}']
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
    assert (code, f'set address = "{moved}" under [trees.mirror] in tools/twins.toml' in printed) == (1, True)
    assert refs(moved) == before
    set_address(repository, moved)
    assert publish(to=moved)[0] == 0
    assert git(moved, 'rev-parse', 'main~1').strip() == before['refs/heads/main']
    text = git(moved, 'show', 'ready:README.md')
    assert f'\ngit clone --branch ready {moved} ~/lupin_ws/src/lupin_greenhouse_ros\n' in text


def test_the_first_publication_writes_the_address_to_be_committed(repository, remote, publish):
    set_address(repository, '')
    readme = (repository / README).read_text()
    assert '\ncp -r lupin_greenhouse_ros ~/lupin_ws/src/  # from a clone of the monorepo' in readme
    assert publish('--dry-run')[0] == 0
    assert git(repository, 'status', '--porcelain') == ''
    code, printed = publish()
    assert (code, f'now name {remote}. Commit them' in printed, refs(remote)) == (1, True, {}), printed
    assert f'\ngit clone --branch ready {remote} ~/lupin_ws' in (repository / README).read_text()
    commit(repository)
    assert publish()[0] == 0


@pytest.mark.parametrize(
    ('remote', 'address'),
    [
        ('git@github.com:owner/name.git', 'https://github.com/owner/name'),
        ('ssh://git@github.com/owner/name.git', 'https://github.com/owner/name'),
        ('ssh://git@github.com:22/owner/name.git', 'https://github.com/owner/name'),
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


def test_a_maintainer_who_signs_and_shows_signatures_publishes_too(repository, remote, publish, tmp_path):
    gpg = tmp_path / 'gpg'
    gpg.write_text(GPG)
    gpg.chmod(0o755)
    for name, value in (('gpg.program', str(gpg)), ('log.showSignature', 'true')):
        git(repository, 'config', name, value)
    for path in (README, 'README.md'):
        edit(repository / path, '', '\nMore.\n')
        git(repository, '-c', 'commit.gpgsign=true', 'commit', '--quiet', '--all', '--message', 'Sign it')
        assert 'Good signature' in git(repository, 'log', '-1')
        code, printed = publish()
        assert code == 0, printed
    assert git(remote, 'rev-parse', 'main^{tree}') == git(
        repository, 'rev-parse', 'HEAD:lupin_greenhouse_ros'
    )


@pytest.mark.parametrize(
    ('branch', 'reason'),
    [
        ('main', 'main on the remote has commits that are not in this repository: import them first'),
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
        (
            lambda folder: begin_changelogs_with(folder, heading('Forthcoming')),
            VERSION,
            'must begin with a section',
        ),
        (remove_sections, VERSION, f'must begin with a section {VERSION} (YYYY-MM-DD)\n'),
        (lambda folder: change(folder, NODE), '', 'the trees are not what tools/core generates'),
        (lambda folder: edit(folder / README, '', 'x'), '', 'uncommitted changes: commit or stash them'),
        (lambda _: None, '9.9.9', 'lupin_greenhouse_msgs/package.xml: must have version 9.9.9\n'),
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


def test_a_remote_that_is_not_there_and_a_shallow_clone_are_refused(repository, remote, publish, capsys):
    set_address(repository, '/nowhere')
    code, printed = publish(to='/nowhere')
    assert (code, printed.startswith("mirror-publish: git ls-remote: fatal: '/nowhere' does")) == (1, True)
    git(remote.parent, 'clone', '--quiet', '--depth=1', f'file://{repository}', 'shallow')
    assert mirror_publish.main([str(remote), '--root', str(remote.parent / 'shallow')]) == 1
    assert 'git fetch --unshallow' in capsys.readouterr().err


@pytest.mark.heavy
def test_the_mirror_goes_out_builds_in_another_workspace_and_comes_back(
    repository, remote, publish, tmp_path
):
    assert publish()[0] == 0
    clone = tmp_path / 'workspace/src/lupin_greenhouse_ros'
    git(tmp_path, 'clone', '--quiet', '--branch', 'ready', str(remote), str(clone))
    build = f"""source '{ROOT}/ci/ros_env.bash' without-overlay
        cd '{tmp_path}/workspace'
        python -m colcon build
        source install/local_setup.bash
        install/lupin_greenhouse_bridge/lib/lupin_greenhouse_bridge/bridge_node --help"""
    environment = {**os.environ, 'VENV': os.environ['VIRTUAL_ENV']}
    command = ['timeout', '10m', 'bash', '-ec', build]
    built = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    assert 'Summary: 2 packages finished' in built.stdout

    imported = import_patch(repository, patch_of(clone, LOG_MORE))
    assert imported.returncode == 0, imported.stderr
    assert checks_pass(repository)
    assert publish()[0] == 0
    assert git(remote, 'show', f'main:{LOG_MORE[0]}') == (clone / LOG_MORE[0]).read_text()
