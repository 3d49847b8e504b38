"""colcon succeeds if it finds no tests, so count the tests that ran."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import ENVIRONMENTS, NEED_LAUNCH

PACKAGES = [(tree, path.parent.name) for tree in ENVIRONMENTS for path in sorted(Path(tree).glob('*/test'))]


def results_of(tree, package='lupin_greenhouse_bridge'):
    results = ENVIRONMENTS[tree] / 'workspace' / tree / 'build' / package / 'pytest.xml'
    cases = ElementTree.parse(results).getroot().iter('testcase')
    return {(case.get('classname'), case.get('name')): case.find('skipped') is not None for case in cases}


@pytest.mark.parametrize(('tree', 'package'), PACKAGES)
def test_colcon_ran_every_test_and_skipped_none(tree, package):
    results = results_of(tree, package)
    modules = {part for name, _ in results for part in name.split('.') if part.startswith('test_')}
    written = {path.stem for path in Path(tree, package, 'test').glob('test_*.py')}
    assert modules - NEED_LAUNCH == written - NEED_LAUNCH
    assert [test for test, is_skipped in results.items() if is_skipped] == []


def test_both_trees_ran_the_same_tests():
    monorepo, mirror = map(results_of, ENVIRONMENTS)
    assert monorepo == mirror
