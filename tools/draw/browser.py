"""The Chromium of this machine, without a window, which Playwright controls."""

import contextlib
import shutil
from collections.abc import Iterator

from playwright.sync_api import Browser, sync_playwright

CHROMIUM = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), '')
NO_CHROMIUM = 'Chromium is missing, which opens the page of readings: sudo apt install chromium'


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """Yield the browser, which ends with the block."""
    with sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=CHROMIUM)
