"""A headless Chromium driven through its DevTools protocol over a pair of pipes, without further packages."""

from __future__ import annotations

import base64
import itertools
import json
import os
import selectors
import shutil
import subprocess
import time

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
WEBGL = "--enable-unsafe-swiftshader"
"""Lets a machine without a graphics card have WebGL."""
PATIENCE = 60.0
"""Longest wait for anything [s]; never reached by what works."""


def program():
    """Path of a Chromium or Chrome, or None."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


class Chromium:
    """One browser; `Page` opens a tab in it. A context manager.

    Args:
        folder: New folder for its profile.
        flags: Flags besides `FLAGS`.
    """

    def __init__(self, folder, *flags):
        here_in, there_out = os.pipe()
        there_in, here_out = os.pipe()
        # the browser reads its file 3 and writes its file 4; moved out of the way first, in case a pipe got that number
        command = f'exec 8<&{there_in} 9>&{there_out}; exec 3<&8 4>&9 8<&- 9>&-; exec "$0" "$@"'
        self._log = open(folder.with_suffix(".log"), "wb")
        self._process = subprocess.Popen(
            ["bash", "-c", command, program(), *FLAGS, *flags, f"--user-data-dir={folder}", "about:blank"],
            pass_fds=(there_in, there_out),
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
        )
        os.close(there_in)
        os.close(there_out)
        self._in, self._out, self._rest = here_in, here_out, b""
        self._numbers, self._answers, self.listeners = itertools.count(1), {}, {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(here_in, selectors.EVENT_READ)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        try:
            self.call("Browser.close")
            self._process.wait(PATIENCE)
        finally:
            self._process.kill()
            self._process.wait()
            self._selector.close()
            os.close(self._in)
            os.close(self._out)
            self._log.close()

    def call(self, method, session=None, **parameters):
        """Send a command and return its result."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        self.until(lambda: number in self._answers)
        answer = self._answers.pop(number)
        assert "error" not in answer, (method, answer)
        return answer["result"]

    def until(self, condition, patience=PATIENCE):
        """Handle messages until a condition holds; return whether it does."""
        end = time.monotonic() + patience
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                assert patience < PATIENCE, "the browser does not answer"
                return False
            if self._selector.select(left):
                self._read()
        return True

    def _read(self):
        got = os.read(self._in, 1 << 20)
        assert got, "the browser ended"
        *lines, self._rest = (self._rest + got).split(b"\0")
        for line in map(json.loads, lines):
            if "id" in line:
                self._answers[line["id"]] = line
            elif line.get("sessionId") in self.listeners:
                self.listeners[line["sessionId"]](line["method"], line["params"])


class Page:
    """A tab, with everything it complains of and asks the network for.

    Args:
        browser: Its browser.
        width, height: Its size [px].
        dark: Whether its user prefers dark pages.
        scale: Pixels of the screen for one of the page.
    """

    def __init__(self, browser, width=1200, height=900, dark=False, scale=1):
        self._browser = browser
        self.complaints, self.requests, self._loaded = [], [], False
        target = browser.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        browser.listeners[self._session] = self._hear
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=width < 600,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def call(self, method, **parameters):
        """Send a command to the tab and return its result."""
        return self._browser.call(method, self._session, **parameters)

    def go(self, address):
        """Open an address and wait until it is loaded."""
        self._loaded = False
        failed = self.call("Page.navigate", url=address).get("errorText")
        assert not failed, (address, failed)
        self._browser.until(lambda: self._loaded)

    def value(self, expression):
        """Return the value of an expression of JavaScript; a promise is waited for."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, expression):
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.value(expression):
            assert time.monotonic() < end, f"never: {expression}"
            self._browser.until(lambda: False, 0.05)

    def press(self, key, code=0):
        """Press and release a key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def mouse(self, kind, x, y, **more):
        """Move or press the mouse, or turn its wheel."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def picture(self, path, whole=False):
        """Store what is seen (or the whole page) as PNG."""
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=whole, **(self._all() if whole else {}))
        path.write_bytes(base64.b64decode(shot["data"]))
        return path

    def _all(self):
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        return {"clip": {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}}

    def close(self):
        """Close the tab."""
        self.call("Page.close")

    def _hear(self, method, parameters):
        if method == "Page.loadEventFired":
            self._loaded = True
        elif method == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning", "assert"):
            self.complaints.append([argument.get("value") for argument in parameters["args"]])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(parameters["exceptionDetails"])
        elif method == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
            self.complaints.append(parameters["entry"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
