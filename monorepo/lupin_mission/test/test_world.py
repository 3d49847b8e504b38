"""The tags of an SDF world, read as data."""

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_mission.world import read_world

MODEL = '<model name="tag_{}"><pose>{}</pose></model>'


@pytest.fixture
def world_file(tmp_path):
    """Return a function that writes a world with these models and returns its path."""

    def write(*models, text='<sdf version="1.6"><world name="w">{}</world></sdf>'):
        path = tmp_path / 'world.sdf'
        path.write_bytes(text.replace('{}', ''.join(models)).encode())
        return str(path)

    return write


def test_the_tags_come_in_numeric_order_with_their_places(world_file):
    longest = '1' * 5000  # digits, more than int() takes
    models = [
        MODEL.format(longest, '3 4 0'),
        MODEL.format(10, '1.5 -2 0.3 0 0 0'),
        MODEL.format(9, '0.1 7.3 0'),
        '<model name="table_1"/>',
    ]
    assert read_world(world_file(*models)) == {'9': (0.1, 7.3), '10': (1.5, -2.0), longest: (3.0, 4.0)}


@pytest.mark.parametrize(
    ('models', 'fragment'),
    [
        ([], 'has no model tag_<id>'),
        ([MODEL.format('x', '0 0 0'), MODEL.format('07', '0 0 0')], 'has no model tag_<id>'),
        ([MODEL.format(7, '0 0 0'), MODEL.format(7, '1 0 0')], 'has the model tag_7 twice'),
        (['<model name="tag_7"/>'], 'the model tag_7 has no pose'),
        ([MODEL.format(7, '1')], 'the model tag_7 has no pose'),
        ([MODEL.format(7, 'a b c')], 'the model tag_7 has no pose'),
        ([MODEL.format(7, 'nan 0 0')], 'the model tag_7 has no pose'),
        (['<model'], 'is not an SDF world'),
    ],
)
def test_a_world_without_clear_tags_is_refused(world_file, models, fragment):
    with pytest.raises(StartUpError, match=fragment):
        read_world(world_file(*models))


def test_entities_that_expand_to_gigabytes_are_refused(world_file):
    entities = ['<!ENTITY x0 "xxxxxxxxxx">']
    entities += [f'<!ENTITY x{each + 1} "{f"&x{each};" * 10}">' for each in range(8)]
    text = f'<!DOCTYPE sdf [{"".join(entities)}]><sdf><world name="w">{{}}&x8;</world></sdf>'
    with pytest.raises(StartUpError, match='is not an SDF world'):
        read_world(world_file(MODEL.format(7, '0 0 0'), text=text))


@pytest.mark.parametrize(
    ('content', 'fragment'),
    [
        (b'', 'is not an SDF world'),
        (b'\xff\xfe\x00', 'is not UTF-8 text'),
        (None, "^world_file '.*world.sdf': cannot be read"),
    ],
)
def test_a_file_that_is_no_world_is_refused(tmp_path, content, fragment):
    path = tmp_path / 'world.sdf'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(StartUpError, match=fragment):
        read_world(str(path))


def test_a_file_of_more_than_64_mib_is_refused(tmp_path):
    path = tmp_path / 'world.sdf'
    with path.open('wb') as file:
        file.truncate(64 * 2**20 + 1)  # sparse: it takes no room
    with pytest.raises(StartUpError, match=r'world\.sdf.: is larger than 64 MiB'):
        read_world(str(path))
