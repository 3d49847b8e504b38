# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The picture of the readings in a file."""

import importlib.util
import itertools
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import visit, write_report
from lupin_greenhouse_bridge.display.colours import colour_limits
from lupin_greenhouse_bridge.display.drawing_command import read_file
from lupin_greenhouse_bridge.display.placing import Box, place_labels
from lupin_greenhouse_bridge.display.plot_report import main
from lupin_greenhouse_bridge.display.summary import SEVERAL_TIMES, clock_text, greenhouse_times, speed_text
from lupin_greenhouse_bridge.planning import approach_poses
from lupin_greenhouse_bridge.recording.rows import Row
from lupin_greenhouse_bridge.recording.store import open_store
from lupin_greenhouse_bridge.units import UNITS

# Not importorskip, which ends the import of the module: launch_testing imports every test module.
pytestmark = pytest.mark.skipif(
    not importlib.util.find_spec('matplotlib'),
    reason='matplotlib, which draws the picture, is missing: sudo apt install python3-matplotlib',
)


@pytest.fixture
def report(tmp_path):
    return write_report(
        tmp_path / 'report.jsonl',
        visit('1', temperature=22.61),
        visit('5', temperature=24.02, co2=615.2),
        visit('7', 'TIMEOUT', 'no reply before the timeout'),
        visit('$\\lost$', 'UNKNOWN_TAG', 'no such $tag'),  # no formula
    )


@pytest.fixture
def figures(monkeypatch):
    """Return the list of the figures from now on, which are not saved: that takes long."""
    figures = []
    save = 'matplotlib.figure.Figure.savefig'
    monkeypatch.setattr(save, lambda figure, *_, **_options: figures.append(figure))
    return figures


@pytest.fixture
def drawn(tmp_path, figures):
    def draw(*visits, file=None, columns=3, options=()):
        report = file or write_report(tmp_path / 'report.jsonl', *visits)
        assert main([str(report), '--columns', str(columns), *options]) == 0
        return figures[-1]

    return draw


def artists_in(figure) -> list:
    return figure.findobj(importlib.import_module('matplotlib.text').Text)


def texts_in(figure) -> list[str]:
    return [text.get_text() for text in artists_in(figure)]


def test_the_picture_names_sensors_units_tags_values_and_failures(report, drawn, shipped_tags):
    texts = texts_in(drawn(file=report))
    assert {'temperature (°C)', 'CO₂ (ppm)', '1: 22.6', '5: 615', 'y (m)'} <= set(texts)
    lost = 'Tag \\$\\lost\\$ \nunknown tag\n: no such \\$tag'
    counts = f'2 of {len(shipped_tags)} tags read\n·\n1 timeout\n·\n1 unknown tag\n'
    owners = {'1', '5'}.union(each for each, tag in shipped_tags.items() if 'temperature' in tag['sensors'])
    values = f'2 of {len(owners)} tags with this sensor\nlowest 22.6 °C at tag 1\nhighest 24.0 °C at tag 5'
    for lines in (') \ntimeout\n: no reply before the timeout', lost, counts, values):
        assert lines in '\n'.join(texts)
    assert 'Not shown: CO₂.' in texts_in(drawn(file=report, options=['--sensor', 'temperature']))


def test_what_is_the_same_is_told_once(drawn):
    """The word of all failures in both keys, too, and one text of values at one time, without a ring."""
    visits = [*(visit(each, temperature=20.7) for each in '45'), *(visit(each, 'TIMEOUT') for each in '79')]
    texts = '\n'.join(texts_in(drawn(*visits))).split('\n')
    assert {'7', '9', 'timeout', '20.7 °C at tags 4 and 5'} <= set(texts)
    assert not any('lowest ' in text or ' to ' in text or SEVERAL_TIMES in text for text in texts)
    assert [texts.count(each) for each in ('timeout', 'lowest, highest')] == [3, 0]


def test_each_panel_has_the_unread_tags_and_the_cross_of_one_with_its_sensor(drawn, shipped_tags):
    read, lost, *_ = places = {tag_id: (tag['x'], tag['y']) for tag_id, tag in shipped_tags.items()}
    values = {each: float(each in shipped_tags[lost]['sensors']) for each in UNITS}
    panels = [axes for axes in drawn(visit(read, **values), visit(lost, 'TIMEOUT')).axes if axes.get_title()]
    for axes, has_cross in zip(panels, [1.0, *values.values()], strict=True):
        (dots,) = (line for line in axes.lines if line.get_markerfacecolor() == 'white')
        left = places.keys() - ({read, lost} if has_cross else {read})
        assert list(zip(*dots.get_data(), strict=True)) == [places[each] for each in places if each in left]
        crosses = [each for each in axes.collections if each.get_offsets().tolist() == [[*places[lost]]]]
        assert len(crosses) == has_cross == (lost in [text.get_text() for text in axes.texts])


def test_tags_with_the_same_value_are_all_named_and_ringed(drawn):
    values = {'1': 600.2, '3': 599.9, '5': 700.0}
    night = visit('12', co2=650.0) | {'sim_time_of_day_seconds': 3600.0}
    figure = drawn(*(visit(tag_id, co2=value) for tag_id, value in values.items()), night)
    extremes = 'lowest 600 ppm at tags 1 and 3\nhighest 700 ppm at tag 5\ngreenhouse time 12:00 to 01:00'
    assert all(each in ' '.join(texts_in(figure)) for each in (extremes, SEVERAL_TIMES))
    assert len(figure.axes[0].collections[1].get_offsets()) == 3  # the rings


def test_titles_keys_and_colour_bars_of_all_sensors_have_room_and_round_ticks(drawn):
    high = dict(zip(UNITS, (21.0, 50.0, 500.0, 800.0, 0.6), strict=True))
    figure = drawn(visit('1', **high), visit('2', temperature=7.0, soil_moisture=0.28))
    figure.draw_without_rendering()
    bars = [axes for axes in figure.axes if axes.get_label() == '<colorbar>']
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert (len(bars), len(panels)) == (5, 5)
    for bar in bars:
        around = bar.get_tightbbox(figure.canvas.get_renderer()).padded(figure.dpi * 0.1)
        for each in (*(panel.title for panel in panels), panels[0].get_legend()):
            assert not around.overlaps(each.get_window_extent())
        ticks = [each for each in bar.get_xticks() if bar.get_xlim()[0] <= each <= bar.get_xlim()[1]]
        step = ticks[1] - ticks[0]
        assert f'{step:.0e}'[0] in '125'
        assert [each / step for each in ticks] == pytest.approx([round(each / step) for each in ticks])


def test_no_line_above_or_below_five_wide_panels_is_covered_or_cut(tmp_path):
    """As saved: then, the layout is not that of a figure that is only drawn."""
    report = write_report(tmp_path / 'wide.jsonl', visit('1', **dict.fromkeys(UNITS, 1.0)))
    assert main([str(report), '--walls', '0', '0', '5', '6', '-o', str(tmp_path / 'wide.svg')]) == 0
    drawn = (tmp_path / 'wide.svg').read_text()
    head, title, foot = (
        float(re.search(rf'<!-- {text}.* -->\s*<g [^>]*translate\(\S+ (\S+)\)', drawn)[1])
        for text in ('greenhouse 12', 'temperature', 'wide.jsonl')
    )
    assert head < title - 12
    assert foot < float(re.search(r'viewBox="0 0 \S+ (\S+)"', drawn)[1]) - 5


@pytest.mark.parametrize(('count', 'most', 'found'), [(2, 1, 1), (5, 1, 1), (5, 2, 2), (3, 3, 2), (4, 3, 3)])
def test_no_text_reaches_the_next_panel_or_is_wider_than_the_rows_of_up_to_three(drawn, count, most, found):
    names = *[*UNITS][: count - 2], 'a_sensor_with_a_name_that_is_longer_than_its_panel', 'b'
    failed = [visit(each, 'TIMEOUT', f'no reply of {each} in time; ' * 5) for each in ('7', '9', '11')]
    figure = drawn(visit('1', **dict.fromkeys(names, 20.0)), visit('5', b=20.0), *failed, columns=most)
    assert figure.axes[0].get_gridspec().ncols == found
    figure.draw_without_rendering()
    for axes, right in itertools.pairwise(figure.axes[: count + 1]):
        for text in (axes.title, *axes.texts[:2]) if right.bbox.x0 > axes.bbox.x0 else ():
            assert text.get_window_extent().x1 < right.bbox.x0
    texts = [text for text in artists_in(figure) if re.search('[a-z]{2}', text.get_text())]
    assert max(text.get_window_extent().x1 for text in texts) < 1.04 * figure.bbox.x1


def test_the_failed_tags_come_first_and_a_code_last(tmp_path, drawn, write_layout):
    detail = 'navigate_to_pose aborted the drive with code 208: no path to 0.90, 5.10 m'
    failed = [visit(tag_id, 'UNREACHABLE', detail) | {'goal': [1e12, 0]} for tag_id in ('7', '9', 'A3')]
    failed.append(visit('10', 'UNREACHABLE', f'pose 1: {detail}; pose 2: {detail}') | {'goal': [0.9, 5.1]})
    tag_file = write_layout(dict.fromkeys(('1', '7', '9', '10', 'A3'), (1.0, 1.0)))
    Path(tag_file).rename(tmp_path / 'report-tag_locations.json')
    texts = texts_in(drawn(visit('1', co2=1.0), *failed))  # in lines of some length
    assert 'goal not reached' in (text := ' '.join(map(str.strip, texts)).replace(' :', ':'))
    reason = 'no path to 0.90,\u00a05.10\u00a0m (Nav2 code 208)'  # a position is on one line
    assert f'Tags 7, 9 and A3 unreachable: {reason} Tag 10 (CO₂) unreachable: pose 1: {reason}' in text


def rows_at(times_of_day):
    """Return a row for each second of the wall clock and time of day in the greenhouse."""
    return [Row(s * 10**9, '', '1', 'co2', 1.0, '', None, None, time, '') for s, time in times_of_day]


@pytest.mark.parametrize(
    ('speed', 'gap_seconds', 'told'),
    [(1, 1, ''), (1800, 1, '1,800'), (1800, 6, ''), (20_000, 2, '20,000'), (20_000, 5, '2,700')],
)
def test_a_clock_of_the_greenhouse_that_is_faster_is_told(speed, gap_seconds, told):
    """The clock wraps each day, so it can have passed more days than it shows."""
    rows = rows_at((second, float(second * speed % 86_400)) for second in range(0, 50, gap_seconds))
    assert speed_text(rows) == (f'at about {told}\u00d7 real time' if told else '')
    assert ('moves 30 min at a time' in clock_text(rows)) == ((speed, gap_seconds) == (1800, 1))


def test_times_of_several_days_say_so():
    times = [(1, 64_800.0), (2, 3600.0), (3, 50_000.0), (4, 1800.0), (5, 79_200.0)]
    assert greenhouse_times(rows_at(times[:2])) == 'greenhouse 18:00 to 01:00'
    assert greenhouse_times(rows_at(times)) == 'greenhouse 18:00 to 22:00 over at least 3 days'


@pytest.mark.parametrize(
    ('values', 'limits', 'expected'),
    [
        ([5.7, 19.1], (0.0, 30.0), (5.0, 20.0)),
        ([24.0], (0.0, 30.0), (23.6, 24.4)),
        ([0.44, 0.56], (0.2, 0.8), (0.4, 0.6)),
        ([-5.0, 12.0], (0.0, 30.0), (0.0, 15.0)),
        ([31.0, 45.0], (0.0, 30.0), (29.6, 30.0)),
        ([], (0.0, 30.0), (0.0, 30.0)),
        ([3.0, 3.001], None, (2.94, 3.06)),
        ([1e16], None, (1e16 - 6e9, 1e16 + 6e9)),
    ],
)
def test_the_colours_end_at_round_numbers_around_the_values_and_within_the_config(values, limits, expected):
    assert colour_limits(values, limits) == expected


def test_the_way_of_the_robot_is_drawn_with_its_length_wherever_it_leads(report, tmp_path, drawn):
    (tmp_path / 'report-route.csv').write_text('x,y\n0.5,0.5\n0.5,-3.5\n3.5,-3.5\n', encoding='utf-8')
    figure = drawn(file=report)
    assert 'the robot drove 7.0 m' in texts_in(figure)
    way = [0.5, 0.5], [0.5, -3.5], [3.5, -3.5]
    assert any(all(each in line.get_xydata().tolist() for each in way) for line in figure.axes[0].lines)
    assert figure.axes[0].get_title() == 'route'
    assert figure.axes[0].get_ylim()[0] < -3.5


@pytest.mark.parametrize('columns', [1, 3])
def test_each_label_lies_on_nothing_and_nearest_to_its_own_dot(tmp_path, shipped_tags, drawn, columns):
    """In the shipped greenhouse, with a route and a value of every sensor of every tag."""
    route = 'x,y\n0.5,0.5\n3.0,0.5\n3.0,7.8\n0.5,7.8\n0.5,0.5\n'
    (tmp_path / 'report-route.csv').write_text(route, encoding='utf-8')
    visits = [visit(tag_id, **dict.fromkeys(tag['sensors'], 123.4)) for tag_id, tag in shipped_tags.items()]
    figure = drawn(*visits, columns=columns)
    renderer = figure.canvas.get_renderer()
    figure.draw(renderer)
    keys = [axes.get_legend() for axes in figure.axes[:2]]
    head, foot, *keys = (each.get_window_extent(renderer) for each in (*figure.artists, *keys))
    for axes, key in zip(figure.axes, keys, strict=False):
        assert foot.y1 < axes.bbox.y1 < key.y0 < key.y1 < axes.title.get_window_extent().y0 < head.y0
        assert key.x0 > foot.x0 == pytest.approx(head.x0)
    assert {text.get_text() for text in figure.axes[0].texts} > set(shipped_tags)
    heights = sorted(axes.title.get_window_extent().y0 for axes in figure.axes if axes.get_title())
    assert 1 + sum(np.diff(heights) > 2) == 6 / columns
    for axes in (axes for axes in figure.axes if axes.texts):
        boxes = [text.get_window_extent() for text in axes.texts]
        assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
        dots = {id_: axes.transData.transform((tag['x'], tag['y'])) for id_, tag in shipped_tags.items()}
        named = [text.get_text().split(':')[0] for text in axes.texts]
        for id_, box in zip(named, boxes, strict=True):
            gaps = {each: math.dist(dot, np.clip(dot, box.min, box.max)) for each, dot in dots.items()}
            assert min(gaps.values()) > 0.0
            assert id_ not in dots or gaps[id_] == min(gaps[each] for each in named if each in dots)
    start = next(text for text in figure.axes[0].texts if text.get_text() == 'start, end')
    assert np.all(start.get_position() < np.array((0.9, 0.4)))  # below it


def test_the_pictures_of_several_files_have_the_same_colours(tmp_path, figures, capsys):
    reports = [
        str(write_report(tmp_path / f'{name}.jsonl', visit('1', co2=low), visit('5', co2=high)))
        for name, low, high in (('one', 410.0, 430.0), ('two', 700.0, 710.0))
    ]
    assert main(reports) == 0
    pictures = [tmp_path / 'one.png', tmp_path / 'two.png']
    assert capsys.readouterr().out == ''.join(f'picture: {each}\n' for each in pictures)
    assert [figure.axes[0].collections[0].get_clim() for figure in figures] == [(400.0, 800.0)] * 2
    assert main([*reports, '--output', 'x.png']) == 2
    assert "--output 'x.png' is one picture: leave it out, or name one FILE" in capsys.readouterr().err
    open_store(str(tmp_path / 'one.csv')).keep(read_file(reports[0]).rows)
    assert main([*reports, str(tmp_path / 'one.csv')]) == 2
    assert f"'{pictures[0]}' is the picture of 2 FILEs: draw them one by one" in capsys.readouterr().err


def test_without_a_last_reading_there_is_no_picture(tmp_path, capsys):
    open_store(str(tmp_path / 'day.csv'))
    files = {
        tmp_path / 'day.csv': 'holds no readings',
        write_report(tmp_path / 'a.jsonl', visit('1', 'TIMEOUT')): 'no tag was read',
        write_report(tmp_path / 'b.jsonl', visit('1', co2=1.0), visit('1', 'TIMEOUT')): (
            'the last visit of every tag failed'
        ),
    }
    for path, reason in files.items():
        assert main([str(path)]) == 1
        assert capsys.readouterr().err == f"plot_report: '{path}': {reason}: there is no picture\n"
    assert not [*tmp_path.glob('*.png')]


def test_only_an_earlier_picture_is_replaced_whatever_the_backend_of_the_shell(tmp_path, capsys):
    report = write_report(tmp_path / 'report.jsonl', visit('1', co2=1.0))
    drawing, image, photo, photo_svg = (tmp_path / each for each in ('a.svg', 'a.png', 'b.png', 'b.svg'))
    code = f'import sys; from {main.__module__} import main; sys.exit(main())'
    backend = os.environ | {'MPLBACKEND': 'none'}
    subprocess.run([sys.executable, '-c', code, str(report), '-o', str(image)], check=True, env=backend)
    assert image.read_bytes().startswith(b'\x89PNG')
    for each in (photo, photo_svg):
        each.write_bytes(b'a photo')
        assert main([str(report), '-o', str(each)]) == 2
        assert each.read_bytes() == b'a photo'
    assert main([str(report), '-o', 'picture.docx']) == 2
    assert "plot_report: --output 'picture.docx': the ending must be one of " in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([str(report), '--columns', '4'])
    assert capsys.readouterr().err == "plot_report: error: argument --columns: '4': must be 1, 2 or 3\n"
    for output in (image, drawing, drawing):
        assert main([str(report), '-o', str(output)]) == 0
    ElementTree.parse(drawing)


def test_without_matplotlib_the_package_to_install_is_named(report, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    for command, *words in ((main, str(report)), (approach_poses.main, '', '--picture', 'route.png')):
        assert command(words) == 2
        assert capsys.readouterr().err.endswith(': sudo apt install python3-matplotlib\n')


def test_a_label_stays_within_the_walls_and_takes_the_nearest_place_that_is_free():
    walls, dot = Box(1.0, 1.0, 2.0, 2.0), Box(1.9, 1.0, 0.2, 0.2)
    assert place_labels([dot], [(dot, 0.6, 0.2)], walls) == [(1.5, 1.0)]
    assert place_labels([dot, Box(1.5, 1.0, 0.2, 0.2)], [(dot, 0.4, 0.2)], walls) != [(1.6, 1.0)]
    assert place_labels([dot], [(dot, 0.6, 0.2)]) == [(2.3, 1.0)]
    point = Box(1.0, 1.0, 0.0, 0.0)
    assert place_labels([], [(point, 0.2, 0.2)] * 2) == [(1.0, 1.0), (1.3, 1.0)]
