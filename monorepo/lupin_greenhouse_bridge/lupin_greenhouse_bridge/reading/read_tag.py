# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""`ros2 run lupin_greenhouse_bridge read_tag`: print readings from a running bridge."""

import argparse
import contextlib
import itertools
import os
import re
import shutil
import sys
import time
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from lupin_greenhouse_bridge.contract import (
    DEFAULT_SERVICE,
    TAG_IDS_PARAMETER,
    Answer,
    answer_of,
    parameter_service_of,
    tag_ids_of,
    tag_ids_request,
)
from lupin_greenhouse_bridge.errors import Interrupted, OneLineError, StartUpError, UsageError, escaped
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.reading.client import Client, NoAnswer
from lupin_greenhouse_bridge.reading.table import Csv, Json, Table
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.runtime.arguments import SECONDS, Parser, number_type
from lupin_greenhouse_bridge.runtime.graph import discovery_settings, duplicate_server_warning
from lupin_greenhouse_bridge.runtime.output import Progress
from lupin_greenhouse_bridge.runtime.parameters import check_names
from lupin_greenhouse_bridge.runtime.run import node_creation, ros
from lupin_greenhouse_bridge.simulator.layout import find_places, natural_order

SECURED = 'security is enabled: the bridge needs the same keystore, and keys for this domain'
ALL_READ, SOME_FAILED, USAGE, NO_ANSWER, INTERRUPTED = 0, 1, 2, 3, 130
NO_ID = re.compile(r'[,;=\s]|^all$|^\d+-\d+$')  # what people write who want several tags
AROUND_ID = re.compile(r'[\W_]*(?:tag)?[\W_]*0*(.+?)[\W_]*', re.DOTALL)
COMPLETION_TIMEOUT_SECONDS = 0.3
SILENT_SECONDS = 1.0  # while it waits for the service; a bridge that runs is discovered sooner


def main(args: list[str] | None = None) -> int:
    """Print readings as the command line asks; return the exit code."""
    try:
        with ros(args) as executor:
            words = remove_ros_args(sys.argv if args is None else args)[1:]
            options = _parser(executor).parse_args(words)
            if bool(options.tag_ids) == options.all:
                taken = '' if options.watch is None else f' ({options.watch:g} is the SECONDS of --watch)'
                raise UsageError(f'name one or more tag ids, or --all, but not both{taken}')
            if options.count is not None and options.watch is None:
                raise UsageError('--count needs --watch SECONDS')
            node = _node_in(executor)
            check_names(node)
            return _read(node, Client(executor, node, options.timeout), options)
    except Interrupted:
        return INTERRUPTED
    except OneLineError as error:
        _complain(str(error))
        return NO_ANSWER if isinstance(error, NoAnswer) else USAGE


def _complain(text: str) -> None:
    print(f'read_tag: {text}', file=sys.stderr)


def _node_in(executor: Executor) -> Node:
    with node_creation():
        node = rclpy.create_node('read_tag', start_parameter_services=False)
    executor.add_node(node)
    return node


def _read(node: Node, client: Client, options: argparse.Namespace) -> int:
    """Read once, or round after round, and return the exit code of the last round."""
    get_tag_reading = _connect(node, client, options.service)
    service_name = get_tag_reading.srv_name
    tag_ids = _all_tag_ids(client, service_name) if options.all else options.tag_ids
    output = _output(client, service_name, options)
    hints: dict[str, str] = {}
    rounds = 1 if options.watch is None else options.count
    exit_code, started, warning = INTERRUPTED, 0.0, ''
    answers: list[Answer] = []
    with contextlib.suppress(Interrupted):
        for number in itertools.islice(itertools.count(), rounds):
            if number > 0:
                process.sleep(started + options.watch - time.monotonic())
            if process.is_asked_to_end() or process.has_lost_output():
                break
            started = time.monotonic()
            answers, problem = _round(client, get_tag_reading, tag_ids)
            if problem and options.watch is None:
                raise problem
            if problem and exit_code != NO_ANSWER:
                _complain(f'{problem}: still watching')
            if not options.json:
                answers = [_hinted(each, hints, client, service_name) for each in answers]
            if answers:
                output.show(answers)
            is_read = all(each.is_ok for each in answers)
            exit_code = NO_ANSWER if problem else ALL_READ if is_read else SOME_FAILED
            warning = warning or _warn_of_other_servers(node, service_name)
    return exit_code


def _output(client: Client, service_name: str, options: argparse.Namespace) -> Table | Csv | Json:
    if options.csv:
        return Csv(_places_m(client, service_name))
    return Json() if options.json else Table(is_watched=options.watch is not None)


def _round(client: Client, get_tag_reading: Any, tag_ids: list[str]) -> tuple[list[Answer], NoAnswer | None]:
    """Return the answers for the tags up to the first one without a reply, and the error of that one."""
    answers: list[Answer] = []
    try:
        client.wait_for(get_tag_reading)
        for tag_id in tag_ids:
            response = client.call(get_tag_reading, GetTagReading.Request(tag_id=tag_id))
            answers.append(answer_of(tag_id, response))
    except NoAnswer as error:
        return answers, error
    return answers, None


def _hinted(answer: Answer, hints: dict[str, str], client: Client, service_name: str) -> Answer:
    """Return an answer whose message says what to write instead of an unknown tag, as in `hints` by id."""
    if answer.status != 'UNKNOWN_TAG':
        return answer
    if answer.tag_id not in hints:
        hints[answer.tag_id] = _hint(answer.tag_id, client, service_name)
    return answer._replace(error_message=f'{answer.error_message.rstrip(".")}: {hints[answer.tag_id]}')


def _hint(tag_id: str, client: Client, service_name: str) -> str:
    """Return what to write instead of an unknown tag; asks the bridge for the ones that it has."""
    known: list[str] = []
    with contextlib.suppress(NoAnswer, UsageError):
        known = _all_tag_ids(client, service_name)
    if meant := next((each for each in known if _bare(each) == _bare(tag_id)), ''):
        return f'did you mean {escaped(meant, 64)}?'
    if NO_ID.search(tag_id):
        return 'write tag ids with spaces between them, such as 1 2, or --all'
    return 'see read_tag --all'


def _bare(tag_id: str) -> str:
    """Return an id without the word tag, zeros and signs around it: 1 for tag_01."""
    found = AROUND_ID.fullmatch(tag_id.lower())
    return found[1] if found else tag_id


def _warn_of_other_servers(node: Node, service_name: str) -> str:
    """Print and return a warning if another node offers the service too; it has been discovered by now."""
    if warning := duplicate_server_warning(node, service_name, has_namesakes=True):
        _complain(warning)
    return warning


def _connect(node: Node, client: Client, service: str) -> Any:
    progress = Progress('read_tag', SILENT_SECONDS)
    try:
        return client.connect(GetTagReading, service, progress.say)
    except NoAnswer as error:
        security = f'; {SECURED}' if process.security_problem() else ''
        cause = _likely_cause(node, node.resolve_service_name(service))
        raise NoAnswer(f'{error}; {cause}{security}') from error
    finally:
        progress.clear()


def _parameters_of(client: Client, service_name: str) -> GetParameters.Response:
    """Return the tag ids and the tag file of the node that offers a service; raises NoAnswer."""
    parameters = client.connect(GetParameters, parameter_service_of(service_name))
    return client.call(parameters, tag_ids_request())


def _all_tag_ids(client: Client, service_name: str) -> list[str]:
    """Return the ids that the bridge has loaded, in natural order; raises NoAnswer, UsageError."""
    try:
        tag_ids = tag_ids_of(_parameters_of(client, service_name))
    except NoAnswer as error:
        raise NoAnswer(
            f'{error}: --all asks the node that {service_name} is named after: name the tag ids instead'
        ) from error
    if not tag_ids:
        raise UsageError(
            f'the node of {service_name} has no parameter {TAG_IDS_PARAMETER}, so it is a bridge'
            ' older than 1.1: name the tag ids instead of --all'
        )
    return sorted(tag_ids, key=natural_order)


def _places_m(client: Client, service_name: str) -> dict[str, tuple[float, float]]:
    """Return the positions of the tags in metres by id, from the bridge's tag file; {} if it is unknown."""
    try:
        values = _parameters_of(client, service_name).values
        return find_places(values[-1].string_value) if values else {}
    except (NoAnswer, StartUpError):
        return {}


def _likely_cause(node: Node, service_name: str) -> str:
    """Explain from the ROS graph why the service may be missing."""
    wanted = f'{GetTagReading.__module__.split(".")[0]}/srv/GetTagReading'
    services = dict(node.get_service_names_and_types())
    if others := set(services.get(service_name, [])) - {wanted}:
        return (
            f'{service_name} has the type {others.pop()}, but this client calls {wanted}:'
            ' use the read_tag of the same repository as the bridge'
        )
    if elsewhere := [name for name, types in services.items() if wanted in types and name != service_name]:
        namespace, suffix, _ = elsewhere[0].partition(DEFAULT_SERVICE)
        with_make = f' (make read: NAMESPACE={namespace or "/"})' if suffix else ''
        return f'there is {elsewhere[0]}: name it with --service{with_make}'
    seen = 'other nodes but no bridge' if len(node.get_node_names()) > 1 else 'no other node'
    launch = 'ros2 launch lupin_greenhouse_bridge greenhouse_bridge.launch.py'
    command = launch if shutil.which('ros2') else 'make run'
    has_server = os.environ.get('ROS_DISCOVERY_SERVER')
    server = ', start the discovery server or unset its variable' if has_server else ''
    return (
        f'{seen} is found with {discovery_settings()}: start the bridge ({command}){server},'
        ' or set these variables as for the bridge'
    )


def _ids_to_complete(executor: Executor) -> list[str]:
    """Return the tag ids of a running bridge that answers immediately, otherwise the shipped ones."""
    try:
        client = Client(executor, _node_in(executor), COMPLETION_TIMEOUT_SECONDS)
        return _all_tag_ids(client, DEFAULT_SERVICE)
    except (NoAnswer, UsageError):
        return list(find_places(''))


def _parser(executor: Executor) -> argparse.ArgumentParser:
    parser = Parser(
        prog='read_tag',
        description='Read the climate at greenhouse tags from a running greenhouse_bridge.',
        epilog='Exit code: 0 all read, 1 a tag failed, 2 usage, 3 no service or no reply before the timeout,'
        ' 4 the output cannot be written. With --watch, the code of the last round.',
    )
    tag_ids: Any = parser.add_argument('tag_ids', nargs='*', metavar='ID', help='a tag id, such as 1')
    tag_ids.completer = lambda **_: _ids_to_complete(executor)
    parser.add_argument('--all', action='store_true', help='read every tag that the bridge has loaded')
    parser.add_argument(
        '--watch',
        type=SECONDS,
        metavar='SECONDS',
        help='read each tag once per round, and start a round every SECONDS',
    )
    rounds = number_type('a whole number above 0, such as 3', int, above=0)
    parser.add_argument('--count', type=rounds, metavar='N', help='end --watch after N rounds')
    formats = parser.add_mutually_exclusive_group()
    for name, text in (
        ('--json', 'print one JSON object for each tag, on a line of its own'),
        ('--csv', 'print one line per value, with the columns of record_readings'),
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
    with contextlib.suppress(ImportError):
        import argcomplete  # installed with ros2cli; without it only the shell completion is missing

        argcomplete.autocomplete(parser)
    return parser
