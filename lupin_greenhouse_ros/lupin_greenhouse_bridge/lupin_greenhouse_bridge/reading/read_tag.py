# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""`ros2 run lupin_greenhouse_bridge read_tag`: print readings from a running bridge."""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.utilities import remove_ros_args

from lupin_greenhouse_bridge.contract import (
    DEFAULT_SERVICE,
    TAG_IDS_PARAMETER,
    Answer,
    BridgeInfo,
    answer_of,
    info_of,
    info_request,
    parameter_service_of,
)
from lupin_greenhouse_bridge.errors import Interrupted, OneLineError, StartUpError, UsageError
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading.client import Client, NoAnswer
from lupin_greenhouse_bridge.reading.table import CsvPrinter, print_json, print_table
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.arguments import SECONDS, Parser
from lupin_greenhouse_bridge.runtime.run import node_creation, ros
from lupin_greenhouse_bridge.simulator.layout import find_places, natural_order

ALL_READ, SOME_FAILED, USAGE, NO_ANSWER, INTERRUPTED = 0, 1, 2, 3, 130


def main(args: list[str] | None = None) -> int:
    """Print readings as the command line asks; return the exit code."""
    words = sys.argv if args is None else args
    try:
        with ros(words) as executor:
            options = _parse(remove_ros_args(words)[1:])
            with node_creation():
                node = rclpy.create_node('read_tag', start_parameter_services=False)
            executor.add_node(node)
            return _read(Client(executor, node, options.timeout), options)
    except Interrupted:
        return INTERRUPTED
    except OneLineError as error:
        _print_error(error)
        return NO_ANSWER if isinstance(error, NoAnswer) else USAGE


def _print_error(error: object) -> None:
    print(f'read_tag: {error}', file=sys.stderr)


def _read(client: Client, options: argparse.Namespace) -> int:
    """Read once, or round after round, and return the exit code of the last round."""
    service = client.connect(GetTagReading, options.service)
    tag_ids = _loaded_tag_ids(client, service.srv_name) if options.all else options.tag_ids
    show: Callable[[Sequence[Answer]], None] = print_json if options.json else print_table
    if options.csv:
        show = CsvPrinter(_positions_m(client, service.srv_name))
    if options.watch is None:
        return _read_once(client, service, tag_ids, show)
    exit_code = INTERRUPTED
    while not process.is_asked_to_end():
        started = time.monotonic()
        try:
            client.wait_for(service)
            exit_code = _read_once(client, service, tag_ids, show)
        except NoAnswer as error:
            if exit_code != NO_ANSWER:
                _print_error(f'{error}; still watching')
            exit_code = NO_ANSWER
        except Interrupted:
            break
        process.sleep(started + options.watch - time.monotonic())
    return exit_code


def _read_once(
    client: Client, service: Any, tag_ids: Sequence[str], show: Callable[[Sequence[Answer]], None]
) -> int:
    """Read each tag once, and return the exit code; raises NoAnswer and Interrupted."""
    answers = [
        answer_of(tag_id, client.call(service, GetTagReading.Request(tag_id=tag_id))) for tag_id in tag_ids
    ]
    show(answers)
    return ALL_READ if all(answer.is_ok for answer in answers) else SOME_FAILED


def _bridge_info(client: Client, service_name: str) -> BridgeInfo:
    """Return the BridgeInfo of the node that offers a service; raises NoAnswer."""
    parameters = client.connect(GetParameters, parameter_service_of(service_name))
    return info_of(client.call(parameters, info_request()))


def _loaded_tag_ids(client: Client, service_name: str) -> list[str]:
    """Return the ids that the bridge has loaded, in natural order; raises NoAnswer, UsageError."""
    if tag_ids := _bridge_info(client, service_name).tag_ids:
        return sorted(tag_ids, key=natural_order)
    raise UsageError(
        f'the node of {service_name} has no parameter {TAG_IDS_PARAMETER}: name the tag ids instead of --all'
    )


def _positions_m(client: Client, service_name: str) -> dict[str, tuple[float, float]]:
    """Return x and y of the tags in metres by id, from the bridge's tag file; {} if it is unknown."""
    try:
        info = _bridge_info(client, service_name)
        return find_places(info.tag_file) if info.tag_ids else {}
    except (NoAnswer, StartUpError):
        return {}


def _parse(words: list[str]) -> argparse.Namespace:
    """Return the options of the command line; raises UsageError, and SystemExit of argparse."""
    parser = Parser(
        prog='read_tag',
        description='Read the climate at greenhouse tags from a running greenhouse_bridge.',
        epilog='Exit code: 0 all read, 1 a tag failed, 2 usage, 3 no service or no reply before the timeout.'
        ' With --watch, the code of the last round.',
    )
    parser.add_argument('tag_ids', nargs='*', metavar='ID', help='a tag id, such as 1')
    parser.add_argument('--all', action='store_true', help='read every tag that the bridge has loaded')
    parser.add_argument(
        '--watch',
        type=SECONDS,
        metavar='SECONDS',
        help='read the tags again every SECONDS',
    )
    formats = parser.add_mutually_exclusive_group()
    for name, text in (
        ('--json', 'print one JSON object per line, one per tag'),
        ('--csv', 'print one line per value, with the columns of a recorded reading'),
    ):
        formats.add_argument(name, action='store_true', help=text)
    parser.add_argument(
        '--service',
        default=DEFAULT_SERVICE,
        metavar='NAME',
        help='the service to call; default: %(default)s',
    )
    parser.add_argument(
        '--timeout',
        type=SECONDS,
        default=5.0,
        metavar='SECONDS',
        help='how long to wait for the service, and then for each reply; default: %(default)s',
    )
    options = parser.parse_args(words)
    if bool(options.tag_ids) == options.all:
        raise UsageError('name one or more tag ids, or --all, but not both')
    return options
