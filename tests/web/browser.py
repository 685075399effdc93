# SPDX-License-Identifier: Apache-2.0
"""Drives a headless Chromium over its debugging pipe, without packages beside Python's own."""

import base64
import functools
import itertools
import json
import os
import pathlib
import select
import shutil
import subprocess
import tempfile
import time


def find_chromium():
    """The path of a Chromium, or None."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if shutil.which(name):
            return shutil.which(name)
    return None


def check(condition, what):
    """Ends the test where the condition is false."""
    if not condition:
        raise SystemExit(f"FAILED: {what}")


def check_stands_alone(browser, url):
    """That a page asked for nothing but itself, and that its console is silent."""
    others = [r for r in browser.requests if r not in (url, "about:blank")]
    check(others == [], f"the page asks for nothing else: {others}")
    check(browser.errors == [], f"the console is silent: {browser.errors}")


AXE = pathlib.Path(__file__).resolve().parents[2] / "apps/viewer/node_modules/axe-core/axe.min.js"
AXE_RUN = "axe.run(document).then(r => [r.passes.length, r.violations.map(v => v.id + ': ' + v.nodes.map(n => n.html).join(' '))])"


@functools.cache
def axe_core():
    """The text of axe-core, or None; says once that it is missing."""
    if AXE.exists():
        return AXE.read_text()
    print(
        f"skipped: no axe-core, so nothing is said of accessibility; npm ci in {AXE.parents[2]} installs it", flush=True
    )
    return None


def check_accessible(browser, state):
    """Checks that the page as it is now breaks none of axe-core's rules, in light and in dark colours."""
    if axe_core() is None:
        return
    if browser.evaluate("typeof axe") == "undefined":
        browser.evaluate(axe_core() + "; void 0")
    for scheme in ("light", "dark"):
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        passed, violations = browser.evaluate(AXE_RUN)
        check(passed > 5 and violations == [], f"accessible: {state}, {scheme}: {violations}")
    browser.call("Emulation.setEmulatedMedia", features=[])


# What Chromium says of the machine and not of the page: there is no GPU for WebGPU, which a page finds out by asking;
# and the software driver waits where pixels are read.
OF_MACHINE = ("No available adapters.", "GPU stall due to ReadPixels")


# How long an answer may take, in seconds: on a machine of two cores others may compute, too, while the browser draws in
# software.
PATIENCE = 120


class Browser:
    """One page. Collects console errors, exceptions, and requests for anything but the page itself and data URIs."""

    def __init__(self, program, width=1280, height=1000, flags=("--disable-gpu",)):
        self.profile = tempfile.TemporaryDirectory(
            prefix="gsapp-browser-", ignore_cleanup_errors=True
        )  # its helpers may still write
        to_browser, self.write_end = os.pipe()
        self.read_end, from_browser = os.pipe()

        def plumb():
            # The pipe's ends have to be 3 and 4; copies first, in case one of them already is.
            source, target = os.dup(to_browser), os.dup(from_browser)
            os.dup2(source, 3)
            os.dup2(target, 4)

        self.process = subprocess.Popen(
            [
                program,
                "--headless",
                "--remote-debugging-pipe",
                "--no-sandbox",
                "--hide-scrollbars",
                *flags,
                f"--window-size={width},{height}",
                f"--user-data-dir={self.profile.name}",
                "about:blank",
            ],
            preexec_fn=plumb,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self.buffer = b""
        self.ids = itertools.count(1)
        self.session = None
        self.errors, self.requests, self.events = [], [], []
        self.chooser = None  # the input for which the page has asked for a file
        self.downloads = 0  # files saved, if the browser was asked to tell of them
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(domain + ".enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()
        self.profile.cleanup()

    def _receive(self, deadline):
        while b"\0" not in self.buffer:
            if not select.select([self.read_end], [], [], max(0, deadline - time.monotonic()))[0]:
                raise TimeoutError("the browser does not answer")
            part = os.read(self.read_end, 1 << 20)
            if not part:
                raise EOFError("the browser ended")
            self.buffer += part
        line, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(line)

    def _note(self, message):
        method, params = message.get("method"), message.get("params", {})
        self.events.append(method)
        if method == "Runtime.exceptionThrown":
            self.errors.append(params["exceptionDetails"].get("text", "exception"))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert", "warning"):
            self.errors.append(str([a.get("value") for a in params["args"]]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            if not any(text in params["entry"]["text"] for text in OF_MACHINE):
                self.errors.append(params["entry"]["text"])
        elif method == "Browser.downloadProgress" and params["state"] == "completed":
            self.downloads += 1
        elif method == "Page.fileChooserOpened":
            self.chooser = params["backendNodeId"]
        elif method == "Network.requestWillBeSent":
            url = params["request"]["url"]
            if not url.startswith("data:"):
                self.requests.append(url)

    def call(self, method, **params):
        """Sends a command and returns its result; notes what happens meanwhile."""
        number = next(self.ids)
        message = {"id": number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.write_end, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + PATIENCE
        while True:
            answer = self._receive(deadline)
            if answer.get("id") != number:
                self._note(answer)
                continue
            if "error" in answer:
                raise RuntimeError(f"{method}: {answer['error']['message']}")
            return answer["result"]

    def open(self, url):
        self.events.clear()
        self.call("Page.navigate", url=url)
        deadline = time.monotonic() + PATIENCE
        while "Page.loadEventFired" not in self.events:
            self._note(self._receive(deadline))

    def evaluate(self, expression):
        """The value of a JavaScript expression, promises awaited."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in result:
            raise RuntimeError(f"{expression}: {result['exceptionDetails']}")
        return result["result"].get("value")

    def become_phone(self):
        """A phone's screen. Its density comes first, with another height: Chromium may send no event for an emulated
        density that changes alone, or after the size."""
        for height in (639, 640):
            self.call("Emulation.setDeviceMetricsOverride", width=360, height=height, deviceScaleFactor=3, mobile=True)
            deadline = time.monotonic() + PATIENCE
            while self.evaluate("devicePixelRatio") != 3:
                check(time.monotonic() < deadline, f"within {PATIENCE} s the screen is that of a phone")
                time.sleep(0.05)

    def choose_file(self, button, path):
        """Presses a button that asks for a file, and gives it one."""
        self.call("Page.setInterceptFileChooserDialog", enabled=True)
        self.chooser = None
        self.call("Runtime.evaluate", expression=f"document.getElementById('{button}').click()", userGesture=True)
        deadline = time.monotonic() + PATIENCE
        while self.chooser is None:
            self._note(self._receive(deadline))
        self.call("DOM.setFileInputFiles", files=[str(path)], backendNodeId=self.chooser)

    def screenshot(self, path, scale):
        """Saves the whole page as a PNG."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        shot = self.call(
            "Page.captureScreenshot",
            format="png",
            captureBeyondViewport=True,
            clip={"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": scale},
        )
        pathlib.Path(path).write_bytes(base64.b64decode(shot["data"]))

    def press(self, key, code):
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)
