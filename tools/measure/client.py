"""
What the measurements share: a domain, servers, and clients in this process or in one of their own.

As a script, a client in a process of its own. It prints `ready` when each of its services has answered. Then
it reads lines `SERVICE SECONDS TIMEOUT`: it calls the service for so long, one call at a time, each with this
timeout in seconds, and prints its counts as JSON.
"""

import argparse
import atexit
import contextlib
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import domain_coordinator
import rclpy
from lupin_greenhouse_bridge.contract import SERVICE_QOS
from lupin_greenhouse_bridge.interfaces import GetTagReading
from lupin_greenhouse_bridge.testing import NodeProcess
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future

Counts: TypeAlias = 'Counter[str]'  # called, answered, timed out, and swapped: answered for another tag
TAG_IDS = [str(number) for number in range(1, 8)]


def is_short(document: str | None) -> bool:
    """Parse the command line of a measurement; return whether its short form is wanted."""
    parser = argparse.ArgumentParser(description=(document or '').strip().splitlines()[0], allow_abbrev=False)
    parser.add_argument('--short', action='store_true', help='for a look, not for quoting')
    return bool(parser.parse_args().short)


@contextlib.contextmanager
def own_domain() -> Iterator[None]:
    """Use a free domain of this host, here and in each process started from here."""
    with domain_coordinator.domain_id() as domain_id:
        os.environ |= {'ROS_DOMAIN_ID': str(domain_id), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        yield


class Server(NodeProcess):
    """A node as a process that is ready, and does not outlive this one."""

    def __init__(self, command: list[str], namespace: str, **parameters: Any) -> None:
        super().__init__(command, namespace=namespace, **parameters)
        self.service = f'{namespace}/greenhouse_bridge/get_tag_reading'
        atexit.register(self.process.kill)
        self.wait_for_log('ready')

    def idle_microseconds(self, seconds: float) -> float:
        """Return the processor time that all its threads use in a second, measured for so long."""

        def used() -> float:
            tasks = Path(f'/proc/{self.process.pid}/task').glob('*/schedstat')
            return sum(int(task.read_text().split()[0]) for task in tasks) / 1000

        before = used()
        time.sleep(seconds)
        return (used() - before) / seconds


class Caller:
    """Calls services from this process, by a participant of its own."""

    def __init__(self, *services: str) -> None:
        """Wait until each service has answered, because DDS may drop the first requests or replies."""
        context = Context()
        rclpy.init(args=[], context=context)
        self._node = rclpy.create_node(f'measure_{os.getpid()}', context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._clients: dict[str, Client[Any, Any]] = {
            service: self._node.create_client(GetTagReading, service, qos_profile=SERVICE_QOS)
            for service in services
        }
        for service in services:
            while not self.call(service, TAG_IDS[0], 1.0):
                pass

    def call(self, service: str, tag_id: str, timeout_seconds: float) -> Any:
        """Return the response; None after the timeout."""
        client = self._clients[service]
        future = client.call_async(GetTagReading.Request(tag_id=tag_id))
        self._executor.spin_until_future_complete(future, timeout_seconds)
        if not future.done():
            client.remove_pending_request(future)
            return None
        return future.result()

    def call_for(self, service: str, seconds: float, timeout_seconds: float) -> Counts:
        """Call for so long; return the counts."""
        counts: Counts = Counter()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            tag_id = TAG_IDS[counts['called'] % len(TAG_IDS)]
            response = self.call(service, tag_id, timeout_seconds)
            counts['called'] += 1
            counts['answered' if response else 'timed out'] += 1
            counts['swapped'] += bool(response) and response.reading.tag_id != tag_id
        return counts

    def burst(self, service: str, size: int, timeout_seconds: float) -> int:
        """Send so many requests at once; return how many are answered before the timeout."""
        client = self._clients[service]
        futures: list[Future[Any]] = [
            client.call_async(GetTagReading.Request(tag_id=TAG_IDS[0])) for _ in range(size)
        ]
        end = time.monotonic() + timeout_seconds
        while not all(future.done() for future in futures) and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.1)
        for future in futures:
            client.remove_pending_request(future)
        return sum(future.done() for future in futures)

    def close(self) -> None:
        """End the participant."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._node.context)


class ClientProcess:
    """A client in a process of its own."""

    def __init__(self, *services: str) -> None:
        pipes: dict[str, Any] = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE, 'text': True}
        self.process: subprocess.Popen[str] = subprocess.Popen([sys.executable, __file__, *services], **pipes)
        atexit.register(self.process.kill)

    def line(self) -> str:
        """Return the next line that it prints."""
        return next(iter(self.process.stdout or ()))

    def go(self, service: str, seconds: float, timeout_seconds: float) -> None:
        """Let it call a service for so long."""
        print(service, seconds, timeout_seconds, file=self.process.stdin, flush=True)

    def counts(self) -> Counts:
        """Return the counts of what go() began."""
        return Counter(json.loads(self.line()))


def start_clients(count: int, *services: str) -> list[ClientProcess]:
    """Start clients; return them when every service has answered every client."""
    clients = [ClientProcess(*services) for _ in range(count)]
    for client in clients:
        client.line()
    return clients


def call_together(
    clients: list[ClientProcess], service: str, seconds: float, timeout_seconds: float
) -> Counts:
    """Let all clients call a service at once; return the sum of their counts."""
    for client in clients:
        client.go(service, seconds, timeout_seconds)
    return sum((client.counts() for client in clients), Counter())


if __name__ == '__main__':
    caller = Caller(*sys.argv[1:])
    print('ready', flush=True)
    for words in map(str.split, sys.stdin):
        print(json.dumps(caller.call_for(words[0], *map(float, words[1:]))), flush=True)
    caller.close()
