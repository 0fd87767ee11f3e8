#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens a live page in headless Chromium, watches it, presses its stop button, and says what it saw as JSON.

usage: live_browser.py URL PROFILE_FOLDER [SCREENSHOT_FOLDER]

Moves no robot but the one behind the page.
"""

import json
import os
import pathlib
import sys
import time

from browser import Browser

# What counts as coverage: the share of every cell, added up.
FILLED = """[...document.querySelectorAll('.cells i')].reduce((sum, cell) =>
  sum + parseFloat(cell.style.getPropertyValue('--share') || 0) / 100, 0)"""


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
    seen["wanted"] = browser.until("document.querySelectorAll('#twist u:not([hidden])').length", 30)
    seen["guard"] = browser.until("document.querySelector('#guard b')?.textContent ?? ''", 5)
    if pictures:
        time.sleep(float(os.environ.get("LIVE_WATCH_S", "0")))
        browser.screenshot(pictures / "live.png")
    browser.size(390, 844, phone=True)
    time.sleep(0.5)
    seen["phone_overflow"] = browser.overflow()
    if pictures:
        browser.screenshot(pictures / "live_phone.png")
    browser.size(1400, 1000)
    time.sleep(0.5)
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
