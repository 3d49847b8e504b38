"""
Draw the page of readings and the picture of a mission for the documents.

    make mission DRIVE=1 ARGS="blocked:='0.8 5.0 1.0 5.2' max_poses:=1"   # no path to tag 11
    make figure PAGE=1
"""

import io
import sys
import tempfile
from pathlib import Path

from browser import CHROMIUM, NO_CHROMIUM, Page
from lupin_greenhouse_bridge.display import plot_report, readings_page
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
REPORTS = ROOT / '.mission'
COMMITTED = ROOT / 'tools/core/lupin_greenhouse_bridge/doc/page.png'
REPORT = ROOT / 'monorepo/lupin_mission/doc/report.png'


def main() -> int:
    """Write both pictures of the last mission."""
    reports = sorted(REPORTS.glob('*.jsonl'))  # their names begin with the time
    if not (CHROMIUM and reports):
        missing = 'make mission first, whose report it shows' if CHROMIUM else NO_CHROMIUM
        print(f'page: {missing}', file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'page.html')
        if exit_code := readings_page.main([str(reports[-1]), '-o', str(path)]):
            return exit_code
        with Page(path, width=1280, height=1080) as page:
            picture = Image.open(io.BytesIO(page.picture())).convert('RGB')
    picture.save(COMMITTED, optimize=True)
    print(COMMITTED)
    return plot_report.main([str(reports[-1]), '-o', str(REPORT)])


if __name__ == '__main__':
    sys.exit(main())
