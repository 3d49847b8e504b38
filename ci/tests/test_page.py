"""The page of readings in a real browser, without a network."""

import io
import json
import re
import shutil
from importlib import resources

import numpy as np
import pytest
from lupin_greenhouse_bridge.simulator.layout import find_layout
from lupin_greenhouse_bridge.units import UNITS, name_of, value_text
from lupin_readings import readings_page
from lupin_readings.rows import Row, utc_of
from lupin_readings.store import Store
from PIL import Image, ImageColor
from playwright.sync_api import sync_playwright

CHROMIUM = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), '')
NO_CHROMIUM = 'Chromium is missing, which opens the page of readings: sudo apt install chromium'
pytestmark = [pytest.mark.heavy, pytest.mark.skipif(not CHROMIUM, reason=NO_CHROMIUM)]
START_S = 1795190000
EVIL = '<img src=x onerror=alert(1)><script>alert(1)</script><b>&amp;'
AXE = resources.files('axe_playwright_python') / 'axe.min.js'
COLOURS = "[...document.querySelectorAll('#map .dot')].map(each => each.getAttribute('fill')).join()"
NAMES = "[...document.querySelectorAll('#map a > title')].map(each => each.textContent)"
LABELS = "[...document.querySelectorAll('#map tspan:first-child')].map(each => each.textContent)"
RINGED = "[...document.querySelectorAll('#map .extreme')].map(each => each.parentNode.dataset.tag)"
CELLS = "[...document.querySelectorAll('tbody tr > :first-child')].map(each => each.textContent)"
TABS = "[...document.querySelectorAll('[role=tab] > b')].map(each => each.textContent)"
SCALE = "[...document.querySelectorAll('figure text[text-anchor=end]')].map(each => each.textContent)"
BAR = "[...document.querySelectorAll('#bar span')].map(each => each.textContent)"
TICKS_UP = SCALE.replace('figure', 'figure:nth-child(2)')
TIMES = SCALE.replace('end', 'middle')
CLICK = "dispatchEvent(new MouseEvent('click', { bubbles: true, cancelable: true }))"
LINES = "document.querySelectorAll('.series').length"
HEAD = "document.getElementById('title').textContent"
CHOSEN = """[...document.querySelectorAll('.chosen')].map(
    each => each.dataset.tag ?? each.firstChild.textContent)"""


def pairs(texts: str, others: str, across: float, down: float) -> str:
    """Return JavaScript for each text and other thing, of two tags, whose boxes share more pixels."""
    return f"""
        [...document.querySelectorAll('{texts}')].flatMap(text => {{
            const a = text.getBoundingClientRect(), own = text.closest('[data-tag]').dataset.tag;
            return [...document.querySelectorAll('{others}')].flatMap(other => {{
                const b = other.getBoundingClientRect(), tag = other.closest('[data-tag]').dataset.tag;
                const is_near = Math.min(a.right, b.right) - Math.max(a.left, b.left) > {across}
                    && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > {down};
                return tag !== own && a.width && b.width && is_near ? `${{own}} ${{tag}}` : [];
            }});
        }})"""


THINGS = '#map a > text, #map a > .dot'
COVERED = pairs(THINGS, THINGS, 1, 1)
CLOSE = pairs('#map a > text.muted', THINGS, -7.5, 4)  # an id without a value that looks like part of another
ONE_TEXT = pairs('#map a > text', '#map a > text', -12, 4)  # two labels on a line that read as one
# Each label of the map, or the tag of a line to one, that the route runs through.
ON_ROUTE = """
[...document.querySelectorAll('#map text.halo, #map .leader')].filter(each => {
    const route = document.querySelector('#map .route'), { x, y, width, height } = each.getBBox();
    const points = path => Array.from({ length: path.getTotalLength() }, (_, n) => path.getPointAtLength(n));
    return each.localName === 'line' ? points(each).some(point => route.isPointInStroke(point))
        : points(route).some(at => at.x > x && at.x < x + width && at.y > y + 3 && at.y < y + height - 3);
}).map(each => each.textContent || each.parentNode.dataset.tag)
"""
COVERED_IN_CHARTS = pairs('.series text', '.series text, .series circle', 1, 4)
# Each label that is nearer to the middle of a stop, or of another dot if it has no line to its own.
MISREAD = """
[...document.querySelectorAll('#map a')].flatMap(group => {
    const { left, right, top, bottom } = group.querySelector('text').getBoundingClientRect();
    const gap = dot => {
        const box = dot.getBoundingClientRect();
        const x = (box.left + box.right) / 2, y = (box.top + box.bottom) / 2;
        return Math.hypot(Math.max(left - x, 0, x - right), Math.max(top - y, 0, y - bottom));
    };
    const own = gap(group.querySelector('.dot')), nearer = dot => gap(dot) < own - 3;
    const others = group.querySelector('.leader') ? '#map .stop' : '#map .dot, #map .stop';
    return [...document.querySelectorAll(others)].some(nearer) ? group.dataset.tag : [];
})
"""
WITHOUT_LABEL = "[...document.querySelectorAll('.spare')].map(each => each.textContent)"
# Each piece of a line that is cut off at the left, as the dots between the pieces are.
CUT_PIECES = """
[...document.querySelectorAll('.pieces > span > span')].filter(each => {
    const line = each.closest('.pieces'), em = parseFloat(getComputedStyle(line).fontSize);
    const start = line.getBoundingClientRect().left + 0.9 * em;
    return [...each.getClientRects()].some(box => box.left < start - 1 || box.right > innerWidth);
}).map(each => each.textContent)
"""
# Elements that reach over the edge of the window, or of the box that would cut them.
CUT = """
[...document.querySelectorAll('th, td, h1, button, figure text')].filter(each => {
    const box = each.getBoundingClientRect(), frame = each.closest('.scroll');
    const right = frame ? frame.getBoundingClientRect().left + frame.scrollWidth : innerWidth;
    return box.left < -1 || box.right > right + 1
        || (frame && each.scrollWidth > each.clientWidth + 1);
}).map(each => each.textContent)
"""
# Each text of a card that reaches over its padding.
BEYOND_CARD = """
[...document.querySelectorAll('#tabs button :is(b, span)')].filter(each => {
    const card = each.closest('button'), text = document.createRange();
    text.selectNodeContents(each);
    const { width, right } = text.getBoundingClientRect(), padding = getComputedStyle(card).paddingRight;
    return width && right > card.getBoundingClientRect().right - parseFloat(padding);
}).map(each => each.textContent)
"""
# Each row of the phone's table with a cell that is cut, covered, without its unit or not in the middle.
BAD_ROWS = """
[...document.querySelectorAll('#table tr')].filter(row => {
    const box_of = each => each.getBoundingClientRect(), frame = box_of(row);
    const cells = [...row.children].map(each => [each, box_of(each)]).filter(([, box]) => box.width);
    const middle = Math.min(...cells.map(([, a]) => a.top)) + Math.max(...cells.map(([, a]) => a.bottom));
    return cells.some(([cell, a], number) => a.left < 0 || a.right > innerWidth
        || !getComputedStyle(cell, '::after').content.includes(cell.dataset.unit ?? 'none')
        || Math.abs(middle - frame.top - frame.bottom) > 3
        || cells.slice(number + 1).some(([, b]) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
            && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1));
}).map(row => row.innerText)
"""
BOXES = """
Object.fromEntries(['h1', '#failures', '#file span', '#file > :last-child', '#bar', '#map', '#map .wall',
    '.maps', '#table', '.scroll', 'table', '#charts']
    .map(name => [name, document.querySelector(name).getBoundingClientRect().toJSON()]))
"""
SMALLEST_TARGET = """
Math.min(...[...document.querySelectorAll('#tabs button, select, label, #chosen button')]
    .map(each => each.offsetHeight))
"""
GROUNDS = "new Set([...document.querySelectorAll('.bench')].map(each => getComputedStyle(each).fill)).size"
# The middle of the colours' bar, and of the first dot with a colour.
MIDDLES = """
['#bar i', '#map .value'].map(name => document.querySelector(name).getBoundingClientRect()).map(
    ({ x, y, width, height }) => [x + width / 2, y + height / 2])"""
IS_DRAWN = """
[...document.querySelectorAll('#map, .charting')].every(
    each => Math.abs(each.clientWidth - each.firstChild.clientWidth) < 3)
"""
CHART_SHARES = """
[...document.querySelectorAll('.bar, .charting')].map(
    each => each.clientWidth / document.querySelector('#charts').clientWidth)"""
TICKS = """
[...document.querySelectorAll('.charting')].map(chart =>
    [...chart.querySelectorAll('text[text-anchor=middle].muted')].map(each => each.getAttribute('x')))"""
COLOURS_OF_SCHEME = """
Object.fromEntries(['text', 'muted', 'bad', 'accent', 'page', 'chosen', 'table'].map(name =>
    [name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`)]))
"""
LEAST_CONTRAST = 4.5  # of WCAG 2.2, level AA
PRESS = 'document.activeElement.dispatchEvent(new KeyboardEvent("keydown", {{ key: "{}", bubbles: true }}))'


def visit(number, tag_id, sensors, outcome='OK'):
    """Return a line of a mission's report."""
    found = {'tag_id': tag_id, 'outcome': outcome, 'detail': EVIL, 'attempts': 1, 'goal': [0.9, 1.0 + number]}
    found |= dict.fromkeys(('stamp', 'sim_time_of_day_seconds', 'readings'))
    if outcome == 'OK':
        found |= {'detail': '', 'stamp': {'sec': START_S + number, 'nanosec': 0}}
        found['sim_time_of_day_seconds'] = 1800.0 * (number % 48)
        found['readings'] = dict.fromkeys(sensors, 20.0 + number)
    return json.dumps(found)


@pytest.fixture(scope='module')
def browser():
    """Return the browser of all tests."""
    with sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=CHROMIUM)


@pytest.fixture
def open_page(browser):
    """
    Return a function that makes the page of a file and opens it.

    At the end, no page and no console may have said anything, and no page may have asked for another file.
    """
    complaints = []

    def make_and_open(path, *options, width=1280, height=900):
        assert readings_page.main([str(path), *options]) == 0
        page = browser.new_page(viewport={'width': width, 'height': height}, is_mobile=width < 600)
        page.complaints = complaints
        for event in ('console', 'pageerror'):
            page.on(event, lambda found: complaints.append(str(found)))
        uri = path.with_suffix('.html').as_uri()
        page.on('request', lambda asked: asked.url.startswith(uri) or complaints.append(asked.url))
        page.goto(uri)
        return page

    yield make_and_open
    for context in browser.contexts:
        context.close()
    assert complaints == []


def wait_for(page, condition: str) -> None:
    """Wait until JavaScript is true; Playwright's own way to wait needs what the page forbids, eval()."""
    look = f'const look = () => {condition} ? done() : requestAnimationFrame(look); look();'
    page.evaluate(f'new Promise(done => {{ {look} }})')


@pytest.fixture
def report(tmp_path):
    """Return the report of a mission that read every tag but two."""
    tags = find_layout('').tags
    path = tmp_path / 'report.jsonl'
    with path.open('w', encoding='utf-8') as file:
        for number, (tag_id, tag) in enumerate(tags.items()):
            print(visit(number, tag_id, tag.sensors, 'TIMEOUT' if number in (3, 4) else 'OK'), file=file)
    return path


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours such as #fff, as WCAG 2.2 defines it."""
    parts = np.array([ImageColor.getrgb(each.strip()) for each in (one, other)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    low, high = sorted(linear @ [0.2126, 0.7152, 0.0722])
    return float((high + 0.05) / (low + 0.05))


def test_the_page_shows_each_tag_and_asks_no_host_for_anything(report, open_page):
    page, tags = open_page(report, width=1400), find_layout('').tags
    failed = list(tags)[3:5]
    assert re.fullmatch(r'Simulated.readings, .*.to.*.UTC.\(28.s\)', page.evaluate(HEAD))
    counts = page.evaluate("document.getElementById('counts').textContent")
    assert counts == f'{len(tags) - 2} of {len(tags)} tags read · 2 timeout'
    facts = page.evaluate("document.getElementById('file').textContent")
    assert facts.endswith(' · greenhouse 00:00 to 14:00')
    assert sorted(page.evaluate(LABELS)) == sorted(tags)
    assert page.evaluate("document.querySelectorAll('#map circle.unreached').length") == len(failed)
    assert page.evaluate(COVERED_IN_CHARTS) == page.evaluate(CUT) == []
    read = [tag for tag_id, tag in tags.items() if tag_id not in failed]
    assert page.evaluate(LINES) == sum(len(tag.sensors) for tag in read)
    (name,) = [each for each in page.evaluate(NAMES) if each.startswith('tag 1:')]
    values = [f'{name_of(each)} {value_text(each, 20 + list(tags).index("1"))}' for each in tags['1'].sensors]
    for fragment in ('tag 1: read', *values, 'greenhouse '):
        assert fragment in name
    assert f'tag {failed[0]}: timeout ({EVIL})' in page.evaluate(NAMES)
    # The shipped config has no higher temperature than 30.0.
    hot = [each for n, each in enumerate(tags) if 'temperature' in tags[each].sensors and 20 + n > 30.0]
    labels = page.evaluate("[...document.querySelectorAll('#map a > text')].map(each => each.textContent)")
    assert sorted(text.partition(':')[0] for text in labels if '▲' in text) == sorted(hot)
    assert not any('▼' in text for text in labels)
    assert f'scale: {len(hot)}' in page.evaluate("document.getElementById('key').textContent")
    script = "Object.assign(document.createElement('script'), { textContent: 'window.ran = 1' })"
    page.evaluate(f'document.body.append({script})')  # which is not the page's own
    assert page.evaluate('window.ran') is None
    assert 'Content Security Policy' in page.complaints.pop()


def test_a_sensor_is_chosen_by_its_tab_with_mouse_and_keys(report, open_page):
    page = open_page(report)
    assert page.evaluate(TABS) == ['temperature', 'humidity', 'CO₂', 'light', 'soil moisture']
    before = page.evaluate(COLOURS)
    page.evaluate("document.querySelectorAll('[role=tab]')[2].click()")
    assert page.evaluate("document.getElementById('shown').textContent") == 'CO₂ (ppm)'
    assert page.evaluate(COLOURS) != before
    named = page.evaluate("document.getElementById('extremes').textContent")
    ringed = page.evaluate(RINGED)
    assert sorted(re.findall(r'at tag (\w+)', named)) == sorted(ringed)
    assert len(ringed) == 2
    page.evaluate("document.querySelectorAll('[role=tab]')[2].focus()")
    page.evaluate(PRESS.format('ArrowRight'))
    assert page.evaluate('document.activeElement.firstChild.textContent') == 'light'
    assert page.evaluate("document.querySelector('[aria-selected=true] > b').textContent") == 'light'
    page.evaluate("document.querySelectorAll('[role=tab]')[1].click()")  # humidity
    assert page.evaluate(BAR) == page.evaluate(TICKS_UP)


def test_a_tag_that_is_chosen_anywhere_is_chosen_everywhere(report, open_page):
    page, sensors = open_page(report), find_layout('').tags['5'].sensors
    for act in (
        "location.hash = '#tag=5'",
        f"""document.querySelector('#map a[data-tag="5"]').{CLICK}""",
        "[...document.querySelectorAll('tbody a')].find(each => each.textContent === '5').click()",
    ):
        page.evaluate(act)
        wait_for(page, f'{CHOSEN}.length > 0')
        assert page.evaluate(CHOSEN) == ['5'] * (2 + len(sensors))  # in the map, the table and its charts
        facts = page.evaluate("document.getElementById('chosen').textContent")
        assert facts.startswith('tag 5: read · temperature ')
        page.evaluate("document.querySelectorAll('[name=clock]')[1].click()")
        assert len(page.evaluate(CHOSEN)) == 2 + len(sensors)
        page.evaluate(PRESS.format('Escape'))
        assert page.evaluate(CHOSEN) == []


def test_the_arrow_keys_choose_the_next_tag_of_the_map_and_keep_the_focus(report, open_page):
    page, focused = open_page(report), 'document.activeElement.dataset.tag'
    page.evaluate('document.querySelector(\'#map a[tabindex="0"]\').focus()')
    first = page.evaluate(focused)
    page.evaluate(PRESS.format('ArrowRight'))
    page.evaluate(PRESS.format('ArrowRight'))
    chosen, cells = page.evaluate(focused), page.evaluate(CELLS)
    assert cells.index(chosen) == cells.index(first) + 2
    assert page.evaluate("document.querySelector('tr.chosen').firstChild.textContent") == chosen
    page.evaluate('document.querySelector(\'#map a[data-tag="5"]\').focus()')
    page.evaluate(f'document.activeElement.{CLICK}')  # as Enter does
    wait_for(page, f"{CHOSEN}.includes('5')")
    assert page.evaluate(focused) == '5'


def test_one_value_is_told_once_on_an_axis_of_its_decimals_and_has_a_colour(tmp_path, open_page):
    path = tmp_path / 'report.jsonl'
    path.write_text(visit(0, '5', ['temperature']) + '\n', encoding='utf-8')
    page = open_page(path)
    assert page.evaluate("document.getElementById('extremes').textContent") == 'ringed: 20.0\xa0°C at tag 5'
    assert page.evaluate("document.querySelector('#tabs button > span').textContent") == '20.0\xa0°C'
    assert ' to ' not in page.evaluate(HEAD)
    assert page.evaluate(SCALE) == ['19.6', '19.8', '20.0', '20.2', '20.4']
    # A sensor without a range in the config, and a value beside which 0.5 is nothing.
    path.write_text(visit(0, '1', ['ph']).replace('20.0', '1e17') + '\n', encoding='utf-8')
    page = open_page(path)
    assert page.evaluate(COLOURS).startswith('#21918c')  # the middle of viridis
    page.emulate_media(color_scheme='dark')
    shot = Image.open(io.BytesIO(page.screenshot(full_page=True))).convert('RGB')
    bar, dot = (shot.getpixel(tuple(at)) for at in page.evaluate(MIDDLES))
    assert dot == pytest.approx(bar, abs=3)
    assert min(dot) > 0x21 + 40  # lighter, on the dark page
    path.write_text(visit(0, '1', [], 'TIMEOUT') + '\n', encoding='utf-8')
    boxes = open_page(path).evaluate(BOXES)
    assert boxes['#bar']['height'] == boxes['#charts']['height'] == 0


@pytest.mark.parametrize(('seconds', 'ends'), [(1, []), (2, ['23:30', '01:00'])])
def test_readings_of_one_moment_have_no_charts_and_midnight_does_not_divide_others(
    tmp_path, open_page, seconds, ends
):
    path = tmp_path / 'report.jsonl'
    visits = visit(0, '5', ['temperature']), visit(seconds, '1', ['temperature'])
    path.write_text('\n'.join(visits).replace('": 0.0', '": 84600.0'), encoding='utf-8')
    page = open_page(path)
    page.evaluate("document.querySelectorAll('[name=clock]')[1].click()")
    shown = page.evaluate(f"document.getElementById('charts').offsetHeight && {TIMES}")
    times = [text for text in shown or [] if re.fullmatch(r'\d\d:\d\d', text)]
    assert times[:1] + times[-1:] == ends


def test_the_table_sorts_by_a_column_with_failures_first(report, open_page):
    page, tags = open_page(report), find_layout('').tags
    failed = {list(tags)[3], list(tags)[4]}
    assert page.evaluate("document.querySelector('thead th').ariaSort") == 'ascending'
    page.evaluate("document.querySelectorAll('thead button')[1].click()")
    page.evaluate("document.querySelectorAll('thead button')[1].click()")
    assert page.evaluate("document.querySelectorAll('thead th')[1].ariaSort") == 'descending'
    cells = page.evaluate(CELLS)
    warm = [name for name, tag in tags.items() if 'temperature' in tag.sensors and name not in failed]
    assert set(cells[:2]) == failed
    assert cells[2 : 2 + len(warm)] == warm[::-1]
    reasons = page.evaluate("[...document.querySelectorAll('td[colspan]')].map(each => each.textContent)")
    assert reasons == [f'timeout: {name_of(tags[each].sensors[0])} not read' for each in cells[:2]]
    assert page.evaluate("document.querySelector('table').innerText").split().count('read') == 2


@pytest.mark.parametrize('do_differ', [True, False])
def test_the_attempts_and_the_times_are_told_if_they_differ(report, open_page, do_differ):
    text = report.read_text(encoding='utf-8').replace('"attempts": 1', f'"attempts": {2 + do_differ}', 1)
    text = text.replace('"attempts": 1', '"attempts": 2')
    one_time = re.sub(r'(_seconds": )[0-9.]+', r'\g<1>7200.0', text)
    report.write_text(text if do_differ else one_time, encoding='utf-8')
    page = open_page(report)
    assert ('attempts' in page.evaluate("document.querySelector('thead').textContent")) == do_differ
    assert any(' attempts' in name for name in page.evaluate(NAMES)) == do_differ
    seen = page.evaluate("document.querySelector('.maps').innerText")
    assert ('values differ by place and by time of day' in seen) == do_differ


def test_one_word_for_all_failures_is_in_the_key_and_not_at_each_tag(report, open_page):
    page = open_page(report)
    key = "document.getElementById('key').textContent"
    labels = "[...document.querySelectorAll('#map .failed > text')].map(each => each.textContent)"
    assert sorted(page.evaluate(labels)) == sorted(list(find_layout('').tags)[3:5])
    assert 'timeout' in page.evaluate(key)
    report.write_text(report.read_text(encoding='utf-8') + visit(30, '1', [], 'NOT_CONFIRMED') + '\n')
    page = open_page(report)
    assert {text.partition(' ')[2] for text in page.evaluate(labels)} == {'timeout', 'not confirmed'}
    assert 'not read' in page.evaluate(key)


@pytest.mark.parametrize(('width', 'small_maps'), [(1400, len(UNITS)), (800, len(UNITS)), (390, 0)])
def test_the_page_fits_a_window_and_follows_its_colour_scheme(report, open_page, width, small_maps):
    page = open_page(report, width=width, height=740)
    for scheme in ('light', 'dark'):
        page.emulate_media(color_scheme=scheme)
        wait_for(page, f"matchMedia('(prefers-color-scheme: {scheme})').matches")
        assert page.evaluate(GROUNDS) == 1
        assert page.evaluate('document.documentElement.scrollWidth') == width
        colours = page.evaluate(COLOURS_OF_SCHEME)
        assert (colours['page'] < colours['text']) == (scheme == 'dark')  # by the first digit after the #
        for name in ('text', 'muted', 'bad', 'accent'):
            for below in ('page', 'chosen', 'table'):
                assert contrast(colours[name], colours[below]) >= LEAST_CONTRAST, (scheme, name, below)
    seen = "[...document.querySelectorAll('#tabs svg')].filter(each => each.getClientRects().length).length"
    assert page.evaluate(seen) == small_maps
    assert page.evaluate(COVERED_IN_CHARTS) == []
    scale = page.evaluate(SCALE)  # the same for both clocks
    assert '12:00' not in page.evaluate(TIMES)
    page.evaluate("document.querySelectorAll('[name=clock]')[1].click()")
    assert page.evaluate(SCALE) == scale
    assert '12:00' in page.evaluate(TIMES)  # of the greenhouse's clock
    assert page.evaluate(CUT) == []


@pytest.mark.parametrize(
    ('walls', 'height', 'wanted'), [((4, 8), 720, 288), ((4, 8), 1080, 425), ((20, 8), 720, 1150)]
)
def test_a_wider_window_never_makes_the_map_smaller(report, open_page, walls, height, wanted):
    """Of a mission with a route and attempts. Each tag has a label, and none touches another tag."""
    report.write_text(report.read_text(encoding='utf-8').replace('"attempts": 1', '"attempts": 2', 9))
    route = report.with_name('report-route.csv')
    way = [(3, 6)] * 2 + [(1.8, 5.4)] * 2 + [(1.6, 4.1)] + [(0.8, 4)] * 2 + [(1.6, 4.1)] + [(2, 4.5)] * 2
    route.write_text('\n'.join(f'{x},{y}' for x, y in ('xy', (0.5, 0.5), *way, (0.5, 0.5))), encoding='utf-8')
    page = open_page(report, '--walls', '0', '0', *map(str, walls), width=320, height=height)
    marks = page.evaluate("document.querySelectorAll('#map .stop, #map .arrow').length")
    assert marks == 4 + 5  # of each leg
    boxes, widths = {}, [320, 360, 412, 560, 703, 704, 768, 900, 1280, 1920, 2560]
    for width in widths:
        page.set_viewport_size({'width': width, 'height': height})
        wait_for(page, f'innerWidth === {width} && {IS_DRAWN}')
        boxes[width] = page.evaluate(BOXES)
        faults = (CLOSE, COVERED_IN_CHARTS, BEYOND_CARD) + (COVERED, WITHOUT_LABEL) * (walls == (4, 8))
        faults += (MISREAD, ONE_TEXT, ON_ROUTE) * (walls == (4, 8) and width >= 360)
        assert [page.evaluate(each) for each in faults] == [[]] * len(faults), width
        assert page.evaluate('document.documentElement.scrollWidth') == width
    sizes = [round(boxes[width]['#map .wall']['width']) for width in widths]
    assert sizes == sorted(sizes)
    assert boxes[1280]['#map .wall']['width'] >= wanted
    if walls == (4, 8):
        assert boxes[1280]['#failures']['left'] == boxes[1280]['#table']['left']
        assert boxes[1280]['#failures']['bottom'] < boxes[1280]['#table']['top']
        assert boxes[1280]['.maps']['top'] == boxes[1280]['h1']['top']
        assert boxes[1280]['.maps']['left'] > boxes[1280]['#table']['right']
        assert boxes[1280]['.maps']['width'] >= 0.8 * boxes[1280]['#table']['width']
        assert all(boxes[1280]['.scroll'][side] >= boxes[1280]['table'][side] for side in ('width', 'height'))
        assert 0 < boxes[1280]['#bar']['top'] < boxes[1280]['#map']['bottom'] <= height
        assert boxes[2560]['#charts']['top'] == boxes[2560]['.maps']['top']
        assert boxes[2560]['#charts']['right'] > 2500
        page.set_viewport_size({'width': 2560, 'height': 1440})
        wait_for(page, f'innerHeight === 1440 && {IS_DRAWN}')
        assert page.evaluate('document.documentElement.scrollHeight') == 1440  # nothing is below the window
    assert page.evaluate('parseFloat(getComputedStyle(document.body).fontSize)') > 18


@pytest.mark.parametrize('width', [320, 360])
def test_a_phone_shows_the_map_first_and_cuts_no_text(report, open_page, width):
    page = open_page(report, width=width, height=640)
    assert page.evaluate(CUT) == page.evaluate(BAD_ROWS) == []
    before = page.evaluate(BOXES)
    assert before['table']['width'] <= before['.scroll']['width']
    assert before['#map']['bottom'] < before['#table']['top']
    order = ('h1', '#file > :last-child', '#failures', '#map', '#table', '#charts', '#file span')
    assert [*order] == sorted(order, key=lambda name: before[name]['top'])
    assert page.evaluate(SMALLEST_TARGET) >= 44
    heights = page.evaluate("[...document.querySelectorAll('tbody tr')].map(each => each.offsetHeight)")
    assert 36 <= min(heights) <= max(heights) <= 68
    beside = """
        document.querySelector('#map svg').dispatchEvent(new MouseEvent('click', (({ right, bottom }) =>
            ({ clientX: right + 7, clientY: bottom + 7, bubbles: true }))(
            document.querySelector('#map a[data-tag="19"] .dot').getBoundingClientRect())))"""
    page.evaluate(beside)
    assert page.evaluate("document.querySelector('#map .chosen').dataset.tag") == '19'
    after = page.evaluate(BOXES)
    assert [box['top'] for box in after.values()] == [box['top'] for box in before.values()]
    page.evaluate("document.querySelector('#chosen button').click()")
    assert page.evaluate(CHOSEN) == []
    later = visit(86_400, '1', ['co2'])  # on the next day
    report.write_text(report.read_text(encoding='utf-8') + later + '\n', encoding='utf-8')
    page = open_page(report, width=width, height=640)
    assert page.evaluate(CUT_PIECES) == []
    assert page.evaluate('document.documentElement.scrollWidth') == width


@pytest.mark.parametrize(('count', 'columns'), [(100, [1]), (100_000, [1] * 5), (100, [3] * 5)], ids=str)
def test_charts_are_equally_wide_and_their_times_below_each_other(tmp_path, open_page, count, columns):
    path, tags, sensors = tmp_path / 'day.sqlite', list(find_layout('').tags), len(columns)
    stamps = [(START_S + number) * 10**9 for number in range(count)]
    rows = [
        Row(ns, utc_of(ns), tags[n % len(tags)], f's{n % sensors}', n % 97, '', None, None, n % 86400, 'test')
        for n, ns in enumerate(stamps)
    ]
    Store(str(path)).keep(rows)
    page = open_page(path, width=1280)
    shares = [0.95 < share * columns[0] <= 1 for share in page.evaluate(CHART_SHARES)]
    assert shares == [True] * (1 + sensors)  # of the heading, too
    assert len(set(map(tuple, page.evaluate(TICKS)))) == 1
    assert page.evaluate(BOXES)['#charts']['width'] >= 448
    assert page.evaluate(COVERED_IN_CHARTS) == page.evaluate(WITHOUT_LABEL) == []
    assert page.evaluate("document.getElementById('tabs').offsetHeight > 0") == (sensors > 1)
    assert page.evaluate(LINES) == min(count, sensors * len(tags))
    told, bands = "document.getElementById('lines').innerText", "document.querySelectorAll('.band').length"
    is_binned = count == 100_000
    assert (page.evaluate(bands) > 0) == ('the line is their median' in page.evaluate(told)) == is_binned


@pytest.mark.parametrize('width', [1400, 390])
def test_axe_finds_no_fault(report, open_page, width):
    page = open_page(report, width=width)
    page.evaluate(AXE.read_text(encoding='utf-8') + '; 0')
    for scheme in ('light', 'dark'):
        page.emulate_media(color_scheme=scheme)
        for act in ('0', "location.hash = '#tag=5'"):
            page.evaluate(act)
            found = page.evaluate('axe.run().then(found => JSON.stringify(found.violations))')
            assert json.loads(found) == []


@pytest.mark.parametrize('width', [720, 1280])
def test_the_header_of_the_table_stays_while_the_page_scrolls(report, open_page, width):
    page = open_page(report, width=width, height=500)
    page.evaluate("document.querySelector('tbody tr:last-child').scrollIntoView({ block: 'center' })")
    wait_for(page, "Math.abs(document.querySelector('thead').getBoundingClientRect().top) < 1")
    heights = "[...document.querySelectorAll('.scroll')].map(each => each.scrollHeight - each.clientHeight)"
    assert set(page.evaluate(heights)) == {0}
    assert page.evaluate(
        "[...document.querySelectorAll('thead *')].map(each => getComputedStyle(each).writingMode)"
        ".every(each => each === 'horizontal-tb')"
    )


def test_the_lowest_and_the_highest_line_stand_out_and_the_axis_follows_the_values(tmp_path, open_page):
    path, tags = tmp_path / 'hour.sqlite', find_layout('').tags
    moments = [(START_S + 60 * n) * 10**9 for n in range(60)]
    Store(str(path)).keep(
        [
            Row(ns, utc_of(ns), tag_id, 'co2', 500 + 2 * n, '', None, None, 43200.0 + at, 'test')
            for at, ns in enumerate(moments)
            for n, tag_id in enumerate(('1', '5', '9'))
        ]
    )
    page = open_page(path)
    marked = "[...document.querySelectorAll('.series.marked')].map(each => each.dataset.tag)"
    assert sorted(page.evaluate(marked)) == ['1', '9']
    heights = [float(each) for each in page.evaluate(SCALE) if each not in tags or each == '500']
    assert min(heights) >= 496
    assert max(heights) <= 508
    assert page.evaluate(CELLS) == ['1', '5', '9']
    told = page.evaluate("document.getElementById('charts').innerText")
    assert told.startswith('Over time')
    assert 'the lowest and the highest last value.' in told
    unread = page.evaluate("document.getElementById('unread').innerText")
    assert unread.startswith('Tags ')
    assert unread.endswith(' not in the file')


def test_what_a_file_holds_is_shown_as_text_and_never_run(tmp_path, open_page):
    path, tag_file = tmp_path / 'report.jsonl', tmp_path / 'tags.json'
    path.write_text(visit(0, EVIL, [EVIL]) + '\n', encoding='utf-8')
    tag_file.write_text(json.dumps({EVIL: {'x': 1, 'y': 2, 'sensors': ['co2']}}), encoding='utf-8')
    page = open_page(path, '--tag-file', str(tag_file))
    for texts in (CELLS, LABELS, TABS):
        assert EVIL in page.evaluate(texts)
    assert any(EVIL in name for name in page.evaluate(NAMES))
    page.evaluate("document.querySelector('tbody a').click()")
    wait_for(page, f'{CHOSEN}.length > 0')
    assert EVIL in page.evaluate("document.getElementById('chosen').textContent")


def test_of_many_tags_one_is_found_by_its_name_and_the_missing_labels_are_counted(tmp_path, open_page):
    count, path, tag_file = readings_page.MOST_TAGS, tmp_path / 'report.jsonl', tmp_path / 'tags.json'
    tags = {f'far {n}': {'x': 1 + n % 200 / 50, 'y': 2 + n // 200, 'sensors': ['co2']} for n in range(count)}
    tag_file.write_text(json.dumps(tags), encoding='utf-8')
    path.write_text('\n'.join(visit(0, tag_id, ['co2']) for tag_id in tags), encoding='utf-8')
    page = open_page(path, '--tag-file', str(tag_file))
    page.evaluate("document.querySelector('input[type=search]').value = 'FAR 99'")
    page.evaluate("document.querySelector('input[type=search]').dispatchEvent(new Event('input'))")
    shown = "[...document.querySelectorAll('tbody tr')].filter(each => each.offsetHeight).length"
    assert page.evaluate(shown) == 11  # 99, and 990 to 999
    for place, text in (('#map', '#unlabelled'), ('#charts', '#series')):
        missing = page.evaluate(f"document.querySelectorAll('{place} .spare').length")
        told = page.evaluate(f"document.querySelector('{text}').textContent")
        assert f'{missing} of the numbers have no room' in told
