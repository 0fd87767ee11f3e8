#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens a live page in headless Chromium, watches it, presses its stop button, and says what it saw as JSON.

usage: live_browser.py URL PROFILE_FOLDER [SCREENSHOT_FOLDER]

Moves no robot but the one behind the page. Needs no library: Chromium is driven through its pipe.
"""

import base64
import json
import os
import pathlib
import subprocess
import sys
import time

# What counts as coverage: the share of every cell, added up.
FILLED = """[...document.querySelectorAll('.cells i')].reduce((sum, cell) =>
  sum + parseFloat(cell.style.getPropertyValue('--share') || 0) / 100, 0)"""


class Browser:
    """One page, driven by the DevTools protocol over file descriptors 3 and 4."""

    def __init__(self, profile):
        to_read, self.to_write = os.pipe()
        self.from_read, from_write = os.pipe()

        def connect():
            os.dup2(to_read, 103), os.dup2(from_write, 104)
            os.dup2(103, 3), os.dup2(104, 4)

        self.process = subprocess.Popen(
            ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=connect, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_read), os.close(from_write)
        self.last_id, self.left, self.complaints, self.requests = 0, b"", [], []
        targets = self.call("Target.getTargets", session=None)["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        self.session = self.call("Target.attachToTarget", {"targetId": page, "flatten": True},
                                 session=None)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(domain + ".enable")

    def receive(self):
        while b"\0" not in self.left:
            more = os.read(self.from_read, 1 << 20)
            if not more:
                raise RuntimeError("the browser has gone")
            self.left += more
        message, self.left = self.left.split(b"\0", 1)
        message = json.loads(message)
        method, params = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            thrown = params["exceptionDetails"].get("exception", {})
            self.complaints.append(thrown.get("description", "exception"))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.complaints.append(str([argument.get("value") for argument in params["args"]]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            self.complaints.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        return message

    def call(self, method, params=None, session=""):
        self.last_id += 1
        request = {"id": self.last_id, "method": method, "params": params or {}}
        if session is not None:
            request["sessionId"] = self.session
        os.write(self.to_write, json.dumps(request).encode() + b"\0")
        while True:
            reply = self.receive()
            if reply.get("id") == self.last_id:
                if "error" in reply:
                    raise RuntimeError(f"{method}: {reply['error']}")
                return reply["result"]

    def value(self, expression):
        reply = self.call("Runtime.evaluate", {"expression": expression, "returnByValue": True})
        return reply["result"].get("value")

    def until(self, expression, seconds):
        """The first value of the expression that is true; the last one if the time runs out."""
        end = time.monotonic() + seconds
        while True:
            value = self.value(expression)
            if value or time.monotonic() > end:
                return value
            time.sleep(0.05)

    def size(self, width, height, phone=False):
        self.call("Emulation.setDeviceMetricsOverride",
                  {"width": width, "height": height, "deviceScaleFactor": 2 if phone else 1, "mobile": phone})

    def screenshot(self, file):
        time.sleep(1.0)
        image = self.call("Page.captureScreenshot", {"format": "png", "captureBeyondViewport": True})
        pathlib.Path(file).write_bytes(base64.b64decode(image["data"]))

    def press(self, selector):
        """A click where a person would click."""
        x, y = self.value(f"(() => {{ const box = document.querySelector('{selector}').getBoundingClientRect();"
                          "return [box.x + box.width / 2, box.y + box.height / 2]; })()")
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent",
                      {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1})

    def close(self):
        self.call("Browser.close", session=None)
        self.process.wait(20)


def main():
    if len(sys.argv) not in (3, 4):
        print(__doc__.split("\n\n")[1], file=sys.stderr)
        return 2
    url, profile = sys.argv[1:3]
    pictures = pathlib.Path(sys.argv[3]) if len(sys.argv) == 4 else None
    browser = Browser(profile)
    browser.size(1400, 1000)
    browser.call("Page.navigate", {"url": url})
    seen = {"first_update": browser.until("Number(document.documentElement.dataset.updates ?? 0) > 0", 20)}

    images = set()
    end = time.monotonic() + 20
    while len(images) < 5 and time.monotonic() < end:
        images.add(browser.value("document.querySelector('#big img')?.src ?? ''")[-4000:])
        time.sleep(0.1)
    seen["images"] = len(images - {""})
    seen["decoded"] = browser.value("document.querySelector('#big img').naturalWidth")
    seen["corners"] = browser.until("document.querySelectorAll('#big .corner').length", 20)
    before = browser.value(FILLED)
    seen["filled_before"] = before
    seen["filled_after"] = browser.until(f"(sum => sum > {before} && sum)({FILLED})", 60) or before
    seen["goal"] = browser.until("document.querySelectorAll('#big .goal').length", 60)
    if pictures:
        time.sleep(float(os.environ.get("LIVE_WATCH_S", "0")))
        browser.screenshot(pictures / "live.png")
        browser.size(390, 844, phone=True)
        browser.screenshot(pictures / "live_phone.png")
        browser.size(1400, 1000)
        time.sleep(1.0)
    # Only while the arm moves is it worth stopping.
    seen["moving"] = browser.until("state.arm.speed_mmps > 20", 30)
    seen["pressed_monotonic_s"] = time.monotonic()
    browser.press("#stop")
    seen["ending"] = browser.until("state.ending && state.ending.verdict", 15)
    browser.until("document.getElementById('stop').textContent == 'STOPPED'", 5)
    seen["notice"] = browser.value("document.getElementById('notice').textContent")
    seen["button"] = browser.value("document.getElementById('stop').textContent")
    seen["complaints"] = browser.complaints
    home = url[:url.index("/", 8)]
    seen["strangers"] = [request for request in browser.requests
                         if not request.startswith((home, "data:", "about:"))]
    browser.close()
    print(json.dumps(seen))
    return 0


if __name__ == "__main__":
    sys.exit(main())
