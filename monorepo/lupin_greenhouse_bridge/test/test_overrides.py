# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The file of approach overrides."""

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.planning.overrides import Override, read_overrides


@pytest.fixture
def overrides(tmp_path):
    """Return a function that reads overrides of this text."""

    def read(text: str):
        path = tmp_path / f'approach_overrides.{"json" if text.startswith("{") else "yaml"}'
        path.write_text(text, encoding='utf-8')
        return read_overrides(path, {'7', '21'})

    return read


def test_the_overrides_are_read_by_tag_and_an_unknown_tag_is_warned_of(overrides):
    found, (warning,) = overrides(
        'overrides:\n  "7": {yaw: 1, goal_x: 2.5}\n  21:\n  "99": {standoff: 0.4}\n'
    )
    assert found == {'7': Override(yaw=1.0, goal_x=2.5), '21': Override()}
    assert warning.endswith("tag '99' is not in the layout: its override has no effect")
    assert overrides('') == overrides('overrides:\n') == ({}, [])


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (
            'overrides:\n  "7":\n    yaw: 1\n    stand_off: 0.4\n',
            "tag '7': unknown key 'stand_off': use yaw, ",
        ),
        (
            'overrides:\n  "7": {yaw: 1}\n  tilt: {yaw: 1}\n  "21": {tilt: 2}\n',
            "tag '21': unknown key",
        ),
        ('override: {}\n', "unknown key 'override': use overrides"),
        ('overrides: {"7": {standoff: 2.0}}', "tag '7': standoff is 2.0: must be a number from 0.2 to 1.5"),
        ('overrides: {"7": {goal_x: .nan}}', "tag '7': goal_x is nan: must be a number"),
        ('overrides: {"7": {yaw: "north"}}', "tag '7': yaw is 'north': must be a number"),
        ('overrides: [7]', 'is not a mapping, such as {overrides:'),
        ('[7]', 'holds a list at its top level, not a mapping, such as {overrides:'),
        ('overrides: {"7": 1.5}', "tag '7': is not a mapping"),
        ('overrides: {', 'is not YAML'),
        ('{"overrides": {\n\t"7": {"Yaw": 1}}}', "tag '7': unknown key 'Yaw': use yaw"),
    ],
)
def test_a_malformed_override_is_refused_with_its_place(overrides, text, problem):
    with pytest.raises(StartUpError) as refusal:
        overrides(text)
    assert problem in str(refusal.value)
