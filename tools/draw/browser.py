"""Open a page in a headless Chromium, and control it by the DevTools protocol."""

import base64
import io
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

LONGEST_LIFE_SECONDS = 120
CHROMIUM = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), '')
COMPLAINTS = ('Runtime.exceptionThrown', 'Runtime.consoleAPICalled', 'Log.entryAdded')
NO_CHROMIUM = 'Chromium is missing, which opens the page of readings: sudo apt install chromium'


class BrowserError(Exception):
    """Chromium has ended, or refused a command."""


class Page:
    """
    One page in its own browser.

    `complaints` has each error of the page and of its console, and `requests` each address that it requested.
    """

    def __init__(self, path: Path, *, width: int = 1280, height: int = 900):
        """Open a file, and wait until it has loaded."""
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self._last_id = 0
        self._session: dict[str, str] = {}
        self._profile = tempfile.TemporaryDirectory(prefix='chromium-')
        # With --remote-debugging-pipe it reads file 3 and writes file 4, with a NUL after each message.
        as_pipes = ('sh', '-c', 'exec "$0" "$@" 3<&0 4>&1 </dev/null >/dev/null 2>&1')
        options = ('--headless', '--no-sandbox', '--disable-gpu', '--hide-scrollbars')
        profile = ('--remote-debugging-pipe', f'--user-data-dir={self._profile.name}')
        command = ['timeout', str(LONGEST_LIFE_SECONDS), *as_pipes, CHROMIUM, *options, *profile]
        environment = {**os.environ, 'TMPDIR': self._profile.name}  # it leaves a folder there
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment)
        self._commands = cast(IO[bytes], self._process.stdin)
        self._messages = self._read(cast(io.BufferedReader, self._process.stdout))
        target = self._call('Target.createTarget', url='about:blank')['targetId']
        session = self._call('Target.attachToTarget', targetId=target, flatten=True)['sessionId']
        self._session = {'sessionId': session}
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self._call(f'{domain}.enable')
        self.resize(width, height)
        self._call('Page.navigate', url=path.resolve().as_uri())
        while next(self._messages).get('method') != 'Page.loadEventFired':
            pass

    def resize(self, width: int, height: int) -> None:
        """Set the size of the window in pixels."""
        view = {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': width < 600}
        self._call('Emulation.setDeviceMetricsOverride', **view)

    def prefer(self, scheme: str) -> None:
        """Set the colour scheme that the reader prefers: `light` or `dark`."""
        feature = {'name': 'prefers-color-scheme', 'value': scheme}
        self._call('Emulation.setEmulatedMedia', features=[feature])

    def wait_for(self, condition: str) -> None:
        """Wait until a JavaScript expression is true; raises BrowserError if Chromium ends before."""
        look = f'const look = () => {condition} ? done() : requestAnimationFrame(look); look();'
        self.evaluate(f'new Promise(done => {{ {look} }})')

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression; a promise is awaited."""
        reply = self._call('Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True)
        if 'exceptionDetails' in reply:
            raise BrowserError(reply)
        return reply['result'].get('value')

    def picture(self, *, is_whole: bool = False) -> bytes:
        """Return the view as PNG, or the whole page."""
        reply = self._call('Page.captureScreenshot', format='png', captureBeyondViewport=is_whole)
        return base64.b64decode(reply['data'])

    def paper(self) -> bytes:
        """Return the printed page as PDF."""
        reply = self._call('Page.printToPDF', printBackground=True, preferCSSPageSize=True)
        return base64.b64decode(reply['data'])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._last_id += 1
        message = {'id': self._last_id, 'method': method, 'params': parameters, **self._session}
        self._commands.write(json.dumps(message).encode() + b'\0')
        self._commands.flush()
        reply = next(each for each in self._messages if each.get('id') == self._last_id)
        if 'error' in reply:
            raise BrowserError(reply)
        result: dict[str, Any] = reply['result']
        return result

    def _read(self, output: io.BufferedReader) -> Iterator[dict[str, Any]]:
        """Yield each message of the browser, and note the errors and the requests of the page."""
        rest = b''
        while part := output.read1():
            *messages, rest = (rest + part).split(b'\0')
            for message in map(json.loads, messages):
                parameters = message.get('params', {})
                if message.get('method') in COMPLAINTS:
                    self.complaints.append(json.dumps(parameters))
                elif message.get('method') == 'Network.requestWillBeSent':
                    self.requests.append(parameters['request']['url'])
                yield message
        raise BrowserError('Chromium has ended')

    def __enter__(self) -> 'Page':
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.communicate()
        self._profile.cleanup()
