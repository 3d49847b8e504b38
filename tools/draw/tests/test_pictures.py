"""The figures and the escaped tags."""

import itertools
import json
import math
import random
import re
import subprocess
import sys
from collections import defaultdict
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import figure
import numpy as np
import pypdfium2
import pytest
import simulated
import subsets
import tag_sheet
import yaml
from lupin_greenhouse_bridge.display import drawings, placing
from lupin_greenhouse_bridge.planning.viewpoints import ApproachPose
from lupin_greenhouse_bridge.simulator.layout import require_layout
from lupin_greenhouse_bridge.units import unit_of
from lupin_tag_confirmation.detector import TagDetector
from matplotlib.colors import to_hex, to_rgb
from matplotlib.contour import ContourSet
from matplotlib.patches import Circle, Polygon, Rectangle, Wedge
from matplotlib.path import Path as Line
from matplotlib.text import Text
from PIL import Image

ROOT = figure.COMMITTED.parents[3]


def test_the_committed_pictures_are_up_to_date():
    command = [sys.executable, 'tools/draw/figure.py', '--check']
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, ''), ended.stderr


def test_a_figure_of_another_greenhouse_is_not_up_to_date(tmp_path, capsys):
    options = ['--output', str(tmp_path), '--sensor']
    assert figure.main([*options, 'co2']) == 0
    assert figure.main([*options, 'co2', '--check']) == 0
    assert figure.main([*options, 'light', '--check']) == 1
    assert capsys.readouterr().out.count('is not up to date: make figure') == 6


def figures_of(folder, *options):
    """Return the figures that these options draw, by name."""
    figures = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure, 'save', lambda drawing, path, _: figures.update({path.stem: drawing}))
        assert figure.main(['--output', str(folder), *options]) == 0
    return figures


@pytest.fixture(scope='module')
def drawn(tmp_path_factory):
    """Return the figures of the shipped greenhouse."""
    figures = figures_of(tmp_path_factory.mktemp('drawn'))
    for drawing in figures.values():
        drawing.canvas.draw()
    return figures


def texts_of(drawing) -> list[str]:
    return [each.get_text() for each in drawing.findobj(Text)]


def test_the_figure_names_every_tag_and_the_unit_of_the_field(tmp_path):
    tags = {'a1': {'x': 1, 'y': 1, 'sensors': ['co2', 'light']}, 'b2': {'x': 3, 'y': 7, 'sensors': ['co2']}}
    (tmp_path / 'tags.json').write_text(json.dumps(tags), encoding='utf-8')
    figures = figures_of(tmp_path, '--tag-file', str(tmp_path / 'tags.json'), '--hour', '6')
    assert {'a1: CL', 'b2: C'} <= set(texts_of(figures['greenhouse_light']))
    axes, bar = figures['greenhouse_light'].axes
    assert bar.get_title() == 'temperature at 06:00 (°C)'
    low, high, _, *_ = (float(label.get_text()) for label in bar.get_xticklabels())
    assert (low, high) == pytest.approx(axes.images[0].get_clim(), abs=0.05)
    key = axes.get_legend()
    names = [each.get_text() for each in key.get_texts()]
    assert names == ['T temperature', 'H humidity', 'C CO₂', 'L light', 'S soil moisture', 'table']
    assert [line.get_color() for line in key.get_lines()][:-1] == list(subsets.SENSOR_COLOURS)
    assert any('A day at tag a1' in text for text in texts_of(figures['day']))


def test_the_day_says_when_each_sensor_is_highest_and_lowest(tmp_path):
    """Whatever the config says; temperature has no noise in the shipped one."""
    config = shipped('greenhouse_config.yaml')
    config['sensors']['co2'] = [{'value_at_midnight': 900, 'value_at_noon': 400, 'noise_sigma': 30}]
    for component in config['sensors']['soil_moisture']:
        component |= {'value_at_midnight': 0.4, 'value_at_noon': 0.4}
    (tmp_path / 'config.json').write_text(json.dumps(config), encoding='utf-8')
    drawing = figures_of(tmp_path, '--sim-config-file', str(tmp_path / 'config.json'), '--tag', '5')['day']
    titles = [axes.get_title(loc='left') for axes in drawing.axes]
    assert titles == ['temperature (°C)', 'CO₂ (ppm)', 'soil moisture (m³/m³)']
    values = [[text.get_text() for text in axes.texts] for axes in drawing.axes]
    assert [text.split(' ', 1)[1] for text in values[0]] == ['at 00:00', 'at 12:00']
    assert values[1:] == [['400 at 12:00', '900 at 00:00'], ['0.400 at any time']]


def test_the_band_of_the_day_has_the_shares_of_the_readings_that_it_claims(drawn):
    """The largest of two noisy components is neither normal nor centred on the curve without noise."""
    greenhouse, place, shares = simulated.Greenhouse('', ''), (2.6, 2.0), np.array([0.05, 0.5, 0.95])
    random.seed(0)
    readings = [greenhouse.value('co2', place, 12.0, is_noisy=True) for _ in range(4000)]
    limits = greenhouse.quantiles('co2', place, 12.0, shares)
    assert [np.mean(readings < limit) for limit in limits] == pytest.approx(shares, abs=0.02)
    notes = [axes.get_title(loc='right').removeprefix('reading = ') for axes in drawn['day'].axes]
    assert notes == ['value, no noise', 'highest of noisy sources', 'value + noise']
    without_noise = greenhouse.quantiles('temperature', place, 12.0, shares)
    assert set(without_noise) == {greenhouse.value('temperature', place, 12.0)}


@pytest.mark.parametrize('name', ['greenhouse_light', 'greenhouse_part_dark'])
def test_no_label_lies_on_a_tag_or_on_another_label_and_each_is_beside_its_tag(drawn, name):
    axes = drawn[name].axes[0]
    boxes = [text.get_window_extent() for text in axes.texts if text.get_visible()]
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    tags = {tag_id: (tag['x'], tag['y']) for tag_id, tag in shipped('tag_locations.json')['tags'].items()}
    dots = axes.transData.transform([*tags.values()])
    assert not any(box.contains(*dot) for box in boxes for dot in dots)
    labels = [each for each in axes.texts if re.fullmatch(r'\d+: [A-Z]+', each.get_text())]
    for text in labels:
        gaps = [math.dist(np.clip(dot, *text.get_window_extent().get_points()), dot) for dot in dots]
        assert (nearest := list(tags)[np.argmin(gaps)]) == text.get_text().split(':')[0]
        assert np.abs(np.subtract(text.get_position(), tags[nearest])).min() < 0.001  # and not askew
    assert len(labels) > 5
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes)


@pytest.mark.parametrize('scheme', subsets.SCHEMES)
def test_each_tag_has_the_colours_of_its_sensors_in_the_picture(scheme, drawn):
    colours = dict(zip(simulated.Greenhouse('', '').sensors, subsets.SENSOR_COLOURS, strict=True))
    drawing, tags = drawn[f'greenhouse_{scheme}'], shipped('tag_locations.json')['tags'].values()
    wanted = {(tag['x'], tag['y']): {colours[each] for each in tag['sensors']} for tag in tags}
    sectors = defaultdict(set)
    for each in drawing.axes[0].patches:
        if isinstance(each, Wedge):
            sectors[each.center].add(to_hex(each.get_facecolor()))
    assert sectors == wanted
    with Image.open(figure.COMMITTED / f'greenhouse_{scheme}.png') as image:
        pixels = np.asarray(image.convert('RGB')).reshape(-1, 3)
    for colour in colours.values():
        assert (np.abs(pixels / 255 - to_rgb(colour)).max(axis=1) < 0.02).sum() > 100


def test_sensors_beyond_the_palette_share_grey():
    colours = subsets.colours_of(SimpleNamespace(letters={name: name.upper() for name in 'abcdefg'}))
    assert colours == dict(zip('ABCDEFG', [*subsets.SENSOR_COLOURS, *2 * [subsets.OTHER]], strict=True))


# Machado, Oliveira and Fernandes, 2009: linear RGB as seen without red and without green cones.
AS_SEEN = {
    'by most people': np.eye(3),
    'by protanopes': [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    'by deuteranopes': [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
}


@pytest.mark.parametrize('eyes', AS_SEEN)
def test_the_colours_of_the_sensors_differ_for_colour_blind_people(eyes):
    linear = np.array([to_rgb(each) for each in subsets.SENSOR_COLOURS]) ** 2.2
    seen = np.clip(linear @ np.transpose(AS_SEEN[eyes]), 0, 1) ** (1 / 2.2)
    assert min(np.linalg.norm(one - other) for one, other in itertools.combinations(seen, 2)) > 0.22


def test_the_texts_of_the_part_are_legible_on_a_phone(drawn):
    """At least 11 px high, where the picture is 328 px wide."""
    for scheme in subsets.SCHEMES:
        drawing = drawn[f'greenhouse_part_{scheme}']
        texts = [each for each in drawing.findobj(Text) if each.get_visible() and each.get_text()]
        assert min(each.get_fontsize() for each in texts) * 328 / (72 * drawing.get_figwidth()) >= 11
        assert {'robot', '1: TC'} <= set(texts_of(drawing))


def test_the_robot_of_the_part_has_the_values_of_the_readme_and_a_ray_to_its_tag(drawn):
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    values = re.findall(r'^1 +12:00:00 +(\w+) +([\d.]+) +(\S+)$', readme, re.MULTILINE)
    axes, tag = drawn['greenhouse_part_light'].axes[0], shipped('tag_locations.json')['tags']['1']
    said = ['tag 1:', *(' '.join(each).replace('co2', 'CO₂') for each in values)]
    (shown,) = [each for each in axes.texts if each.get_text() == '\n'.join(said)]
    frame = shown.get_bbox_patch().get_window_extent()
    assert not any(frame.overlaps(table.get_window_extent()) for table in filled(axes, Rectangle))
    (ray,) = [line.get_xydata() for line in axes.lines if line.get_linestyle() == '--']
    assert tuple(ray[-1]) == (tag['x'], tag['y'])
    (robot,) = filled(axes, Circle)
    assert math.dist(ray[0], robot.center) == pytest.approx(robot.radius)


def filled(axes, kind: type) -> list:
    return [each for each in axes.patches if isinstance(each, kind) and each.get_fill()]


def test_the_edges_of_the_tags_and_the_robot_stand_out_from_the_dark_field(drawn):
    """And from tables, by the contrast of WCAG 2, which asks for 3 of graphics."""
    axes = drawn['greenhouse_part_dark'].axes[0]
    marks = [each.get_edgecolor()[:3] for each in axes.patches if isinstance(each, Wedge)]
    assert marks
    marks += [disc.get_edgecolor() for disc in filled(axes, Circle)]
    below = subsets.FIELD_END['#0d1117'], subsets.TABLE['#0d1117']
    linear = np.array([to_rgb(each) for each in (*below, *marks)]) ** 2.2
    field, table, *others = linear @ [0.2126, 0.7152, 0.0722] + 0.05
    assert min(others) / 3 > table > 1.3 * field


@pytest.mark.parametrize('name', ['greenhouse_light', 'greenhouse_part_dark'])
def test_each_line_of_equal_values_has_its_number(name, drawn):
    axes = drawn[name].axes[0]
    (lines,) = (each for each in axes.get_children() if isinstance(each, ContourSet))
    width = max(each.get_window_extent().width for each in axes.texts if each.get_text().endswith(' °C'))
    metre = [each.get_window_extent() for each in axes.lines if each.get_linewidth() == 3]
    for level, paths in zip(lines.levels, lines.allsegs, strict=True):
        boxes = [each.get_window_extent() for each in axes.texts if each.get_text() == f'{level:g} °C']
        ways = [axes.transData.transform(each) for each in paths]
        for way in ways:
            is_long = placing.length_m(way) > 1.5 * width  # not in a corner
            assert not any(Line(way).intersects_bbox(bar, filled=False) for bar in metre)
            assert not is_long or any(Line(way).intersects_bbox(box, filled=False) for box in boxes)
        for box in boxes:
            assert any(Line(way).intersects_bbox(box, filled=False) for way in ways)


def test_the_letters_of_sensors_are_the_start_of_their_names():
    names = ['temperature', 'co2', 'co2_soil', 'tilt']
    assert list(simulated.letters_of(names).values()) == ['Te', 'co2', 'Co2_', 'Ti']


def test_the_route_has_arrows_numbered_stops_and_a_line_from_each_pose_to_its_tag(drawn):
    axes, tags = drawn['route'].axes[0], shipped('tag_locations.json')['tags']
    written = [text for text in axes.texts if text.get_text()]
    kinds = figure.colours.TAG_ID, 'white', figure.colours.ROUTE
    ids, stops, others = ([text for text in written if text.get_color() == each] for each in kinds)
    assert {text.get_text() for text in ids} == set(tags)
    assert {text.get_text() for text in others} == {'start', 'end'}
    assert sum(getattr(text, 'arrow_patch', None) is not None for text in axes.texts) == 22
    lines = [line for line in axes.lines if len(line.get_xydata()) > 1]
    sights = [line.get_xydata() for line in lines if line.get_color() == figure.colours.TAG_ID]
    places = {tag_id: (tag['x'], tag['y']) for tag_id, tag in tags.items()}
    assert {tuple(sight[-1]) for sight in sights} == set(places.values())
    dots = np.array([dot.center for dot in filled(axes, Circle) if dot.radius < 0.04])
    for x, y in (sight.T for sight in sights):  # in a bow around the dots of other stops
        gaps = np.hypot(x[:, None] - dots[:, 0], y[:, None] - dots[:, 1]).min(axis=0)
        assert all(gap < 0.01 or gap > 0.08 for gap in gaps)
    boxes = {text: text.get_window_extent() for text in written}
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes.values(), 2))
    ways = [line.get_transform().transform_path(line.get_path()) for line in lines]
    for text in ids + others:  # digits are smaller than their box
        assert not any(way.intersects_bbox(boxes[text].padded(-2), filled=False) for way in ways)
    robots = [disc.center for disc in filled(axes, Circle) if disc.radius == 0.2]
    marks = [*places.values(), *(stop.get_position() for stop in stops), *robots]
    sizes = np.repeat([0.04, 0.11, 0.15], [len(tags), len(stops), len(robots)])
    for text in ids:  # each is nearest to its own tag
        low, high = axes.transData.inverted().transform(boxes[text])
        gaps = np.hypot(*(np.clip(marks, low, high) - marks).T) - sizes
        assert list(places)[gaps.argmin()] == text.get_text()


@pytest.mark.parametrize('radius_m', [0.25, 0.2, 0.15, 0.03])
def test_the_number_of_each_stop_is_nearest_to_it_and_hides_nothing_and_has_a_line_if_far(radius_m):
    greenhouse, limits = simulated.Greenhouse('', ''), simulated.ViewingLimits(robot_radius_m=radius_m)
    approaches = simulated.find_approaches(greenhouse.layout, greenhouse.walls, limits)
    route = simulated.plan_route(approaches.free_space, approaches.poses, None, 'shortest')
    (axes,) = drawings.draw_route(greenhouse.layout, greenhouse.walls, approaches, route).axes
    sights = [(approaches.poses[each], greenhouse.layout.tags[each]) for each in route.tag_ids]
    stops, tags = (np.array([complex(*each[:2]) for each in ends]) for ends in zip(*sights, strict=True))
    legs = np.array(list(itertools.pairwise(route.points_m))) @ [1, 1j]
    heads = np.concatenate([each.get_xy() for each in axes.patches if type(each) is Polygon]) @ [1, 1j]
    texts = [text for text in axes.texts if text.get_color() == 'white']
    numbers = np.array([complex(*text.get_position()) for text in texts])
    assert [text.get_text() for text in texts] == [str(at + 1) for at in range(len(stops))]
    ways = {tuple(each.get_xydata()[[0, -1]] @ [1, 1j]) for each in axes.lines}
    for at, (stop, place) in enumerate(zip(stops, numbers, strict=True)):
        others, sights_m = np.delete(numbers, at), np.delete(placing.gaps_to(place, stops, tags), at)
        gaps_m = sights_m, placing.gaps_to(place, *legs.T), *(np.abs(each - place) for each in (tags, heads))
        to_walls_m = place.real, place.imag, 4.0 - place.real, 8.0 - place.imag
        assert min(*to_walls_m, *map(np.min, gaps_m), np.abs(others - place).min() / 2) > 0.124
        assert abs(place - stop) < np.abs(place - stops[np.abs(stops - stop) > 0.2 * radius_m]).min()
        assert ((stop, place) in ways) == (abs(place - stop) > radius_m + 0.187)


def test_the_robot_is_drawn_to_scale_with_its_heading_towards_each_tag(drawn):
    axes, greenhouse = drawn['route'].axes[0], simulated.Greenhouse('', '')
    robots = [each.center for each in filled(axes, Circle) if each.radius == 0.2]
    heads = [each.get_xy() for each in axes.patches if type(each) is Polygon]
    assert min(math.dist(*each) for each in itertools.combinations(robots, 2)) > 0.1
    for tag_id, (tip, _, back, *_) in zip(greenhouse.route.tag_ids, heads, strict=True):
        stop, tag = greenhouse.approaches.poses[tag_id][:2], greenhouse.layout.tags[tag_id][:2]
        assert min(math.dist(stop, center) for center in robots) < 0.01
        for along in (tip - stop, tip - back):
            assert tag - tip == pytest.approx(0.046 * along / np.linalg.norm(along), abs=0.001)
    assert not filled(axes, Wedge)
    assert not drawings.draw_robots(axes, [(ApproachPose(1.0, 2.0, 0.5, 1.0, 0.0), (2.0, 2.0))], 0.2)
    (nose,) = filled(axes, Wedge)
    assert (*nose.center, nose.r, nose.theta1 + nose.theta2) == pytest.approx((1, 2, 0.2, math.degrees(1)))
    assert {'robot, radius 0.2 m', 'stops at one place', 'heading past a stop'} <= {*texts_of(axes.figure)}


def shipped(name: str) -> dict:
    return yaml.safe_load(Path(simulated.shipped_file(name)).read_text(encoding='utf-8'))


def test_the_page_of_the_simulator_has_the_range_and_the_noise_of_each_sensor():
    """Over all tags and half hours, without noise."""
    greenhouse, config = simulated.Greenhouse('', ''), shipped('greenhouse_config.yaml')['sensors']
    rows = set()
    for name in greenhouse.sensors:
        places = [tag[:2] for tag in greenhouse.layout.tags.values() if name in tag.sensors]
        values = [greenhouse.value(name, place, half / 2) for place in places for half in range(48)]
        noise = max(component['noise_sigma'] for component in config[name])
        rows.add(f'| {name} | {min(values):.3g} | {max(values):.3g} | {unit_of(name)} | {noise:g} |')
    page = (figure.COMMITTED / 'simulator.md').read_text(encoding='utf-8')
    mark = f'<!-- ranges of mdp-greenhouse {version("mdp-greenhouse")} -->\n'
    assert set(page.partition(mark)[2].partition('\n\n')[0].splitlines()[2:]) == rows


@pytest.mark.parametrize(
    ('main', 'arguments', 'fragment'),
    [
        (figure.main, ['--sensor', 'ph'], 'figure: --sensor ph: there is temperature'),
        (figure.main, ['--tag', '99'], 'figure: --tag 99: no such tag'),
        (figure.main, ['--hour', '24.5'], 'figure: --hour 24.5: must be between 0 and 24 hours'),
        (figure.main, ['--output', '/missing'], 'figure: --output /missing: must be a folder'),
        (figure.main, ['--tag-file', '/missing.json'], "figure: tag_file '/missing.json'"),
        (figure.main, ['--sim-config-file', 'CONFIG'], "figure: sim_config_file 'CONFIG': time is missing"),
        (tag_sheet.main, ['--side', '200'], 'tags: --side 200: must be between 8 and 152 mm'),
        (tag_sheet.main, ['--output', '/proc/nowhere'], 'tags: '),
        (tag_sheet.main, ['--tag-file', 'TAGS'], "tags: tag 'tag one' is not in tag36h11"),
    ],
)
def test_a_wrong_argument_is_refused_in_one_line(main, arguments, fragment, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = shipped('greenhouse_config.yaml')
    del config['time']
    Path('CONFIG').write_text(json.dumps(config), encoding='utf-8')
    Path('TAGS').write_text('{"tag one": {"x": 1.0, "y": 1.0, "sensors": ["co2"]}}', encoding='utf-8')
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(fragment)


@pytest.mark.parametrize(('side_mm', 'on_a_page', 'own'), [(40, 12, ()), (50, 9, ()), (100, 1, (10, 9, 586))])
def test_every_printed_tag_is_read_back_from_the_pdf(tmp_path, capsys, side_mm, on_a_page, own):
    tags = {str(number): {'x': 1.0, 'y': 1.0, 'sensors': ['co2']} for number in own}
    tag_file = str(tmp_path / 'tags.json') if own else ''
    (tmp_path / 'tags.json').write_text(json.dumps(tags), encoding='utf-8')
    words = ['--tag-file', tag_file] if own else []
    assert tag_sheet.main(['--side', str(side_mm), '--output', str(tmp_path), *words]) == 0
    document = pypdfium2.PdfDocument(tmp_path / f'tag36h11-{side_mm}mm.pdf')
    numbers = sorted(map(int, require_layout(tag_file).tags))
    assert capsys.readouterr().err == f'tags: drawing {len(numbers)} tags\n'
    assert len(document) == -(-len(numbers) // on_a_page)
    for index, page in enumerate(document):
        expected = numbers[index * on_a_page : (index + 1) * on_a_page]
        assert [round(points * 25.4 / 72) for points in page.get_size()] == [210, 297]
        text = page.get_textpage().get_text_range()
        assert list(map(int, re.findall(r'id (\d+)', text))) == expected
        assert f'black square {side_mm} mm' in text
        assert '100 mm long if printed at 100 %' in text
        picture = np.array(page.render(scale=2, grayscale=True).to_pil())
        detections = TagDetector().detect(picture)
        assert sorted(detection.tag_number for detection in detections) == expected
        for corners in (detection.corners for detection in detections):
            sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
            assert sides == pytest.approx(side_mm / 25.4 * 72 * 2, abs=1.5)


def test_a_tag_is_the_right_way_up():
    """Tag 0 is 0xd5d628584, row by row, where 1 is white (AprilTag 2, tag36h11.c)."""
    inside = tag_sheet.printed_marker(0)[1:-1, 1:-1] > 0
    assert int(''.join(str(int(bit)) for bit in inside.ravel()), 2) == 0xD5D628584
