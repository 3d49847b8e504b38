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
