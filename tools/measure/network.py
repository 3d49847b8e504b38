"""
Connect two network namespaces, as two hosts, by a cable that loses, delays or corrupts frames.

This process is the cable: it forwards Ethernet frames between two TAP devices. (`tc netem` could do the same,
but the kernels of many virtual machines lack it.) Each call has a timeout of two minutes. Prints one line per
phase. The exit code is 1 if a call was lost or handled twice, and 3 if this machine cannot run it.
"""

import asyncio
import contextlib
import fcntl
import os
import random
import shutil
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from shared import Promises, check_promises, parser_of
from traffic import Bridge, ClientProcess, Counts

HOSTS = (f'robot{os.getpid()}', f'laptop{os.getpid()}')
ROBOT, LAPTOP = (('ip', 'netns', 'exec', host) for host in HOSTS)  # prefix of a command that runs there
CALL_SECONDS = 120
NO_ANSWER = 3  # read_tag's exit code
CANNOT_RUN = 3  # exit code
TUN = Path('/dev/net/tun')
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h
LONGEST_FRAME_BYTES = 65536
IPV4_MULTICAST = b'\x01\x00\x5e'  # the first bytes of such an address (RFC 1112)
UDP_CHECKSUM = slice(40, 42)  # after 14 bytes of Ethernet and 20 of IPv4; 0 is none (RFC 768)
NOT_UTF_8 = b'\xff\xfe\xed\xa0\x80\xc0\xaf\xf5'
DISCOVERY_SERVER = '10.77.0.1:11811'


class Cable:
    """Forwards frames between two hosts, with a chance of loss and a delay."""

    def __init__(self, hosts: tuple[str, str]):
        self.loss = 0.0  # chance of losing a frame, in [0, 1]
        self.delay_seconds = 0.0  # each way
        self.blocks_multicast = False
        self.miswritten = (b'', b'')  # bytes in a frame, and their replacement
        self.sent = self.lost = 0  # frames
        self._ends = [self._plug_in(number, host) for number, host in enumerate(hosts, start=1)]
        self._loop = asyncio.new_event_loop()
        for end, other in zip(self._ends, reversed(self._ends), strict=True):
            self._loop.add_reader(end, self._carry, end, other)
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    @staticmethod
    def _plug_in(number: int, host: str) -> int:
        name = f'tap{os.getpid()}_{number}'
        end = os.open(TUN, os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(end, TUNSETIFF, struct.pack('16sH', name.encode(), IFF_TAP | IFF_NO_PI))
        ip(f'link set {name} netns {host}')
        ip(f'-n {host} address add 10.77.0.{number}/24 dev {name}')
        ip(f'-n {host} address add 10.66.{number}.1/24 dev {name}')  # such as of an arm, for this host alone
        ip(f'-n {host} route add unreachable 10.66.0.0/16')
        ip(f'-n {host} link set {name} up')
        ip(f'-n {host} route add default dev {name}')  # multicast goes that way
        return end

    def _carry(self, end: int, other: int) -> None:
        frame = os.read(end, LONGEST_FRAME_BYTES)
        self.sent += 1
        is_blocked = self.blocks_multicast and frame.startswith(IPV4_MULTICAST)
        if is_blocked or random.random() < self.loss:  # noqa: S311
            self.lost += 1
        else:
            self._loop.call_later(
                self.delay_seconds, self._arrive, other, miswritten(frame, *self.miswritten)
            )

    @staticmethod
    def _arrive(end: int, frame: bytes) -> None:
        with contextlib.suppress(OSError):  # the host is gone
            os.write(end, frame)

    def close(self) -> None:
        """Remove the cable."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        for end in self._ends:
            os.close(end)


def miswritten(frame: bytes, sent: bytes, arrives: bytes) -> bytes:
    """Return a UDP frame with bytes replaced and without a checksum; any other frame unchanged."""
    if not sent or sent not in frame:
        return frame
    frame = frame.replace(sent, arrives)
    return frame[: UDP_CHECKSUM.start] + b'\0\0' + frame[UDP_CHECKSUM.stop :]


def ip(command: str) -> None:
    """Run one ip command; raise CalledProcessError with its output if it fails."""
    subprocess.run(['ip', *command.split()], check=True, capture_output=True, text=True)


@contextlib.contextmanager
def two_hosts() -> Iterator[Cable]:
    """Yield the cable between two hosts, and remove all three at the end."""
    try:
        for host in HOSTS:
            ip(f'netns add {host}')
            ip(f'-n {host} link set lo up')
        cable = Cable(HOSTS)
        yield cable
        cable.close()
    finally:
        for host in HOSTS:
            subprocess.run(['ip', 'netns', 'delete', host], check=False, capture_output=True)


def across_a_bad_cable(scale: int) -> Promises:
    """Call from one host to the other before, during and after each fault."""
    pulled_seconds = 2.0 * scale
    with two_hosts() as cable:
        bridge = Bridge(*ROBOT)
        of_clients = []
        for phase, cable.loss, cable.delay_seconds, calls in (
            ('before', 0.0, 0.0, 40 * scale),
            ('20 % loss and 50 ms delay each way', 0.2, 0.05, 8 * scale),
            ('after', 0.0, 0.0, 40 * scale),
        ):
            sent, lost = cable.sent, cable.lost
            counts = calls_of_laptop(calls)
            of_clients.append(counts)
            sent, lost = cable.sent - sent, cable.lost - lost
            is_kept = (counts['answered'], counts['swapped']) == (calls, 0) and (lost > 0) == (cable.loss > 0)
            yield f'{phase}: {summary_of(counts)}; {lost} of {sent} frames lost', is_kept
        options = ('--seconds', 2.5 * pulled_seconds, '--pause', 0.01, '--timeout', CALL_SECONDS)
        client = ClientProcess(*options, prefix=LAPTOP)
        client.wait_for_first_answer()
        cable.loss = 1.0
        time.sleep(pulled_seconds)
        cable.loss = 0.0
        counts = client.counts()
        is_kept = counts['answered'] == counts['calls'] and counts['slowest'] > 500 * pulled_seconds
        yield f'cable pulled for {pulled_seconds:g} s: {summary_of(counts)}', is_kept
        yield bridge.has_handled([*of_clients, counts])


def calls_of_laptop(calls: int) -> Counts:
    """Return the counts of a client that calls this often."""
    return ClientProcess('--calls', calls, '--timeout', CALL_SECONDS, prefix=LAPTOP).counts()


def read_tags(timeout_seconds: int, *tag_ids: str) -> 'subprocess.CompletedProcess[str]':
    """Run read_tag on the laptop."""
    command = [f'{os.environ["LUPIN_EXECUTABLES"]}/read_tag', '--timeout', str(timeout_seconds), *tag_ids]
    return subprocess.run([*LAPTOP, *command], capture_output=True, text=True, check=False)


def summary_of(counts: Counts) -> str:
    """Return the counts of a client in words."""
    answered = f'{counts["answered"]}/{counts["calls"]} answered, {counts["swapped"]} swapped'
    return f'{answered}, slowest {counts["slowest"] / 1000} s'


@contextlib.contextmanager
def discovery_server() -> Iterator[None]:
    """Run a discovery server on the robot, and use it in each process started from here."""
    address, _, port = DISCOVERY_SERVER.partition(':')
    # 42 stands for `server`, which `fastdds discovery`, the command for people, fills in.
    command = ['fast-discovery-server', '42', '-i', '0', '-l', address, '-p', port]
    os.environ['ROS_DISCOVERY_SERVER'] = DISCOVERY_SERVER
    with subprocess.Popen([*ROBOT, *command], stdout=subprocess.DEVNULL) as server:
        try:
            yield
        finally:
            del os.environ['ROS_DISCOVERY_SERVER']
            server.kill()


def an_id_that_is_no_text(_scale: int) -> Promises:
    """Request a tag id that is not UTF-8. rclpy cannot send one, so the cable writes it into the request."""
    with two_hosts() as cable:
        cable.miswritten = (b'no-UTF-8', NOT_UTF_8)
        bridge = Bridge(*ROBOT)
        run = read_tags(60, 'no-UTF-8', '1')
        refusal, summary = run.stderr.strip(), run.stdout.splitlines()[-1]
        is_refused = '\ufffd' in refusal and 'is not in the loaded greenhouse' in refusal
        yield f'{refusal}; {summary}', is_refused and summary == '1/2 tags read'
        yield bridge.ends_cleanly()


def without_multicast(scale: int) -> Promises:
    """Drop multicast, as campus Wi-Fi does: only a discovery server makes the bridge reachable."""
    with two_hosts() as cable:
        cable.blocks_multicast = True
        seconds = 1 + scale
        bridge = Bridge(*ROBOT)
        exit_code = read_tags(seconds, '1').returncode
        bridge.stop()
        yield f'without a server: exit code {exit_code} after {seconds} s', exit_code == NO_ANSWER
        with discovery_server():
            bridge = Bridge(*ROBOT)
            exit_code = read_tags(60, '1').returncode
            counts = calls_of_laptop(40 * scale)
            text = f'with a server: read_tag exit code {exit_code}, {summary_of(counts)}'
            yield text, (exit_code, counts['answered']) == (0, counts['calls'])
            bridge.stop()


SCENARIOS = [
    across_a_bad_cable,
    an_id_that_is_no_text,
    without_multicast,
]


def main() -> int:
    """Run the phases if this machine can; return the exit code."""
    options = parser_of(__doc__, 'a fifth of everything').parse_args()
    if os.geteuid() != 0 or not shutil.which('ip') or not TUN.exists():
        print(f'test-network: cannot run here: it needs root, {TUN} and ip (sudo apt install iproute2)')
        return CANNOT_RUN
    os.environ |= {
        'ROS_DOMAIN_ID': '0',  # the namespaces are isolated from everything else
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
        'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',  # shared memory would bypass the cable
    }
    try:
        return check_promises(SCENARIOS, 1 if options.short else 5)
    except (PermissionError, subprocess.CalledProcessError) as error:
        reason = str(getattr(error, 'stderr', error)).strip()
        if 'not permitted' not in reason:
            raise  # a fault of this script or of the machine, not missing rights
        print(f'test-network: cannot run here: {reason}')
        return CANNOT_RUN


if __name__ == '__main__':
    sys.exit(main())
