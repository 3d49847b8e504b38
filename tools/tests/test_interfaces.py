"""Each interface on disk is built, and no other."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {'monorepo/lupin_msgs': 22, 'lupin_greenhouse_ros/lupin_greenhouse_msgs': 3}


@pytest.mark.parametrize('package', PACKAGES)
def test_cmake_lists_every_interface_on_disk_and_no_other(package):
    folder = ROOT / package
    on_disk = sorted(path.relative_to(folder).as_posix() for path in folder.glob('*/*.*'))
    listed = re.findall(r'^  "(\S+)"$', (folder / 'CMakeLists.txt').read_text(), re.MULTILINE)
    assert listed == on_disk
    assert len(listed) == PACKAGES[package]


@pytest.mark.parametrize('package', PACKAGES)
def test_every_package_that_an_interface_uses_is_declared(package):
    folder = ROOT / package
    fields = ''.join(path.read_text() for path in folder.glob('*/*.*'))
    used = set(re.findall(r'^([a-z_]+)/\w+', fields, re.MULTILINE))
    declared = re.search(r'DEPENDENCIES ([a-z_ ]+)', (folder / 'CMakeLists.txt').read_text())[1].split()
    assert used == set(declared)
    assert all(f'<depend>{package}</depend>' in (folder / 'package.xml').read_text() for package in used)
