# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium for tests, told what to do over its DevTools protocol on two pipes."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
SWITCHES = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-dev-shm-usage',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--disable-extensions',
    '--hide-scrollbars',
    '--remote-debugging-pipe',
)
PATIENCE = 30.0


def found() -> str | None:
    """The browser's path, None where this machine has none; `CHROMIUM` names another."""
    named = os.environ.get('CHROMIUM')
    return named or next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One page of a browser of its own, `events` as they came. A context manager."""

    def __init__(self, program: str) -> None:
        self.events: list[dict[str, Any]] = []
        self._number = 0
        self._left = b''
        self._profile = tempfile.mkdtemp(prefix='report-browser-')
        # the browser reads from descriptor 3 and writes to 4, whatever ours are
        self._ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in _pipes()]
        reads, self._to, self._from, writes = self._ends

        def give() -> None:
            os.dup2(reads, 3)
            os.dup2(writes, 4)

        words = [program, *SWITCHES, f'--user-data-dir={self._profile}', 'about:blank']
        self._process = subprocess.Popen(
            words,
            preexec_fn=give,
            pass_fds=(3, 4),
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(reads)
        os.close(writes)
        os.set_blocking(self._from, False)
        pages = self.call('Target.getTargets')['targetInfos']
        page = next(one['targetId'] for one in pages if one['type'] == 'page')
        attached = self.call('Target.attachToTarget', targetId=page, flatten=True)
        self._session: str | None = attached['sessionId']
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self._session = None
        try:
            self.call('Browser.close')
            self._process.wait(PATIENCE)
        except (OSError, TimeoutError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        os.close(self._to)
        os.close(self._from)
        shutil.rmtree(self._profile, ignore_errors=True)

    _session = None

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """The answer to one request; what else comes meanwhile goes to `events`."""
        self._number += 1
        request = {'id': self._number, 'method': method, 'params': params}
        if self._session is not None:
            request['sessionId'] = self._session
        os.write(self._to, json.dumps(request).encode() + b'\0')
        while True:
            message = self._next()
            if message.get('id') == self._number:
                assert 'error' not in message, (method, message)
                return message['result']
            self.events.append(message)

    def _next(self) -> dict[str, Any]:
        deadline = time.monotonic() + PATIENCE
        while b'\0' not in self._left:
            if time.monotonic() > deadline:
                raise TimeoutError('the browser does not answer')
            try:
                part = os.read(self._from, 1 << 16)
            except BlockingIOError:
                time.sleep(0.005)
                continue
            if not part:
                raise BrokenPipeError('the browser has ended')
            self._left += part
        message, _, self._left = self._left.partition(b'\0')
        return json.loads(message)

    def show(self, path: Path, width: int, dark: bool = False, media: str = 'screen') -> None:
        """Load a file as a window of that width shows it, and wait until it is drawn."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
        self.call('Emulation.setEmulatedMedia', media=media, features=[scheme])
        self.events.clear()
        self.call('Page.navigate', url=path.as_uri())
        while not any(e.get('method') == 'Page.loadEventFired' for e in self.events):
            self.events.append(self._next())
        self.evaluate('new Promise(done => requestAnimationFrame(() => done(1)))')

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page, of a promise what it comes to."""
        answer = self.call(
            'Runtime.evaluate', expression=script, returnByValue=True, awaitPromise=True
        )
        assert 'exceptionDetails' not in answer, answer
        return answer['result'].get('value')

    def complaints(self) -> list[str]:
        """Console errors and warnings, exceptions and requests since the page was loaded."""
        found = []
        for event in self.events:
            method, params = event.get('method', ''), event.get('params', {})
            if method == 'Runtime.exceptionThrown':
                found.append(str(params['exceptionDetails']))
            if method == 'Runtime.consoleAPICalled' and params['type'] in ('error', 'warning'):
                found.append(str(params['args']))
            if method == 'Log.entryAdded' and params['entry']['level'] in ('error', 'warning'):
                found.append(params['entry']['text'])
            if method == 'Network.requestWillBeSent':
                url = params['request']['url']
                if not url.startswith(('file:', 'data:')):
                    found.append(f'asked for {url}')
        return found

    def picture(self, path: Path) -> None:
        """The whole page as PNG."""
        size = self.call('Page.getLayoutMetrics')['cssContentSize']
        clip = {'x': 0, 'y': 0, 'width': size['width'], 'height': size['height'], 'scale': 1}
        answer = self.call('Page.captureScreenshot', clip=clip, captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(answer['data']))

    def paper(self, path: Path) -> None:
        """The page as it prints on A4, PDF."""
        self.call('Emulation.setEmulatedMedia', media='print')
        answer = self.call(
            'Page.printToPDF', paperWidth=8.27, paperHeight=11.69, preferCSSPageSize=True
        )
        path.write_bytes(base64.b64decode(answer['data']))


def _pipes() -> tuple[int, int, int, int]:
    """Where the browser reads, where we write to it, where we read, where it writes."""
    reads, to = os.pipe()
    from_, writes = os.pipe()
    return reads, to, from_, writes
