"""A client of confirm_tag, for tests."""

from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS, call, greet, wait_until
from lupin_msgs.srv import ConfirmTag


class Confirming:
    """Asks whether the camera sees a tag."""

    def __init__(self, node, namespace: str = ''):
        self._client = node.create_client(
            ConfirmTag, f'{namespace}/perception/confirm_tag', qos_profile=SERVICE_QOS
        )
        assert self._client.wait_for_service(timeout_sec=PATIENCE_SECONDS)
        greet(self._client, ConfirmTag.Request())  # an empty id is refused at once

    def confirm(self, tag_id: str) -> ConfirmTag.Response:
        """Call the service, and return its response."""
        return call(self._client, ConfirmTag.Request(expected_tag_id=tag_id))

    def confirm_until(self, fragment: str, tag_id: str = '7') -> str:
        """Call the service until the reason has this text; return the reason."""
        reasons = []

        def is_told():
            reasons.append(self.confirm(tag_id).error_message)
            return fragment in reasons[-1]

        wait_until(is_told)
        return reasons[-1]
