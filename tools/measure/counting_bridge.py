"""The bridge, which prints how many requests it has handled when it ends."""

from lupin_greenhouse_bridge.bridge_node import GreenhouseBridgeNode
from lupin_greenhouse_bridge.contract import NODE_NAME
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.run import run


class CountingBridgeNode(GreenhouseBridgeNode):
    """Serves like the bridge."""

    handled = 0

    def _handle_get_tag_reading(
        self, request: GetTagReading.Request, response: GetTagReading.Response
    ) -> GetTagReading.Response:
        self.handled += 1
        return super()._handle_get_tag_reading(request, response)


def print_count(node: CountingBridgeNode) -> int:
    """Print how many requests the node has handled; return the exit code."""
    print(f'requests handled: {node.handled}', flush=True)
    return 0


if __name__ == '__main__':
    process.end(run(NODE_NAME, CountingBridgeNode, conclude=print_count))
