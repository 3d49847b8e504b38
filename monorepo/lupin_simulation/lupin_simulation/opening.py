"""Open an SDF world with Drake, or say in one line why that is not possible."""

from pathlib import Path

from lupin_greenhouse_bridge.errors import StartUpError


def open_world(sdf_file: str | Path):
    """Return the renderer.World of an SDF file; raises StartUpError without Drake, or for another file."""
    try:
        from lupin_simulation.renderer import World  # imported here: a missing library is a one-line error
    except ImportError as error:
        raise StartUpError(f'Drake is missing ({error}): pip install drake') from error
    try:
        return World(sdf_file)
    except RuntimeError as error:
        raise StartUpError(
            f"'{sdf_file}' is not an SDF world: use a world made by generate_world: {error}"
        ) from error
