"""register_discovered_tags: the tags that perception discovered are what the layout is fitted to."""

import math
import signal

import pytest
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.testing.helpers import executable
from lupin_mission import register_discovered_tags
from lupin_msgs.msg import DiscoveredTags
from lupin_planning.registration import Transform, read_registration
from mission_helpers import TWIN_QOS, discovered
from rclpy.utilities import get_default_context

TRANSFORM = Transform(2.0, -1.0, math.pi / 2)
TOPIC = '/perception/discovered_tags'


@pytest.fixture
def register(monkeypatch, tmp_path, capfd):
    """Return a function that runs register_discovered_tags; it returns the exit code and the output."""
    monkeypatch.setattr(process, '_is_asked_to_end', False)
    before = {number: signal.getsignal(number) for number in process.SIGNALS}

    def run(*arguments):
        code = register_discovered_tags.main(['', '-o', str(tmp_path / 'layout.yaml'), *arguments])
        get_default_context(shutting_down=True)  # what follows needs a new one
        return code, *capfd.readouterr()

    yield run
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_layout_is_fitted_to_the_discovered_tags(node, register, shipped_tags, tmp_path):
    """A tag that the layout lacks and a tag without a pose do not count; an outlier is left out."""
    places = {tag_id: TRANSFORM.point(tag['x'], tag['y']) for tag_id, tag in shipped_tags.items()}
    x, y = places['7']
    places |= {'7': (x + 1.0, y), '99': (0.0, 0.0)}
    tags = [(each, *places[each], float(each != '5')) for each in ('1', '99', '7', '20', '5', '12', '3')]
    publisher = node.create_publisher(DiscoveredTags, TOPIC, TWIN_QOS)
    publisher.publish(discovered(*tags, frame_id='robot1/map'))
    code, out, _ = register('--tags', '5')
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()[1:-3]] == ['1', '7', '20', '12', '3']
    assert [line.split()[0] for line in out.splitlines() if line.endswith('left out')] == ['7']
    frame_id, transform = read_registration(tmp_path / 'layout.yaml')
    assert (frame_id, transform) == ('robot1/map', pytest.approx(TRANSFORM))


def test_it_says_what_it_waits_for(start_node, node, shipped_tags, tmp_path):
    command = [executable('lupin_mission', 'register_discovered_tags'), '-o', str(tmp_path / 'layout.yaml')]
    waiting = start_node(command)
    topic = f'{waiting.namespace}{TOPIC}'
    waiting.wait_for_log(f'waiting for 4 tags of the layout on {topic} (--tags N takes fewer or more)')
    waiting.wait_for_log(f'no publisher of {topic} is found yet')
    publisher = node.create_publisher(DiscoveredTags, topic, TWIN_QOS)
    tags = [(tag_id, tag['x'], tag['y'], 1.0) for tag_id, tag in shipped_tags.items()]
    for frame_id, count, fault in (('', 4, ' (without header.frame_id)'), ('map', 3, '')):
        named = ', '.join(tag_id for tag_id, *_ in tags[:count])
        publisher.publish(discovered(*tags[:count], frame_id=frame_id))
        waiting.wait_for_log(f'{count} of 4 tags{fault}: {named}')
    publisher.publish(discovered(*tags[:count], frame_id='map'))
    publisher.publish(discovered(*tags, frame_id='map'))
    assert waiting.end() == 0
    assert len([line for line in waiting.log if ' of 4 tags: ' in line]) == 2


@pytest.mark.parametrize('count', ['1', '1000'])
def test_a_count_that_no_layout_can_fit_is_refused(register, count):
    code, _, err = register('--tags', count)
    assert code == 2
    assert f'--tags is {count}: must be from 2 to ' in err
