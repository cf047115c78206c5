# SPDX-License-Identifier: BSD-3-Clause
"""Chromium without a window, by the DevTools protocol over two pipes."""

import base64
import io
import json
import os
import select
import signal
import subprocess
import tempfile
import time

import matplotlib.image

FLAGS = [
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--remote-debugging-pipe",
    "--no-first-run", "--disable-extensions", "--hide-scrollbars",
    "--disable-background-networking",
]
TIMEOUT_S = 60


class Browser:
    """A browser; at the end of the `with` block it is closed."""

    def __init__(self, program="chromium", width=1280, height=900):
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        read_end, self.to_browser = os.pipe()
        self.from_browser, write_end = os.pipe()

        def connect():
            # Chromium reads from 3 and writes to 4; high numbers first, so
            # that neither replaces the other.
            os.dup2(os.dup(read_end), 200)
            os.dup2(os.dup(write_end), 201)
            os.dup2(200, 3)
            os.dup2(201, 4)

        self.process = subprocess.Popen(
            [program, *FLAGS, f"--window-size={width},{height}",
             f"--user-data-dir={self.folder.name}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            preexec_fn=connect, close_fds=False, start_new_session=True)
        os.close(read_end)
        os.close(write_end)
        self.received = b""
        self.last_id = 0
        self.events = []
        self.targets = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        # Its children would continue to write to the folder.
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self.to_browser)
        os.close(self.from_browser)
        self.folder.cleanup()

    def send(self, method, session=None, **params):
        """Calls a method of the protocol and returns its result."""
        self.last_id += 1
        message = {"id": self.last_id, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self.to_browser, json.dumps(message).encode() + b"\0")
        while True:
            reply = self.receive(TIMEOUT_S)
            assert reply is not None, f"no answer to {method}"
            if reply.get("id") != self.last_id:
                self.events.append(reply)
                continue
            assert "error" not in reply, f"{method}: {reply['error']}"
            return reply["result"]

    def receive(self, timeout_s):
        """The next message, or None after the time."""
        end = time.monotonic() + timeout_s
        while b"\0" not in self.received:
            left_s = end - time.monotonic()
            if left_s <= 0 or not select.select([self.from_browser], [], [],
                                                left_s)[0]:
                return None
            data = os.read(self.from_browser, 1 << 20)
            assert data, "the browser ended"
            self.received += data
        message, self.received = self.received.split(b"\0", 1)
        return json.loads(message)

    def open(self, url):
        target = self.send("Target.createTarget", url="about:blank")
        self.targets.append(target["targetId"])
        session = self.send("Target.attachToTarget", flatten=True,
                            targetId=target["targetId"])["sessionId"]
        return Page(self, session, url)

    def close_pages(self):
        """Ends all pages, which would go on to draw beside later ones."""
        targets, self.targets = self.targets, []
        for target in targets:
            self.send("Target.closeTarget", targetId=target)
        self.events.clear()


class Page:
    """A page that has been loaded and drawn once."""

    def __init__(self, browser, session, url):
        self.browser = browser
        self.session = session
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        start = time.monotonic()
        self.send("Page.navigate", url=url)
        self.wait_for("document.readyState === 'complete'")
        self.evaluate("new Promise((done) => requestAnimationFrame("
                      "() => requestAnimationFrame(done)))")
        self.opening_s = time.monotonic() - start

    def send(self, method, **params):
        return self.browser.send(method, self.session, **params)

    def evaluate(self, expression):
        """The value of an expression, which may be a promise."""
        result = self.send("Runtime.evaluate", expression=expression,
                           awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait_for(self, condition):
        end = time.monotonic() + TIMEOUT_S
        while not self.evaluate(condition):
            assert time.monotonic() < end, f"never true: {condition}"
            time.sleep(0.05)

    def complaints(self):
        """Exceptions, console messages and requests so far."""
        self.evaluate("0")
        texts = []
        for event in self.browser.events:
            if event.get("sessionId") != self.session:
                continue
            method, params = event["method"], event["params"]
            if method in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled",
                          "Log.entryAdded"):
                texts.append(json.dumps(params))
            if method == "Network.requestWillBeSent":
                url = params["request"]["url"]
                if not url.startswith(("file:", "blob:", "data:")):
                    texts.append(url)
        # Chromium says so of any WebGL without a graphics card.
        return [text for text in texts
                if "GPU stall due to ReadPixels" not in text]

    def click(self, x, y):
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y,
                      button="left", clickCount=1)

    def drag(self, x, y, dx, dy, steps=10):
        self.send("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y,
                  button="left", clickCount=1)
        for i in range(1, steps + 1):
            self.send("Input.dispatchMouseEvent", type="mouseMoved",
                      x=x + dx * i / steps, y=y + dy * i / steps,
                      button="left", buttons=1)
        self.send("Input.dispatchMouseEvent", type="mouseReleased", x=x + dx,
                  y=y + dy, button="left", clickCount=1)

    def touch(self, steps):
        """Fingers at one or more places [(x, y), ...] per step."""
        kind = "touchStart"
        for places in steps:
            self.send("Input.dispatchTouchEvent", type=kind,
                      touchPoints=[{"x": x, "y": y, "id": i}
                                   for i, (x, y) in enumerate(places)])
            kind = "touchMove"
        self.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def press(self, key):
        text = {"text": key} if len(key) == 1 else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key)

    def screenshot(self, path=None):
        """RGB in [0, 1], height x width x 3."""
        data = base64.b64decode(
            self.send("Page.captureScreenshot", format="png")["data"])
        if path:
            with open(path, "wb") as file:
                file.write(data)
        return matplotlib.image.imread(io.BytesIO(data), format="png")[:, :, :3]
