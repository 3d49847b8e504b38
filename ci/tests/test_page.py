"""The page of readings in a real browser, without a network."""

import contextlib
import json

import pytest
from browser import CHROMIUM, NO_CHROMIUM, Page
from lupin_greenhouse_bridge.display import readings_page
from lupin_greenhouse_bridge.recording.rows import Row, utc_of
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.units import label_of

pytestmark = pytest.mark.skipif(not CHROMIUM, reason=NO_CHROMIUM)
START_S = 1795190000
EVIL = '<img src=x onerror=alert(1)><script>alert(1)</script><b>&amp;'
POINTS = "document.querySelectorAll('#map .points path.point').length"
COLOURS = "[...document.querySelectorAll('#map .points path.point')].map(each => each.style.fill).join()"
TEXTS = "[...document.querySelectorAll('#map .textpoint')].map(each => each.textContent)"
PICK_NEXT = """
    const select = document.getElementById('sensor');
    select.selectedIndex += 1;
    select.dispatchEvent(new Event('change'));
"""
# Charts that are drawn wider than their place, and so cover the one beside them.
OVERLAPS = """[...document.querySelectorAll('.chart')].filter(
    each => each.querySelector('.main-svg').getBoundingClientRect().width > each.clientWidth).length"""
OPTIONS = "[...document.querySelectorAll('option')].map(each => each.textContent)"
SHOW_HOVER = "((curveNumber, pointNumber) => Plotly.Fx.hover('map', [{ curveNumber, pointNumber }]))"
HOVER = "document.querySelector('#map .hoverlayer').textContent"
SUM = 'match(/[0-9]+/g).slice(0, 3).reduce((sum, part) => sum + Number(part), 0)'
BACKGROUND = f'getComputedStyle(document.body).backgroundColor.{SUM}'
AXIS_TITLE = f"getComputedStyle(document.querySelector('#map .xtitle')).fill.{SUM}"
MIDDLE = 3 * 128  # between dark and light
CELLS = "[...document.querySelectorAll('tbody td:first-child')].map(each => each.textContent)"


def visit(number, tag_id, sensors, outcome='OK'):
    """Return a line of a mission's report."""
    is_read = outcome == 'OK'
    return json.dumps(
        {
            'tag_id': tag_id,
            'outcome': outcome,
            'detail': '' if is_read else EVIL,
            'attempts': 1,
            'stamp': {'sec': START_S + number, 'nanosec': 0} if is_read else None,
            'sim_time_of_day_seconds': 1800.0 * (number % 48) if is_read else None,
            'readings': dict.fromkeys(sensors, 20.0 + number) if is_read else None,
        }
    )


@pytest.fixture
def open_page():
    """Return a function that makes the page of a file and opens it; the browser ends with the test."""
    with contextlib.ExitStack() as stack:

        def make_and_open(path, *options, **size):
            assert readings_page.main([str(path), *options]) == 0
            return stack.enter_context(Page(path.with_suffix('.html'), **size))

        yield make_and_open


@pytest.fixture
def report(tmp_path):
    """Return the report of a mission that read every tag but two."""
    tags = find_layout('').tags
    lines = [
        visit(number, tag_id, tag.sensors, 'TIMEOUT' if number in (3, 4) else 'OK')
        for number, (tag_id, tag) in enumerate(tags.items())
    ]
    path = tmp_path / 'report.jsonl'
    path.write_text('\n'.join([*lines, '']), encoding='utf-8')
    return path


def test_the_page_shows_each_tag_and_asks_no_host_for_anything(report, open_page):
    page = open_page(report)
    assert page.complaints == []
    assert page.requests == [report.with_suffix('.html').as_uri()]
    assert page.evaluate(POINTS) == len(find_layout('').tags)
    assert sorted(page.evaluate(TEXTS)) == sorted(find_layout('').tags)
    before = page.evaluate(COLOURS)
    page.evaluate(PICK_NEXT)
    assert page.evaluate(POINTS) == len(find_layout('').tags)
    assert page.evaluate(COLOURS) != before
    assert page.evaluate(OVERLAPS) == 0
    assert page.complaints == []


def test_the_hover_text_of_a_tag_has_its_values_outcome_attempts_and_times(report, open_page):
    page = open_page(report)
    page.evaluate(f'{SHOW_HOVER}(3, 0)')
    tags = find_layout('').tags
    value = 20 + list(tags).index('1')
    lines = [f'{label_of(sensor)}: {value}' for sensor in tags['1'].sensors]
    hover = page.evaluate(HOVER)
    for fragment in ('tag 1: OK', *lines, '2026-11-2', 'greenhouse time', 'attempts: 1'):
        assert fragment in hover
    assert 'TIMEOUT' in page.evaluate("document.getElementById('map').data[4].hovertext[0]")


def test_the_page_fits_a_phone_and_follows_its_colour_scheme(report, open_page):
    page = open_page(report, width=360, height=740)
    for scheme, ground, text in (('light', '>', '<'), ('dark', '<', '>')):
        page.prefer(scheme)
        page.wait_for(f'{BACKGROUND} {ground} {MIDDLE} && {AXIS_TITLE} {text} {MIDDLE}')
        assert page.evaluate('document.documentElement.scrollWidth') == 360
    assert page.complaints == []


def test_what_a_file_holds_is_shown_as_text_and_never_run(tmp_path, open_page):
    path, tag_file = tmp_path / 'report.jsonl', tmp_path / 'tags.json'
    path.write_text(visit(0, EVIL, [EVIL]) + '\n', encoding='utf-8')
    tag_file.write_text(json.dumps({EVIL: {'x': 1, 'y': 2, 'sensors': ['co2']}}), encoding='utf-8')
    page = open_page(path, '--tag-file', str(tag_file))
    page.evaluate(f'{SHOW_HOVER}(3, 0)')
    for texts in (CELLS, TEXTS, OPTIONS, HOVER):
        assert EVIL in page.evaluate(texts)
    assert page.complaints == []
    assert page.requests == [path.with_suffix('.html').as_uri()]


def test_a_hundred_thousand_rows_open(tmp_path, open_page):
    path = tmp_path / 'day.sqlite'
    tags = list(find_layout('').tags)
    store = open_store(str(path))
    stamps = [(START_S + number) * 1_000_000_000 for number in range(100_000)]
    store.keep(
        [
            Row(ns, utc_of(ns), tags[n % 29], f's{n % 5}', n % 97, '', None, None, n % 86400, 'test')
            for n, ns in enumerate(stamps)
        ]
    )
    store.close()
    page = open_page(path)
    assert page.complaints == []
    assert 'of 20,000 values of s0' in page.evaluate("document.getElementById('notes').textContent")
    assert 0 < page.evaluate("document.querySelectorAll('.chart .points path.point').length") <= 20_000
