"""The figure of the greenhouse, and the printed tags."""

import itertools
import json
import re
from collections import defaultdict
from importlib.metadata import version

import figure
import numpy as np
import pypdfium2
import pytest
import tag_sheet
import yaml
from lupin_greenhouse_bridge.simulator.layout import require_layout, shipped_file
from lupin_greenhouse_bridge.units import unit_of
from lupin_tag_confirmation.detector import TagDetector
from matplotlib import pyplot
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Wedge
from PIL import Image


@pytest.fixture(scope='module', params=figure.SCHEMES)
def drawn(request):
    yield figure.draw(request.param)
    pyplot.close('all')


def test_each_tag_is_a_disc_with_a_sector_of_the_colour_of_each_of_its_sensors(drawn):
    wanted = {
        tag[:2]: {figure.COLOURS[each] for each in tag.sensors} for tag in require_layout('').tags.values()
    }
    sectors = defaultdict(set)
    for each in drawn.axes[0].patches:
        if isinstance(each, Wedge):
            sectors[each.center].add(to_hex(each.get_facecolor()))
    assert sectors == wanted


def test_no_label_hides_a_tag_or_another_label(drawn):
    axes = drawn.axes[0]
    labels = [each.get_window_extent() for each in axes.texts]
    discs = {each.center: each.get_window_extent() for each in axes.patches if isinstance(each, Wedge)}
    assert len(labels) > len(discs) == 29
    assert not any(one.overlaps(other) for one, other in itertools.combinations(labels, 2))
    assert not any(label.overlaps(disc) for label in labels for disc in discs.values())


def test_both_pictures_are_written_to_a_folder(tmp_path, capsys):
    assert figure.main(['--output', str(tmp_path / 'new')]) == 0
    paths = [tmp_path / f'new/greenhouse_{scheme}.png' for scheme in ('light', 'dark')]
    assert capsys.readouterr().out == ''.join(f'{path}\n' for path in paths)
    for path in paths:
        with Image.open(path) as image, Image.open(figure.COMMITTED / path.name) as committed:
            assert image.size == committed.size


# Machado, Oliveira and Fernandes, 2009: linear RGB as seen without red and without green cones.
AS_SEEN = {
    'by most people': np.eye(3),
    'by protanopes': [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    'by deuteranopes': [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
}


@pytest.mark.parametrize('eyes', AS_SEEN)
def test_the_colours_of_the_sensors_differ_for_colour_blind_people(eyes):
    linear = np.array([to_rgb(each) for each in figure.COLOURS.values()]) ** 2.2
    seen = np.clip(linear @ np.transpose(AS_SEEN[eyes]), 0, 1) ** (1 / 2.2)
    assert min(np.linalg.norm(one - other) for one, other in itertools.combinations(seen, 2)) > 0.22


def test_the_page_of_the_simulator_has_the_range_and_the_noise_of_each_sensor():
    """Over all tags and half hours, without noise."""
    simulator, tags = figure.silent_simulator(), require_layout('').tags.values()
    config = yaml.safe_load(shipped_file('greenhouse_config.yaml').read_text(encoding='utf-8'))['sensors']
    rows = set()
    for name in figure.COLOURS:
        places = [tag[:2] for tag in tags if name in tag.sensors]
        values = [figure.value(simulator, name, place, half / 2) for place in places for half in range(48)]
        noise = max(component['noise_sigma'] for component in config[name])
        rows.add(f'| {name} | {min(values):.3g} | {max(values):.3g} | {unit_of(name)} | {noise:g} |')
    page = (figure.COMMITTED / 'formats.md').read_text(encoding='utf-8')
    mark = f'<!-- ranges of mdp-greenhouse {version("mdp-greenhouse")} -->\n'
    assert set(page.partition(mark)[2].partition('\n\n')[0].splitlines()[2:]) == rows


@pytest.mark.parametrize(
    ('arguments', 'fragment'),
    [
        (['--side', '200'], 'tags: --side 200: must be between 8 and 152 mm'),
        (['--output', '/proc/nowhere'], 'tags: '),
        (['--tag-file', 'TAGS'], "tags: tag 'tag one' is not in tag36h11"),
    ],
)
def test_a_wrong_argument_is_refused_in_one_line(arguments, fragment, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tags = '{"tag one": {"x": 1.0, "y": 1.0, "sensors": ["co2"]}}'
    (tmp_path / 'TAGS').write_text(tags, encoding='utf-8')
    assert tag_sheet.main(arguments) == 2
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
