"""
Measure approach_poses with 300, 1,000 and 10,000 tags that stick out 5 cm of benches.

With --routes, compare routes with those of Google OR-tools, which has 3 s for each. Install it by hand:
pip install ortools.
"""

import argparse
import json
import math
import os
import random
import resource
import subprocess
import tempfile
import time

import numpy as np
from lupin_greenhouse_bridge.planning.approach import ViewingLimits, find_approaches
from lupin_greenhouse_bridge.planning.free_space import VisibilityGraph
from lupin_greenhouse_bridge.planning.route import plan_route
from lupin_greenhouse_bridge.planning.walls import find_walls, walls_around
from lupin_greenhouse_bridge.simulator.layout import Layout, Tag, find_layout
from shared import print_head, print_row

COMMAND = (f'{os.environ["LUPIN_EXECUTABLES"]}/approach_poses', '--tag-file')


def random_layout(seed: int) -> Layout:
    """Return two to seven tables, and 10 to 40 tags that stick out of them."""
    chance, tags, tables = random.Random(seed), {}, {}  # noqa: S311 - the same layouts each time
    for number in range(chance.randint(2, 7)):
        x, y, width, depth = (chance.uniform(*each) for each in ((0, 8), (0, 8), (0.3, 4), (0.3, 0.9)))
        tables[str(number)] = (x, y, x + width, y + depth)
    for number in range(chance.randint(10, 40)):
        x0, y0, x1, y1 = chance.choice(list(tables.values()))
        tags[str(number)] = Tag(chance.uniform(x0, x1), chance.choice((y0 - 0.05, y1 + 0.05)), ['co2'])
    return Layout(tags, tables)


def measure(count: int) -> None:
    """Print how long the command takes for benches of 2 m x 0.6 m in rows, and its most memory."""
    columns, tags, benches = math.ceil(math.sqrt(count / 20)), {}, {}
    for number in range(count):
        bench, place = divmod(number, 10)
        x, y = bench % columns * 3.2, bench // columns * 1.8
        benches[bench] = {'x0': x, 'y0': y, 'x1': x + 2.0, 'y1': y + 0.6}
        tags[number] = {'x': x + 0.2 + place % 5 * 0.4, 'y': y + place // 5 * 0.7 - 0.05, 'sensors': ['co2']}
    with tempfile.NamedTemporaryFile('w', suffix='.json') as file:
        json.dump({'tags': tags, 'tables': benches}, file)
        file.flush()
        walls = ['-1.6', '-1.6', str(columns * 3.2 + 0.4), str(y + 2.2)]
        begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [*COMMAND, file.name, '--walls', *walls]
        shown = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    used = resource.getrusage(resource.RUSAGE_CHILDREN)  # the most memory of all so far
    processor_s = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    seconds = f'{time.monotonic() - begin:.1f} s', f'{processor_s:.1f} s'
    print_row(*seconds, f'{used.ru_maxrss // 1024} MB', shown.splitlines()[-1])


def or_tools_m(lengths_m: np.ndarray, first: int) -> float:
    """Return the length of the route that OR-tools finds from one stop to the last, which is beside all."""
    from ortools.constraint_solver import pywrapcp  # imported late: only --routes needs it

    places = pywrapcp.RoutingIndexManager(len(lengths_m), 1, [first], [len(lengths_m) - 1])
    routing = pywrapcp.RoutingModel(places)
    micrometres = np.round(1e6 * lengths_m).astype(int).tolist()
    routing.SetArcCostEvaluatorOfAllVehicles(routing.RegisterTransitMatrix(micrometres))
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.local_search_metaheuristic = 2  # GUIDED_LOCAL_SEARCH
    parameters.time_limit.seconds = 3
    return routing.SolveWithParameters(parameters).ObjectiveValue() / 1e6


def compare(layout: Layout, walls, radius_m: float, start_m) -> None:
    """Print the lengths of our route and of that of OR-tools."""
    poses, _, free_space, *_ = find_approaches(layout, walls, ViewingLimits(radius_m), start_m=start_m)
    route_m = plan_route(free_space, poses, start_m, 'shortest').length_m
    stops = np.array([start_m] * (start_m is not None) + [each[:2] for each in poses.values()])
    graph, lengths_m = VisibilityGraph(free_space, stops), np.zeros((len(stops) + 1,) * 2)
    for number in range(len(stops)):
        for other, length_m in graph.nearest(number):
            lengths_m[number, other] = length_m
    best_m = or_tools_m(lengths_m, 0 if start_m else len(stops))
    case = f'{len(poses)} tags, radius {radius_m} m, start {start_m}'
    print_row(case, f'{route_m:.2f} m', f'{best_m:.2f} m', f'{route_m / best_m - 1.0:+.1%}')


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--routes', action='store_true', help='compare routes with those of OR-tools instead')
    if parser.parse_args().routes:
        print_head('layout', 'route', 'OR-tools', 'longer by')
        shipped = find_layout('')
        for number in range(12):
            radius_m, start_m = (
                (0.1, 0.15, 0.18, 0.2, 0.22, 0.25)[number // 2],
                (None, (0.5, 0.5))[number % 2],
            )
            compare(shipped, find_walls(shipped), radius_m, start_m)
        for layout in map(random_layout, range(20)):
            compare(layout, walls_around(layout), 0.2, None)
    else:
        print_head('time', 'of the processor', 'memory', 'result')
        for count in (300, 1000, 10000):
            measure(count)
