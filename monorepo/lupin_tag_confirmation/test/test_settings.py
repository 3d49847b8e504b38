"""The parameters of confirm_tag: their types, their limits and the sources."""

import pytest
from lupin_greenhouse_bridge.errors import StartUpError
from lupin_greenhouse_bridge.testing._helpers import check_settings
from lupin_tag_confirmation.settings import Settings


def test_each_parameter_has_its_type_and_its_limits():
    check_settings(Settings)


@pytest.mark.parametrize('source', ['', 'Image', 'video'])
def test_another_source_is_refused(source):
    with pytest.raises(StartUpError) as refusal:
        Settings(source=source)
    assert str(refusal.value) == f'parameter source is {source!r}: must be image, compressed or detections'
