"""`ros2 run lupin_simulation generate_world`: make an SDF world from the layout that the bridge serves."""

import argparse
import sys
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.runtime.arguments import METRES, Parser
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_greenhouse_bridge.simulator.layout import Layout, require_layout
from lupin_planning.walls import Walls, add_wall_options, find_walls, warning_of_outside

USAGE = 2
MANIFEST = '.generate_world'  # the files that this program writes
SIDE_M = 0.05
SMALLEST_SIDE_M, LARGEST_SIDE_M = 0.01, 0.15  # a larger tag would reach below the tops of the tables


def main(arguments: list[str] | None = None) -> int:
    """Write the world; return the exit code."""
    parser = Parser(
        prog='generate_world', description='Make an SDF world of the greenhouse, with its AprilTags.'
    )
    add_layout_options(parser)
    side = 'side of the black square of each tag in metres (default: %(default)g)'
    parser.add_argument('--side', type=METRES, default=SIDE_M, metavar='M', help=side)
    output = 'folder for the SDF file and its models; default: %(default)s'
    parser.add_argument('--output', type=Path, default=Path('.world'), metavar='FOLDER', help=output)
    options = parser.parse_args(arguments)
    try:
        layout, walls = read_layout(options)
        sdf_file = make_world(options.output, layout, walls, options.side)
    except OneLineError as error:
        print(f'generate_world: {error}', file=sys.stderr)
        return USAGE
    if warning := warning_of_outside(layout, walls):
        print(f'generate_world: {warning}', file=sys.stderr)
    if not layout.tables:
        print('generate_world: the layout has no tables: the tags face its middle', file=sys.stderr)
    print_line(f'{sdf_file}: {len(layout.tags)} tags, {len(layout.tables)} tables')
    return 0


def add_layout_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that read_layout() takes."""
    tag_file = "the bridge's tag_file; default: the one of mdp-greenhouse"
    parser.add_argument('--tag-file', default='', metavar='FILE', help=tag_file)
    add_wall_options(parser)


def read_layout(options: argparse.Namespace) -> tuple[Layout, Walls]:
    """Return the layout and its walls; raises StartUpError for a malformed file."""
    layout = require_layout(options.tag_file)
    return layout, find_walls(layout, options.sim_config_file, options.walls)


def make_world(folder: Path, layout: Layout, walls: Walls, side_m: float = SIDE_M) -> Path:
    """
    Write the world of a layout; return its SDF file.

    `side_m` is the length of the black square of each tag. Raises OneLineError if the world cannot be made.
    """
    if not SMALLEST_SIDE_M <= side_m <= LARGEST_SIDE_M:
        limits = f'{SMALLEST_SIDE_M:g} and {LARGEST_SIDE_M:g} m'
        raise StartUpError(f'--side is {side_m:g}: must be between {limits}')
    try:
        from lupin_simulation.sdf import SDF_FILE, world_files  # late: a missing library is one line

        write_files(folder, world_files(layout, walls, side_m))
    except ImportError as error:
        raise StartUpError(f'{error}: sudo apt install python3-opencv python3-pil python3-numpy') from error
    except OSError as error:
        raise StartUpError(f"--output '{folder}': {error.strerror}: name another folder") from error
    return folder / SDF_FILE


def write_files(folder: Path, files: dict[str, bytes]) -> None:
    """Replace the files of an earlier world; raises StartUpError before it would overwrite another file."""
    manifest = folder / MANIFEST
    own = set(manifest.read_text(encoding='utf-8').splitlines()) if manifest.is_file() else set()
    for foreign in (folder / path for path in files if path not in own):
        if foreign.exists():
            raise StartUpError(f"'{foreign}' exists and is not from generate_world: choose another --output")
    for path in own - set(files):
        if not Path(path).is_absolute() and '..' not in Path(path).parts:
            (folder / path).unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    manifest.write_text('\n'.join([*sorted(files), '']), encoding='utf-8')
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
