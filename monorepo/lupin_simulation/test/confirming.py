"""A client of confirm_tag, for tests."""

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, call, greet, wait_until
from lupin_msgs.srv import ConfirmTag


class Confirming:
    """Asks whether the camera sees a tag."""

    def __init__(self, node):
        self._client = node.create_client(ConfirmTag, '/perception/confirm_tag', qos_profile=SERVICE_QOS)
        assert self._client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
        greet(self._client, ConfirmTag.Request())  # an empty id is refused at once

    def confirm(self, tag_id: str) -> ConfirmTag.Response:
        """Call the service, and return its response."""
        return call(self._client, ConfirmTag.Request(expected_tag_id=tag_id))

    def confirm_until(self, fragment: str) -> None:
        """Ask for tag 7 until the reason has this text."""
        wait_until(lambda: fragment in self.confirm('7').error_message)
