"""The two message packages in one workspace: their bytes, and the interfaces that each builds."""

import re
from pathlib import Path

import pytest
from lupin_greenhouse_msgs import msg as mirror_msg
from lupin_greenhouse_msgs import srv as mirror_srv
from lupin_msgs import msg, srv
from rclpy.serialization import deserialize_message, serialize_message

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {'monorepo/lupin_msgs': 22, 'lupin_greenhouse_ros/lupin_greenhouse_msgs': 3}


@pytest.mark.parametrize(('msg', 'srv'), [(msg, srv), (mirror_msg, mirror_srv)], ids=['monorepo', 'mirror'])
def test_the_bytes_are_those_of_the_contract(msg, srv):
    """Without this, the same change of both packages would pass. The texts need no padding."""
    reading = msg.TagReading(tag_id='101', sim_time_of_day_seconds=43200.0)
    reading.stamp.sec, reading.stamp.nanosec = 1, 2
    values = (('methane', 1.5), ('co2', 600.0))
    reading.readings = [msg.SensorReading(name=name, value=value) for name, value in values]
    response = srv.GetTagReading.Response(status=2, error_message='failure', reading=reading)
    expected = (
        b'\x08\0\0\0failure\0'
        b'\4\0\0\x00101\0'  # tag_id
        b'\1\0\0\0\2\0\0\0'  # stamp
        b'\0\0\0\0\0\x18\xe5\x40'  # sim_time_of_day_seconds
        b'\2\0\0\0'  # readings
        b'\x08\0\0\0methane\0\0\0\0\0\0\0\xf8\x3f'
        b'\4\0\0\0co2\0\0\0\0\0\0\xc0\x82\x40'
    )
    # After the four bytes of the header come the status and three bytes that align what follows.
    sent = serialize_message(response)
    assert (sent[:2], sent[4:5], sent[8:]) == (b'\0\1', b'\2', expected)  # CDR, little-endian
    assert deserialize_message(sent, srv.GetTagReading.Response) == response
    assert serialize_message(srv.GetTagReading.Request(tag_id='101'))[4:] == b'\4\0\0\x00101\0'
    # The bytes of a uint16 would be the same.
    assert response.get_fields_and_field_types()['status'] == 'uint8'


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
