"""What is committed: the entries of the top level that its owner named, and files without CR."""

from conftest import ROOT, succeed

ENTRIES = {'Makefile', 'README.md', 'ci', 'lupin_greenhouse_ros', 'monorepo', 'tools'}


def test_no_other_visible_entry_is_committed():
    listed = succeed('git', 'ls-tree', '--name-only', 'HEAD').splitlines()
    assert {name for name in listed if not name.startswith('.')} == ENTRIES


def test_a_clone_that_converts_line_ends_has_none_to_convert(tmp_path):
    """With core.autocrlf=true, which Git for Windows sets, bash would not read a script of its clone."""
    succeed('git', 'clone', '--quiet', '--config', 'core.autocrlf=true', ROOT, tmp_path / 'clone')
    listed = succeed('git', 'ls-files', '--eol', cwd=tmp_path / 'clone')
    assert 'w/lf' in listed
    assert [line for line in listed.splitlines() if 'w/crlf' in line or 'w/mixed' in line] == []
