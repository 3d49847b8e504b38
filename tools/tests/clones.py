"""Copies of this repository and of the mirror, and changes in them like another team's."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOBODY = {
    f'GIT_{who}_{what}': value
    for who in ('AUTHOR', 'COMMITTER')
    for what, value in (('NAME', 'Another Team'), ('EMAIL', 'another@example.org'))
}


def git(folder, *arguments):
    environment = {**os.environ, **NOBODY, 'GIT_CONFIG_GLOBAL': os.devnull}
    command = ['git', '-c', 'commit.gpgsign=false', *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, check=True, capture_output=True, text=True
    ).stdout


def edit(path, old, new):
    """Replace a text once; without an old text, add the new one at the end."""
    text = path.read_text() if path.exists() else ''
    assert old in text
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.replace(old, new, 1) if old else text + new)


def commit(folder, message='Change it'):
    git(folder, 'add', '--all')
    git(folder, 'commit', '--quiet', '--message', message)


def snapshot(folder):
    return {
        path: (path.stat().st_mtime_ns, path.stat().st_mode, path.read_bytes())
        for path in folder.rglob('*')
        if path.is_file() and '.git' not in path.relative_to(folder).parts
    }


@pytest.fixture(scope='session')
def packed_repositories(tmp_path_factory):
    """Return a folder with what the twin tools need of this repository, and a clone of the mirror."""
    folder = tmp_path_factory.mktemp('packed')
    repository = folder / 'repository'
    not_needed = shutil.ignore_patterns(
        *('.git', '.venv*', '.*cache', '.hypothesis', '__pycache__', '*.png', 'ci', 'draw', 'measure'),
        *('lupin_mission', 'lupin_simulation', 'lupin_tag_confirmation'),
    )
    shutil.copytree(ROOT, repository, ignore=not_needed)
    git(repository, 'init', '--quiet', '--initial-branch=main')
    git(repository, 'config', 'user.name', 'Teammate')
    git(repository, 'config', 'user.email', 'teammate@example.org')
    commit(repository, 'Everything')
    git(repository, 'subtree', '-q', 'split', '--prefix=lupin_greenhouse_ros', '--branch', 'mirror')
    git(folder, 'clone', '--quiet', '--branch', 'mirror', f'file://{repository}', 'clone')
    git(repository, 'repack', '--quiet', '-a', '-d')  # one file is copied faster than hundreds
    return folder


@pytest.fixture
def repository(packed_repositories, tmp_path):
    """Return a copy of this repository."""
    shutil.copytree(packed_repositories / 'repository', tmp_path / 'repository', symlinks=True)
    return tmp_path / 'repository'


@pytest.fixture
def repositories(repository, packed_repositories, tmp_path):
    """Return a copy of this repository, and a clone of the mirror split out of it."""
    shutil.copytree(packed_repositories / 'clone', tmp_path / 'clone', symlinks=True)
    return repository, tmp_path / 'clone'
