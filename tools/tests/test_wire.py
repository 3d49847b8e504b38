"""
The two message packages in one workspace: the same bytes on the wire, and the same types except for the name.

Fast CDR does not set the bytes that only align what follows. The texts here have lengths that need none.
"""

import json
import re
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_path
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lupin_greenhouse_msgs.msg import SensorReading as MirrorSensorReading
from lupin_greenhouse_msgs.msg import TagReading as MirrorTagReading
from lupin_greenhouse_msgs.srv import GetTagReading as MirrorGetTagReading
from lupin_msgs.msg import SensorReading, TagReading
from lupin_msgs.srv import GetTagReading
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_generator_type_description import calculate_type_hash

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {'monorepo/lupin_msgs': 22, 'lupin_greenhouse_ros/lupin_greenhouse_msgs': 3}
INTERFACES = ('msg/SensorReading', 'msg/TagReading', 'srv/GetTagReading')

# On a busy machine an example may take any time.
unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
texts = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=40)
doubles = st.floats(allow_nan=True, allow_infinity=True, width=64)
readings = st.fixed_dictionaries(
    {
        'tag_id': texts,
        'sec': st.integers(-(2**31), 2**31 - 1),
        'nanosec': st.integers(0, 2**32 - 1),
        'sim_time_of_day_seconds': doubles,
        'readings': st.lists(st.tuples(texts, doubles), max_size=50),
    }
)


def serialized(message, unset=(2, 3)):
    """Return the bytes of a message, without those that Fast CDR does not set; 2 and 3 are in the header."""
    return bytes(byte for place, byte in enumerate(serialize_message(message)) if place not in unset)


def aligned(text, end):
    """Lengthen a text: with its NUL, it takes this many bytes more than a multiple of 8."""
    return text + '.' * ((end - 1 - len(text.encode())) % 8)


def build(reading_type, sensor_type, values):
    message = reading_type(sim_time_of_day_seconds=values['sim_time_of_day_seconds'])
    message.tag_id = aligned(values['tag_id'], 4)
    message.stamp.sec, message.stamp.nanosec = values['sec'], values['nanosec']
    message.readings = [
        sensor_type(name=aligned(name, 4 if number else 0), value=value)
        for number, (name, value) in enumerate(values['readings'])
    ]
    return message


def both(values):
    return build(TagReading, SensorReading, values), build(MirrorTagReading, MirrorSensorReading, values)


def exchanges(tag_id, status, error_message, values):
    """Return the bytes of a request and its response, of both packages."""
    for service, reading in zip((GetTagReading, MirrorGetTagReading), both(values), strict=True):
        response = service.Response(status=status, error_message=error_message, reading=reading)
        # Three bytes align what follows the status.
        yield serialized(service.Request(tag_id=tag_id)), serialized(response, unset=(2, 3, 5, 6, 7))


@settings(unhurried, max_examples=200)
@given(readings)
def test_both_packages_write_and_read_the_same_bytes(values):
    ours, theirs = both(values)
    expected = serialized(ours)
    assert serialized(theirs) == expected
    assert serialized(deserialize_message(serialize_message(ours), MirrorTagReading)) == expected
    assert serialized(deserialize_message(serialize_message(theirs), TagReading)) == expected


@settings(unhurried, max_examples=100)
@given(readings, texts, st.integers(0, 255))
def test_both_services_write_the_same_bytes(values, text, status):
    ours, theirs = exchanges(aligned(text, 4), status, aligned(text, 0), values)
    assert ours == theirs


def test_the_bytes_are_those_of_the_contract():
    """Without this, the same change of both packages would pass."""
    values = {'tag_id': '101', 'sec': 1, 'nanosec': 2, 'sim_time_of_day_seconds': 43200.0}
    values['readings'] = [('methane', 1.5), ('co2', 600.0)]
    header, tag_id = b'\0\1', b'\4\0\0\0' + b'101\0'  # CDR, little-endian
    reading = (
        b'\1\0\0\0\2\0\0\0'  # stamp
        b'\0\0\0\0\0\x18\xe5\x40'  # sim_time_of_day_seconds
        b'\2\0\0\0'  # readings
        b'\x08\0\0\0methane\0\0\0\0\0\0\0\xf8\x3f'
        b'\4\0\0\0co2\0\0\0\0\0\0\xc0\x82\x40'
    )
    response = header + b'\2' + b'\x08\0\0\0failure\0' + tag_id + reading
    assert list(exchanges('101', 2, 'failure', values)) == [(header + tag_id, response)] * 2
    # The bytes of a uint16 would be the same.
    assert GetTagReading.Response.get_fields_and_field_types()['status'] == 'uint8'


def type_description(package, interface):
    path = get_package_share_path(package) / f'{interface}.json'
    return json.loads(path.read_text().replace('lupin_greenhouse_msgs', 'lupin_msgs'))


@pytest.mark.parametrize('interface', INTERFACES)
def test_the_type_descriptions_are_equal_but_for_the_package_name(interface):
    ours, theirs = (
        type_description(package, interface) for package in ('lupin_msgs', 'lupin_greenhouse_msgs')
    )
    assert ours['type_description_msg'] == theirs['type_description_msg']
    assert ours['type_description_msg']['type_description']['fields']
    assert ours['type_hashes'] != theirs['type_hashes']  # a hash includes the name of the package


def test_constants_do_not_enter_the_type_hash_and_fields_do():
    """So our addition, STATUS_SIMULATOR_ERROR, does not break compiled clients."""
    description = type_description('lupin_msgs', 'srv/GetTagReading')
    hashes = {entry['type_name']: entry['hash_string'] for entry in description['type_hashes']}
    hashed = description['type_description_msg']
    assert calculate_type_hash(hashed) == hashes['lupin_msgs/srv/GetTagReading']
    assert 'STATUS' not in json.dumps(hashed)
    renamed = json.loads(json.dumps(hashed).replace('error_message', 'message'))
    assert calculate_type_hash(renamed) != calculate_type_hash(hashed)


@pytest.mark.parametrize('package', PACKAGES)
def test_cmake_lists_every_interface_on_disk_and_every_package_that_one_uses(package):
    folder = ROOT / package
    interfaces = {path.relative_to(folder).as_posix(): path.read_text() for path in folder.glob('*/*.*')}
    cmake = (folder / 'CMakeLists.txt').read_text()
    assert re.findall(r'^  "(\S+)"$', cmake, re.MULTILINE) == sorted(interfaces)
    assert len(interfaces) == PACKAGES[package]
    used = set(re.findall(r'^([a-z_]+)/\w+', ''.join(interfaces.values()), re.MULTILINE))
    assert used == set(re.search(r'DEPENDENCIES ([a-z_ ]+)', cmake)[1].split())
    assert all(f'<depend>{each}</depend>' in (folder / 'package.xml').read_text() for each in used)
