"""Copies of this repository and of the mirror, and the score of the drift checker."""

import shutil
from pathlib import Path

import pytest
from commits import git

ROOT = Path(__file__).resolve().parents[2]


def pytest_terminal_summary(terminalreporter):
    """Print the score of the drift checker's mutants."""
    results = {outcome: terminalreporter.stats.get(outcome, []) for outcome in ('passed', 'failed')}
    for test, text in (
        ('test_mutant', 'mutants of the trees reported'),
        ('test_harmless', 'harmless changes let pass'),
    ):
        good, bad = (sum(f'::{test}[' in report.nodeid for report in results[outcome]) for outcome in results)
        if good + bad:
            terminalreporter.write_line(f'check_drift: {good} of {good + bad} {text}')


@pytest.fixture(scope='session')
def packed_repositories(tmp_path_factory):
    """Return a folder with a copy of this repository, and a clone of the mirror split out of it."""
    folder = tmp_path_factory.mktemp('packed')
    monorepo = folder / 'repository'
    monorepo.mkdir()
    shutil.copy(ROOT / '.gitignore', monorepo)
    ignore = shutil.ignore_patterns('__pycache__', '.pytest_cache', '.hypothesis')
    for path in ROOT.glob('[!.]*'):
        if path.is_dir():
            shutil.copytree(path, monorepo / path.name, ignore=ignore)
        else:
            shutil.copy(path, monorepo)
    git(monorepo, 'init', '--quiet', '--initial-branch=main')
    git(monorepo, 'config', 'user.name', 'Teammate')
    git(monorepo, 'config', 'user.email', 'teammate@example.org')
    git(monorepo, 'add', '--all')
    git(monorepo, 'commit', '--quiet', '--message', 'Everything')
    git(monorepo, 'subtree', '-q', 'split', '--prefix=lupin_greenhouse_ros', '--branch', 'mirror')
    git(folder, 'clone', '--quiet', '--branch', 'mirror', f'file://{monorepo}', 'clone')
    git(monorepo, 'repack', '--quiet', '-a', '-d')  # one file is copied faster than hundreds
    return folder


@pytest.fixture
def repositories(packed_repositories, tmp_path):
    """Return a copy of this repository, and a clone of the mirror split out of it."""
    for name in ('repository', 'clone'):
        shutil.copytree(packed_repositories / name, tmp_path / name, symlinks=True)
    return tmp_path / 'repository', tmp_path / 'clone'
