"""
Draw the page of readings and the pictures of a mission, its route and one sensor, for the documents.

    make mission DRIVE=1 ARGS="blocked:='3.0 1.0 3.2 1.2' max_poses:=1 start_pose:='0.5 7.5 0.0'"
    make figure PAGE=1
"""

import io
import sys
import tempfile
from pathlib import Path

from browser import CHROMIUM, NO_CHROMIUM, chromium
from lupin_greenhouse_bridge.display import plot_report, readings_page
from PIL import Image, ImageOps

ROOT = Path(__file__).resolve().parents[2]
REPORTS = ROOT / '.mission'
COMMITTED = ROOT / 'tools/core/lupin_greenhouse_bridge/doc/page.png'
MISSION = ROOT / 'monorepo/lupin_mission/doc'
CUT = 'document.querySelector("#hint").remove(); document.querySelector("#table").getBoundingClientRect().top'
WIDTH, DETAIL, BORDER, SENSOR = 358, 2, '#8c959f', 'temperature'  # as on a phone, in pixels of the page


def main() -> int:
    """Write the pictures of the last mission; the hint of the page is for the page itself."""
    reports = sorted(REPORTS.glob('*.jsonl'))  # their names begin with the time
    if not (CHROMIUM and reports):
        missing = 'make mission first, whose report it shows' if CHROMIUM else NO_CHROMIUM
        print(f'page: {missing}', file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'page.html')
        if exit_code := readings_page.main([str(reports[-1]), '-o', str(path)]):
            return exit_code
        with chromium() as browser:
            page = browser.new_page(viewport={'width': WIDTH, 'height': 900}, device_scale_factor=DETAIL)
            page.goto(path.as_uri())
            height = int(page.evaluate(CUT))
            picture = Image.open(io.BytesIO(page.screenshot(full_page=True))).convert('RGB')
    picture = picture.crop((0, 0, DETAIL * WIDTH, DETAIL * height))
    ImageOps.expand(picture, DETAIL, BORDER).save(COMMITTED, optimize=True)
    print(COMMITTED)
    for name, columns in (('report', '3'), ('report_phone', '1')):
        options = ['--sensor', SENSOR, '--columns', columns, '-o', f'{MISSION / name}.png']
        if exit_code := plot_report.main([str(reports[-1]), *options]):
            return exit_code
    return 0


if __name__ == '__main__':
    sys.exit(main())
