"""The pages that a reader pastes from first to last block: the README, the tutorial, the course."""

import json
import re

import pytest
from checkout import USE_WHAT_IS_BUILT, of_a_user, shell_blocks_of, succeed
from lupin_greenhouse_bridge.units import name_of
from lupin_readings.reading_file import read_file

pytestmark = pytest.mark.heavy
PAGES = 'tools/core/lupin_greenhouse_bridge/doc'
THREAD = 'make mission DRIVE=1 CAMERA=1 RECORD=readings.sqlite'


def without_noise(text: str) -> str:
    """Return a text without noisy values: on a busy machine, a repeated request takes the next noise."""
    return re.sub(r'(co2|humidity|soil_moisture) +[0-9.]+', r'\1', text)


def test_the_tutorial(copy, open_shell):
    """Its `make run` goes to the first shell, in place of the last one, and all the rest to the second."""
    first, second = open_shell(), open_shell()
    for mark, language, block in shell_blocks_of('monorepo/tutorial.md'):
        assert mark.endswith('::test_the_tutorial')
        if block.startswith('make run'):
            first.close()
            first = open_shell()
            first.paste(block)
            first.read_until('ready: ')
        elif language == 'console':
            for each in block.removeprefix('$ ').split('\n$ '):
                command, _, shown = each.partition('\n')
                printed = second.run(f'{command} || true')  # which may fail
                assert without_noise(shown).strip() in without_noise(printed), printed
        else:
            second.run(block)
    readings = read_file(copy / 'my_readings.sqlite').rows
    assert sorted(row.tag_id for row in readings) == ['1', '1', '2', '3']
    for name in ('my_poses.png', 'my_readings.html'):
        assert (copy / name).stat().st_size > 0


def test_the_course(open_shell):
    """A bridge with the seed of a team has the team's values."""
    shell = open_shell()
    (compare,) = [text for mark, _, text in shell_blocks_of(f'{PAGES}/README.md') if mark]
    assert 'team 2 has the values of its seed' in shell.run(f'source ci/ros_env.bash\n{compare}')
    values = shell.run('cat my_team2.csv')
    assert re.findall(r'^(\d,\w+),', values, re.MULTILINE)[:2] == ['1,temperature', '1,co2'], values


def test_the_thread_of_the_readme(copy):
    """A mission drives to every tag; its report, its record and its page have the same values."""
    (block,) = [text for _, _, text in shell_blocks_of('README.md') if THREAD in text]
    printed = succeed('bash', '-c', f'set -e\n{USE_WHAT_IS_BUILT}\n{block}', cwd=copy, env=of_a_user())
    assert '29/29 tags read' in printed.splitlines()
    (report,) = copy.glob('.mission/*.jsonl')
    assert len(report.with_name(f'{report.stem}-route.csv').read_text().splitlines()) > 29
    assert report.with_suffix('.html').exists()
    reported = {row[:1] + row[2:5] for row in read_file(report).rows}
    recorded = read_file(copy / 'readings.sqlite').rows
    assert {row[:1] + row[2:5] for row in recorded} == reported
    assert f'{len(reported)} rows kept' in printed
    page = (copy / 'readings.html').read_text(encoding='utf-8')
    found = re.search('<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)[1]
    data = json.loads(found)
    shown = {
        (tag['id'], sensor['name'], value)
        for tag in data['tags']
        for sensor, value in zip(data['sensors'], tag['values'], strict=True)
        if value is not None
    }
    assert shown == {(row.tag_id, name_of(row.sensor), row.value) for row in recorded}
    assert (copy / 'poses.png').stat().st_size > 0
