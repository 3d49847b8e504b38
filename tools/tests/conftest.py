"""Make the tools importable."""

import shutil
import sys
from pathlib import Path

import pytest
from commits import git

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'tools'))


def pytest_terminal_summary(terminalreporter):
    """Print the score of the drift checker's mutants."""
    results = {outcome: terminalreporter.stats.get(outcome, []) for outcome in ('passed', 'failed')}
    for test, text in (
        ('test_mutant', 'mutants of the trees reported'),
        ('test_harmless', 'harmless changes let pass'),
    ):
        good, bad = (sum(f'::{test}[' in each.nodeid for each in results[outcome]) for outcome in results)
        if good + bad:
            terminalreporter.write_line(f'check_drift: {good} of {good + bad} {text}')


@pytest.fixture
def repositories(tmp_path):
    """Return a copy of this repository, and a clone of the mirror split out of it."""
    monorepo, mirror = tmp_path / 'repository', tmp_path / 'clone'
    ignore = shutil.ignore_patterns('.venv*', '.git', '__pycache__', '.pytest_cache', '.hypothesis')
    shutil.copytree(ROOT, monorepo, ignore=ignore)
    git(monorepo, 'init', '--quiet', '--initial-branch=main')
    git(monorepo, 'config', 'user.name', 'Teammate')
    git(monorepo, 'config', 'user.email', 'teammate@example.org')
    git(monorepo, 'add', '--all')
    git(monorepo, 'commit', '--quiet', '--message', 'Everything')
    git(monorepo, 'subtree', '-q', 'split', '--prefix=lupin_greenhouse_ros', '--branch', 'mirror')
    git(tmp_path, 'clone', '--quiet', '--branch', 'mirror', str(monorepo), str(mirror))
    return monorepo, mirror
