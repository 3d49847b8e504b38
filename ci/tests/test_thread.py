"""The README's thread, as a user pastes it: drive, record, show."""

import json
import re
from pathlib import Path

import docs_check
import pytest
from conftest import ROOT, of_a_user, succeed
from lupin_greenhouse_bridge.display.input_file import read_file

BLOCK = 'make mission DRIVE=1 CAMERA=1 RECORD=readings.sqlite'


@pytest.mark.heavy
def test_the_thread_of_the_readme(copy):
    """What a mission reports, what is recorded beside it, and what the page shows are the same values."""
    (block,) = [
        text for _, _, text in docs_check.Document(ROOT, Path('README.md')).shell_blocks() if BLOCK in text
    ]
    printed = succeed('bash', '-c', f'set -e\n{block}', cwd=copy, env=of_a_user())
    (report,) = copy.glob('.mission/*.jsonl')
    reported = {row[:1] + row[2:5] for row in read_file(report).rows}
    recorded = read_file(copy / 'readings.sqlite').rows
    assert {row[:1] + row[2:5] for row in recorded} == reported
    assert f'{len(reported)} rows kept in readings.sqlite' in printed
    page = (copy / 'readings.html').read_text(encoding='utf-8')
    data = json.loads(
        re.search('<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)[1]
    )
    shown = {
        (tag['id'], sensor['name'].replace(' ', '_'), value)
        for tag in data['tags']
        for sensor, value in zip(data['sensors'], tag['values'], strict=True)
        if value is not None
    }
    assert shown == {(row.tag_id, row.sensor, row.value) for row in recorded}
    assert (copy / 'poses.png').stat().st_size > 0
    assert (copy / 'readings.png').stat().st_size > 0
