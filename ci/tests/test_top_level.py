"""The top level of the repository has the entries that its owner named, and no other."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ENTRIES = {'Makefile', 'README.md', 'ci', 'lupin_greenhouse_ros', 'monorepo', 'tools'}


def test_no_other_visible_entry_is_committed():
    listed = subprocess.run(
        ['git', 'ls-tree', '--name-only', 'HEAD'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert {name for name in listed.stdout.splitlines() if not name.startswith('.')} == ENTRIES


def test_a_clone_that_converts_line_ends_has_none_to_convert(tmp_path):
    """With core.autocrlf=true, which Git for Windows sets, bash would not read a script of its clone."""
    clone = ['git', 'clone', '--quiet', '--config', 'core.autocrlf=true', ROOT, tmp_path / 'clone']
    subprocess.run(clone, check=True)
    listed = subprocess.run(
        ['git', 'ls-files', '--eol'], cwd=tmp_path / 'clone', capture_output=True, text=True, check=True
    ).stdout
    assert 'w/lf' in listed
    assert [line for line in listed.splitlines() if 'w/crlf' in line or 'w/mixed' in line] == []
