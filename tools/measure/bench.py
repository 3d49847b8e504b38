"""
Compare the bridge with a plain wrapper of the simulator, which teams used before it, and print a table.

    make bench              two minutes
    make bench SHORT=1      fewer rounds, for a look

Both servers take turns in every round. A ratio is the median of the rounds' ratios, with their quartiles.
"""

import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
from client import Caller, Server, call_together, is_short, own_domain, start_clients

PLAIN_WRAPPER = [sys.executable, str(Path(__file__).with_name('plain_wrapper.py'))]
CLIENTS, BURST = 16, 200
TIMEOUT_SECONDS = 0.1  # for many clients: a longer wait for a lost reply would reduce the number of calls


def in_turns(measure: Callable[[Server], float], servers: list[Server], rounds: int) -> np.ndarray:
    """Measure both servers in every round, in alternating order; return a row per round."""
    results = np.empty((rounds, 2))
    for number in range(rounds):
        for side in (0, 1) if number % 2 else (1, 0):
            results[number, side] = measure(servers[side])
    return results


def print_row(what: str, rounds: np.ndarray) -> None:
    """Print a row of the table."""
    bridge, wrapper = np.median(rounds, axis=0)
    low, middle, high = np.quantile(rounds[:, 0] / rounds[:, 1], (0.25, 0.5, 0.75))
    print(f'| {what} | {bridge:.4g} | {wrapper:.4g} | {middle:.3f} [{low:.3f}, {high:.3f}] |', flush=True)


def measure(servers: list[Server], rounds: int) -> None:
    """Measure, and print the table."""
    services = [server.service for server in servers]
    with closing(Caller(*services)) as caller:
        microseconds: dict[str, list[np.ndarray]] = {service: [] for service in services}

        def time_calls(server: Server) -> float:
            times = []
            for _ in range(50 * rounds):
                started = time.perf_counter()
                caller.call(server.service, '1', 10.0)
                times.append(1e6 * (time.perf_counter() - started))
            microseconds[server.service].append(np.array(times))
            return 0.0

        in_turns(time_calls, servers, rounds + 1)
        for percent in (50, 99):
            # Without the first round, in which calls are slower.
            columns = [np.percentile(microseconds[service][1:], percent, axis=1) for service in services]
            print_row(f'a call, p{percent} (µs)', np.column_stack(columns))
        bursts = in_turns(
            lambda server: caller.burst(server.service, BURST, 2.0), servers, max(2, rounds // 4)
        )
        print_row(f'a burst of {BURST} (calls answered)', bursts)
    clients = start_clients(CLIENTS, *services)

    def calls_per_second(server: Server) -> float:
        seconds = 0.05 * rounds
        return call_together(clients, server.service, seconds, TIMEOUT_SECONDS)['answered'] / seconds

    print_row(f'{CLIENTS} clients (calls/s)', in_turns(calls_per_second, servers, rounds))
    for client in clients:
        client.process.communicate()
    idle = in_turns(lambda server: server.idle_microseconds(0.1 * rounds), servers, max(2, rounds // 4))
    print_row('idle (µs of processor time per s)', idle)


if __name__ == '__main__':
    is_brief = is_short(__doc__)
    with own_domain():
        both = [Server(['bridge_node'], '/subject'), Server(PLAIN_WRAPPER, '/baseline')]
        print('|  | bridge | plain wrapper | ratio [quartiles] |\n|---|---|---|---|', flush=True)
        measure(both, 4 if is_brief else 20)
        for server in both:
            server.close()
