#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens a report in headless Chromium as on a phone, prints it to PDF, and says what came out as JSON.

usage: report_browser.py PAGE.html FOLDER

Writes into the folder: phone.png, desk.png, report.pdf, and the browser's profile.
"""

import json
import pathlib
import subprocess
import sys

from browser import Browser

# Elements that are cut off: wider than the window and in nothing that scrolls.
CUT = """[...document.querySelectorAll('main *')].filter((element) => {
  if (element.closest('.scroll, nav, pre, svg') || !element.getClientRects().length) return false;
  return element.getBoundingClientRect().right > innerWidth + 1;
}).map((element) => element.tagName + '.' + element.className).slice(0, 5)"""


def pages_of(pdf, folder):
    """Share of every page's pixels that are not white, and that are colored."""
    subprocess.run(["pdftoppm", "-r", "30", str(pdf), str(folder / "page")], check=True)
    pages = []
    for file in sorted(folder.glob("page-*.ppm")):
        _, size, _, pixels = file.read_bytes().split(b"\n", 3)
        count = int(size.split()[0]) * int(size.split()[1])
        rgb = list(zip(pixels[0::3], pixels[1::3], pixels[2::3]))
        pages.append({"ink": sum(min(pixel) < 235 for pixel in rgb) / count,
                      "color": sum(max(pixel) - min(pixel) > 60 for pixel in rgb) / count})
    return pages


def main():
    if len(sys.argv) != 3:
        print(__doc__.split("\n\n")[1], file=sys.stderr)
        return 2
    page, folder = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    folder.mkdir(exist_ok=True)
    browser = Browser(folder / "profile")
    seen = {}
    for name, width, height in (("phone", 390, 844), ("desk", 1300, 900)):
        browser.size(width, height, phone=name == "phone")
        browser.call("Page.navigate", {"url": page.as_uri()})
        drawn = browser.until("Number(document.documentElement.dataset.drawn ?? 0)", 120)
        seen[name] = {"drawn": drawn, "overflow": browser.overflow(), "cut": browser.value(CUT),
                      "blank": browser.value("[...document.querySelectorAll('.chart')].filter((chart) =>"
                                             "chart.getBoundingClientRect().height < 60).length")}
        browser.screenshot(folder / f"{name}.png")
    browser.pdf(folder / "report.pdf")
    seen["complaints"] = browser.complaints
    browser.close()
    seen["pages"] = pages_of(folder / "report.pdf", folder)
    print(json.dumps(seen))
    return 0


if __name__ == "__main__":
    sys.exit(main())
