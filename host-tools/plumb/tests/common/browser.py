"""A page in a real Chromium: browser.py CHROMIUM PAGE FOLDER WIDTH...

Writes into the folder how the page looks by day and by night (light.png, dark.png) and on paper
(page.pdf). Prints as JSON what it is like at each width, px, and what was said on the console.
"""

import json
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

# Generous: the machine may be busy with other tests.
PATIENCE_MS = 60_000

ARGUMENTS = [
    # In a container its sandbox has no rights; the pages are this project's own.
    "--no-sandbox",
    # Nothing but the page asks for anything.
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]

# A window that shows the upper part of a page.
SCREEN_PX = {"width": 1280, "height": 2400}

LAYOUT = """() => {
    const size = it => { const { width, height } = it.getBoundingClientRect(); return [width, height]; };
    const page = document.documentElement;
    return {
        client_width: page.clientWidth,
        scroll_width: page.scrollWidth,
        figures: [...document.querySelectorAll("figure")].map(it => size(it.querySelector("svg"))),
    };
}"""


def layout(page, address, width):
    """The page as it is, loaded in a window of that width."""
    asked = []
    page.on("request", lambda it: asked.append(it.url))
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(address)
    return page.evaluate(LAYOUT) | {"requests": [it for it in asked if it != address]}


def main(chromium, page_file, folder, *widths):
    address, folder = Path(page_file).resolve().as_uri(), Path(folder)
    layouts, console = [], []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS, timeout=PATIENCE_MS)
        for width in widths:
            page = browser.new_page()
            page.set_default_timeout(PATIENCE_MS)
            page.on("console", lambda it: console.append(it.text))
            page.on("pageerror", lambda it: console.append(str(it)))
            layouts.append(layout(page, address, int(width)))
        page.set_viewport_size(SCREEN_PX)
        # Paper is white, whatever its reader prefers on a screen: so dark comes last.
        for scheme in ["light", "dark"]:
            page.emulate_media(color_scheme=scheme)
            page.screenshot(path=folder / f"{scheme}.png")
        # As the browser's own dialogue prints it.
        margin = dict.fromkeys(["top", "right", "bottom", "left"], "0.4in")
        page.pdf(path=folder / "page.pdf", print_background=True, prefer_css_page_size=True, margin=margin)
        browser.close()
    print(json.dumps({"layouts": layouts, "console": console}))


main(*sys.argv[1:])
