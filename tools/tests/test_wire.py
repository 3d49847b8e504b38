"""
The two message packages in one workspace: the same bytes on the wire, and the same types except for the name.

Fast CDR does not set the bytes that only align what follows. The encoder of this test tells where these are,
to mask them, and what all other bytes must be.
"""

import json
import os
import re
import struct
import sys
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
from rosidl_adapter import convert_to_idl
from rosidl_generator_type_description import generate_type_hash

ROOT = Path(__file__).resolve().parents[2]
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


class Cdr:
    """Plain little-endian CDR with its 4-byte header (OMG DDSI-RTPS), and which bytes have a meaning."""

    def __init__(self):
        self.body = bytearray()
        self.padding = set()

    def put(self, form, value):
        while len(self.body) % struct.calcsize(form):
            self.padding.add(len(self.body) + 4)
            self.body.append(0)
        self.body += struct.pack(f'<{form}', value)

    def put_text(self, text):
        encoded = text.encode() + b'\0'
        self.put('I', len(encoded))
        self.body += encoded

    def put_reading(self, values):
        self.put_text(values['tag_id'])
        self.put('i', values['sec'])
        self.put('I', values['nanosec'])
        self.put('d', values['sim_time_of_day_seconds'])
        self.put('I', len(values['readings']))
        for name, value in values['readings']:
            self.put_text(name)
            self.put('d', value)

    def is_equal(self, serialized):
        expected = b'\0\1\0\0' + self.body
        # The serializer may pad to a multiple of 4.
        return len(expected) <= len(serialized) < len(expected) + 4 and all(
            a == b
            for place, (a, b) in enumerate(zip(expected, serialized, strict=False))
            if place not in self.padding and place not in (2, 3)
        )


def build(reading_type, sensor_type, values):
    message = reading_type(tag_id=values['tag_id'], sim_time_of_day_seconds=values['sim_time_of_day_seconds'])
    message.stamp.sec, message.stamp.nanosec = values['sec'], values['nanosec']
    message.readings = [sensor_type(name=name, value=value) for name, value in values['readings']]
    return message


def both(values):
    return build(TagReading, SensorReading, values), build(MirrorTagReading, MirrorSensorReading, values)


@settings(unhurried, max_examples=200)
@given(readings)
def test_the_same_reading_is_the_same_bytes(values):
    expected = Cdr()
    expected.put_reading(values)
    ours, theirs = map(serialize_message, both(values))
    assert len(ours) == len(theirs)
    assert expected.is_equal(ours)
    assert expected.is_equal(theirs)
    assert expected.is_equal(serialize_message(deserialize_message(ours, MirrorTagReading)))
    assert expected.is_equal(serialize_message(deserialize_message(theirs, TagReading)))


@settings(unhurried, max_examples=100)
@given(readings, texts, st.integers(0, 255))
def test_the_same_exchange_is_the_same_bytes(values, text, status):
    request = Cdr()
    request.put_text(text)
    response = Cdr()
    response.put('B', status)
    response.put_text(text)
    response.put_reading(values)
    for service, reading in zip((GetTagReading, MirrorGetTagReading), both(values), strict=True):
        assert request.is_equal(serialize_message(service.Request(tag_id=text)))
        answer = service.Response(status=status, error_message=text, reading=reading)
        assert response.is_equal(serialize_message(answer))


def test_a_difference_would_be_seen():
    empty = {'tag_id': '', 'sec': 0, 'nanosec': 0, 'sim_time_of_day_seconds': 0.0, 'readings': []}
    expected = Cdr()
    expected.put_reading(empty)
    for message in both(empty):
        assert expected.is_equal(serialize_message(message))
        message.sim_time_of_day_seconds = 1e-300
        assert not expected.is_equal(serialize_message(message))


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
    own_hash, their_hash = (
        {each['type_name']: each['hash_string'] for each in both['type_hashes']} for both in (ours, theirs)
    )
    assert own_hash.keys() == their_hash.keys()
    name = 'lupin_msgs/' + interface
    assert own_hash[name] != their_hash[name]  # the hash includes the name of the package


def hash_of_get_tag_reading(folder, text):
    """Return the RIHS01 hash of GetTagReading.srv with this text, by ROS's own generator."""
    package = folder / 'lupin_msgs'
    tuples = []
    for interface in INTERFACES:
        path = next((ROOT / 'monorepo/lupin_msgs').glob(f'{interface}.*'))
        source = package / path.relative_to(ROOT / 'monorepo/lupin_msgs')
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_text(text if path.suffix == '.srv' else path.read_text())
        relative = source.relative_to(package)
        convert_to_idl(package, 'lupin_msgs', relative, package)
        tuples.append(f'{package}:{relative.with_suffix(".idl")}')
    arguments = folder / 'arguments.json'
    prefix = Path(sys.prefix) if (Path(sys.prefix) / 'share/service_msgs').exists() else None
    prefixes = [prefix] if prefix else list(map(Path, os.environ['AMENT_PREFIX_PATH'].split(':')))
    dependencies = ('builtin_interfaces', 'service_msgs')
    included = [
        f'{name}:{each / "share" / name}' for name in dependencies for each in prefixes
        if (each / 'share' / name).exists()
    ]  # fmt: skip
    arguments.write_text(
        json.dumps(
            {
                'package_name': 'lupin_msgs',
                'output_dir': str(folder / 'out'),
                'idl_tuples': tuples,
                'include_paths': included,
            }
        )
    )
    generate_type_hash(str(arguments))
    hashes = json.loads((folder / 'out/srv/GetTagReading.json').read_text())['type_hashes']
    return next(each['hash_string'] for each in hashes if each['type_name'] == 'lupin_msgs/srv/GetTagReading')


def test_constants_do_not_enter_the_type_hash_and_fields_do(tmp_path):
    """So our addition, STATUS_SIMULATOR_ERROR, does not break compiled clients."""
    text = (ROOT / 'monorepo/lupin_msgs/srv/GetTagReading.srv').read_text()
    without = re.sub(r'uint8 STATUS_SIMULATOR_ERROR=2.*\n', '', text)
    renamed = text.replace('string error_message', 'string message')
    assert text not in (without, renamed)
    as_is, without_constant, with_other_field = (
        hash_of_get_tag_reading(tmp_path / name, each)
        for name, each in (('as_is', text), ('without', without), ('renamed', renamed))
    )
    (built,) = {
        each['hash_string']
        for each in type_description('lupin_msgs', 'srv/GetTagReading')['type_hashes']
        if each['type_name'] == 'lupin_msgs/srv/GetTagReading'
    }
    assert as_is == built == without_constant
    assert with_other_field != built
