"""`ros2 run lupin_simulation generate_world`: make an SDF world from the layout that the bridge serves."""

import argparse
import sys
from pathlib import Path

from lupin_greenhouse_bridge.errors import OneLineError, StartUpError
from lupin_greenhouse_bridge.planning.walls import Walls, add_wall_options, find_walls
from lupin_greenhouse_bridge.runtime.output import print_line
from lupin_greenhouse_bridge.simulator.layout import Layout, require_layout

DONE, USAGE = 0, 2
MANIFEST = '.generate_world'  # the files that this program writes
SIDE_M = 0.05
SMALLEST_SIDE_M, LARGEST_SIDE_M = 0.01, 0.15  # a larger tag would reach below the tops of the tables


def main(arguments: list[str] | None = None) -> int:
    """Write the world; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='generate_world', description='Make an SDF world of the greenhouse, with its AprilTags.'
    )
    parser.add_argument(
        '--tag-file',
        default='',
        metavar='FILE',
        help="the bridge's tag_file; default: the one of mdp-greenhouse",
    )
    add_wall_options(parser)
    parser.add_argument(
        '--side',
        type=float,
        default=SIDE_M,
        metavar='M',
        help='side of the black square of each tag in metres (default: %(default)g)',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('.world'),
        metavar='FOLDER',
        help='folder for the SDF file and its models; default: %(default)s',
    )
    options = parser.parse_args(arguments)
    try:
        sdf_file, layout, _ = make_world(
            options.output, options.tag_file, options.side, options.sim_config_file, options.walls
        )
    except OneLineError as error:
        print(f'generate_world: {error}', file=sys.stderr)
        return USAGE
    if not layout.tables:
        print('generate_world: the layout has no tables: the tags face its middle', file=sys.stderr)
    print_line(f'{sdf_file}: {len(layout.tags)} tags, {len(layout.tables)} tables')
    return DONE


def make_world(
    folder: Path, tag_file: str = '', side_m: float = SIDE_M, sim_config_file: str = '', walls=None
) -> tuple[Path, Layout, Walls]:
    """Write the world of a tag file; return its SDF file, its layout and walls; raises StartUpError."""
    if not SMALLEST_SIDE_M <= side_m <= LARGEST_SIDE_M:
        limits = f'{SMALLEST_SIDE_M:g} and {LARGEST_SIDE_M:g} m'
        raise StartUpError(f'--side is {side_m:g}: must be between {limits}')
    layout = require_layout(tag_file)
    walls = find_walls(layout, sim_config_file, walls)
    try:
        from lupin_simulation.sdf import SDF_FILE, world_files  # late: a missing library is one line

        write(folder, world_files(layout, walls, side_m))
    except ImportError as error:
        raise StartUpError(f'{error}: sudo apt install python3-opencv python3-pil python3-numpy') from error
    except OSError as error:
        raise StartUpError(f"--output '{folder}': {error.strerror}") from error
    return folder / SDF_FILE, layout, walls


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Replace the files of an earlier world; raises StartUpError before it would overwrite another file."""
    manifest = folder / MANIFEST
    own = set(manifest.read_text(encoding='utf-8').splitlines()) if manifest.is_file() else set()
    for path in files:
        if (folder / path).exists() and path not in own:
            raise StartUpError(
                f"'{folder / path}' exists and is not from generate_world: choose another --output"
            )
    for path in own - set(files):
        if not Path(path).is_absolute() and '..' not in Path(path).parts:
            (folder / path).unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    manifest.write_text('\n'.join([*sorted(files), '']), encoding='utf-8')
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
