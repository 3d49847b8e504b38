"""
Correct the Python paths in the exported CMake files of the ROS wheels.

The wheels were built in a container, and their CMake exports name its folders (/opt/python/cp3XX-cp3XX/...).
CMake then fails with "Imported target ... includes non-existent path". A second run changes nothing.
"""

import re
import sys
import sysconfig
from pathlib import Path

BUILD_PYTHON = r'/opt/python/cp3\d+-cp3\d+'
FOLDERS = (
    (re.compile(BUILD_PYTHON + r'/include/python3\.\d+'), sysconfig.get_path('include')),
    (re.compile(BUILD_PYTHON + r'/lib/python3\.\d+/site-packages'), sysconfig.get_path('purelib')),
)


def repair(prefix: Path) -> list[Path]:
    """Rewrite the CMake exports below prefix/share; return the files that changed."""
    changed = []
    for path in sorted(prefix.glob('share/*/cmake/**/*.cmake')):
        before = after = path.read_text(encoding='utf-8')
        for build_folder, here in FOLDERS:
            after = build_folder.sub(lambda _match, here=here: here, after)
        if after != before:
            # A new file: the old one may be a hard link into the cache of uv, which other environments share.
            path.unlink()
            path.write_text(after, encoding='utf-8')
            changed.append(path)
    return changed


if __name__ == '__main__':
    print(f'{len(repair(Path(sys.prefix)))} CMake files repaired')
