"""colcon succeeds if it finds no tests, so count the tests that ran."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import ENVIRONMENTS


def results_of(tree):
    results = ENVIRONMENTS[tree] / 'workspace' / tree / 'build/lupin_greenhouse_bridge/pytest.xml'
    cases = ElementTree.parse(results).getroot().iter('testcase')
    return {(case.get('classname'), case.get('name')): case.find('skipped') is not None for case in cases}


@pytest.mark.parametrize('tree', ENVIRONMENTS)
def test_colcon_ran_the_contract_tests(tree):
    ran = [name for (name, _), is_skipped in results_of(tree).items() if not is_skipped]
    modules = {name.split('.')[-1] for name in ran}
    written = {path.stem for path in Path(tree, 'lupin_greenhouse_bridge/test').glob('test_*.py')}
    assert modules == written - {'test_launch'}  # runs where launch is installed


def test_both_trees_ran_the_same_tests():
    monorepo, mirror = map(results_of, ENVIRONMENTS)
    assert monorepo == mirror
