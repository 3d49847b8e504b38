# PYTHON_ARGCOMPLETE_OK
"""`ros2 run lupin_greenhouse_bridge read_tag`: ask a running bridge, as a person does."""

import argparse
import contextlib
import math
import os
import sys
import time

import rclpy
from lupin_msgs.srv import GetTagReading
from rcl_interfaces.srv import GetParameters
from rclpy.exceptions import InvalidServiceNameException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.utilities import remove_ros_args

from lupin_greenhouse_bridge import simulation
from lupin_greenhouse_bridge.errors import BridgeError
from lupin_greenhouse_bridge.reading_table import Screen, json_line, terminal_size

ALL_READ, SOME_FAILED, USAGE, NO_ANSWER, INTERRUPTED = 0, 1, 2, 3, 130
# Every client hears the replies to all; at ROS's depth of 10 those to others can push out its own.
CLIENT_QOS = QoSProfile(depth=1000)
DEFAULT_SERVICE = '/greenhouse_bridge/get_tag_reading'
STATUS_NAMES = {
    GetTagReading.Response.STATUS_OK: 'OK',
    GetTagReading.Response.STATUS_UNKNOWN_TAG: 'UNKNOWN_TAG',
    GetTagReading.Response.STATUS_SIMULATOR_ERROR: 'SIMULATOR_ERROR',
}


class NoAnswer(BridgeError):
    """No service of that name and type, or no reply in time."""


class UsageError(BridgeError):
    """The command line asks for something that cannot be."""


class BridgeClient:
    """Calls services one at a time, each with a time-out, on an executor of its own."""

    def __init__(self, node, timeout_seconds: float):
        self._node = node
        self._timeout_seconds = timeout_seconds
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)

    def connect(self, service_type, service_name: str):
        """Return a client of a service that is there; raises NoAnswer, UsageError."""
        try:
            client = self._node.create_client(service_type, service_name, qos_profile=CLIENT_QOS)
        except InvalidServiceNameException as error:
            raise UsageError(f'--service {service_name!r} is no service name: {error}') from error
        deadline = time.monotonic() + self._timeout_seconds
        with _progress() as show:
            while not client.wait_for_service(timeout_sec=min(self._timeout_seconds, 0.5)):
                remaining_seconds = deadline - time.monotonic()
                if remaining_seconds <= 0.0:
                    raise NoAnswer(self._why_not_there(service_type, client.srv_name))
                show(f'waiting for {client.srv_name}, {remaining_seconds:.0f} s more')
        return client

    def call(self, client, request):
        """Return the response to one request; raises NoAnswer."""
        future = client.call_async(request)
        deadline = time.monotonic() + self._timeout_seconds
        while not future.done():
            remaining_seconds = deadline - time.monotonic()
            if remaining_seconds <= 0.0:
                client.remove_pending_request(future)
                raise NoAnswer(f'{client.srv_name} did not answer within {self._timeout_seconds:g} s')
            self._executor.spin_once(timeout_sec=remaining_seconds)
        return future.result()

    def _why_not_there(self, service_type, service_name: str) -> str:
        """Say in one line that a service was not found, and the likely cause."""
        wanted = f'{service_type.__module__.split(".")[0]}/srv/{service_type.__name__}'
        services = dict(self._node.get_service_names_and_types())
        if others := set(services.get(service_name, [])) - {wanted}:
            return (
                f'{service_name} has the type {others.pop()}, and this client speaks {wanted}:'
                ' use the read_tag of the same repository as the bridge'
            )
        missing = f'no service {service_name} within {self._timeout_seconds:g} s'
        if elsewhere := [
            name for name, types in services.items() if wanted in types and name != service_name
        ]:
            return f'{missing}; there is {elsewhere[0]}: give it with --service'
        domain = f'ROS_DOMAIN_ID {os.environ.get("ROS_DOMAIN_ID") or "0"}'
        if _is_limited_to_this_machine():
            domain += ' of this machine alone (ROS_AUTOMATIC_DISCOVERY_RANGE or ROS_LOCALHOST_ONLY says so)'
        nodes = len(self._node.get_node_names()) - 1  # without this one
        seen = f'{nodes} other nodes, and no bridge' if nodes else 'no other node'
        return (
            f'{missing}; on {domain} there is {seen}: start the bridge (ros2 launch lupin_greenhouse_bridge'
            ' greenhouse_bridge.launch.py), or take the domain that it is on'
        )


def _is_limited_to_this_machine() -> bool:
    return (
        os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'LOCALHOST'
        or os.environ.get('ROS_LOCALHOST_ONLY') == '1'  # Humble's
    )


@contextlib.contextmanager
def _progress():
    """Yield a function that shows a line until the block ends; only a person at a terminal sees it."""
    is_terminal = sys.stderr.isatty()

    def show(text: str) -> None:
        if is_terminal:
            text = text[: terminal_size(sys.stderr)[0] - 1]
            print(f'\r\x1b[K{text}', end='', file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        show('')


def main(args=None):
    """Print readings as the command line asks; return the exit code."""
    is_watching = False
    parser = _parser()
    try:
        options = _parse(parser, _init(args))
        is_watching = options.watch is not None
        bridge = BridgeClient(rclpy.create_node('read_tag', start_parameter_services=False), options.timeout)
        get_tag_reading = bridge.connect(GetTagReading, options.service)
        tag_ids = _all_tag_ids(bridge, get_tag_reading.srv_name) if options.all else options.tag_ids
        exit_code = ALL_READ
        screen = Screen(is_watching)
        while True:
            responses = {}
            for tag_id in tag_ids:
                responses[tag_id] = bridge.call(get_tag_reading, GetTagReading.Request(tag_id=tag_id))
            if options.json:
                lines = (json_line(tag_id, each, STATUS_NAMES) for tag_id, each in responses.items())
                print(*lines, sep='\n', flush=True)
            else:
                screen.show(responses, STATUS_NAMES)
            if any(response.status != GetTagReading.Response.STATUS_OK for response in responses.values()):
                exit_code = SOME_FAILED
            if not is_watching:
                return exit_code
            time.sleep(options.watch)
    except (KeyboardInterrupt, ExternalShutdownException):
        return ALL_READ if is_watching else INTERRUPTED
    except (NoAnswer, UsageError) as error:
        print(f'read_tag: {error}', file=sys.stderr)
        return NO_ANSWER if isinstance(error, NoAnswer) else USAGE
    except BrokenPipeError:  # the reader of the pipe has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ALL_READ
    finally:
        rclpy.try_shutdown()


def _init(args) -> list[str]:
    """Start ROS with its own arguments, and return the others."""
    try:
        rclpy.init(args=args)
        return remove_ros_args(sys.argv if args is None else args)[1:]
    except RuntimeError as error:
        raise UsageError(f'the ROS arguments are not understood: {error}') from error


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='read_tag',
        description='Read the climate at greenhouse tags from a running greenhouse_bridge.',
        epilog='Exit code: 0 all read, 1 some tag failed, 2 usage, 3 no service or no answer in time.',
    )
    ids = parser.add_argument('tag_ids', nargs='*', metavar='ID', type=_tag_id, help='a tag id, such as 1')
    ids.completer = lambda **_: simulation.served_tag_ids('')
    parser.add_argument('--all', action='store_true', help="every tag of the bridge's tag file")
    parser.add_argument(
        '--watch', type=_seconds, metavar='SECONDS', help='read again and again, this far apart'
    )
    parser.add_argument('--json', action='store_true', help='one JSON object per tag and line')
    parser.add_argument('--service', default=DEFAULT_SERVICE, metavar='NAME', help='default: %(default)s')
    parser.add_argument(
        '--timeout',
        type=_seconds,
        default=5.0,
        metavar='SECONDS',
        help='for the service and for each answer; default: %(default)s',
    )
    with contextlib.suppress(ImportError):
        import argcomplete  # comes with ros2cli; without it there is no completion, and no harm

        argcomplete.autocomplete(parser)
    return parser


def _parse(parser: argparse.ArgumentParser, arguments: list[str]) -> argparse.Namespace:
    options = parser.parse_args(arguments)
    if bool(options.tag_ids) == options.all:
        parser.error('give one or more tag ids, or --all')
    return options


def _tag_id(text: str) -> str:
    try:
        text.encode('utf-8')
    except UnicodeEncodeError:
        raise argparse.ArgumentTypeError('a tag id is UTF-8 text') from None
    return text


def _seconds(text: str) -> float:
    with_unit = f'{text!r} is not a number of seconds above 0'
    try:
        seconds = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(with_unit) from None
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(with_unit)
    return seconds


def _all_tag_ids(bridge: BridgeClient, service_name: str) -> list[str]:
    """Return the ids of the tag file that the bridge has loaded, as this machine reads it."""
    node_name = service_name.rpartition('/')[0]
    get_parameters = bridge.connect(GetParameters, f'{node_name}/get_parameters')
    tag_file = bridge.call(get_parameters, GetParameters.Request(names=['tag_file'])).values[0].string_value
    try:
        return sorted(simulation.served_tag_ids(tag_file), key=lambda tag_id: (len(tag_id), tag_id))
    except BridgeError as error:
        raise UsageError(
            f"--all needs the bridge's tag file on this machine: {error}; or name the tag ids"
        ) from error


if __name__ == '__main__':
    sys.exit(main())
