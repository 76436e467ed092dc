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


def opened(browser, address, size_px, asked, console):
    """The page in a window of this size; notes what it asks for and says."""
    page = browser.new_page(viewport=size_px)
    page.set_default_timeout(PATIENCE_MS)
    page.on("request", lambda it: asked.append(it.url))
    page.on("console", lambda it: console.append(it.text))
    page.on("pageerror", lambda it: console.append(str(it)))
    page.goto(address)
    return page


def layout(browser, address, width, console):
    """The page as it is in a window of that width."""
    asked = []
    page = opened(browser, address, {"width": width, "height": 900}, asked, console)
    return page.evaluate(LAYOUT) | {"requests": [it for it in asked if it != address]}


def pictures(browser, address, folder):
    """The page by day, by night and on paper."""
    page = opened(browser, address, SCREEN_PX, [], [])
    # Paper is white, whatever its reader prefers on a screen: so dark comes last.
    for scheme in ["light", "dark"]:
        page.emulate_media(color_scheme=scheme)
        page.screenshot(path=folder / f"{scheme}.png")
    # The margins of the browser's own dialogue.
    margin = dict.fromkeys(["top", "right", "bottom", "left"], "0.4in")
    page.pdf(path=folder / "page.pdf", print_background=True, prefer_css_page_size=True, margin=margin)


def main(chromium, page_file, folder, *widths):
    address, console = Path(page_file).resolve().as_uri(), []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS, timeout=PATIENCE_MS)
        layouts = [layout(browser, address, int(width), console) for width in widths]
        pictures(browser, address, Path(folder))
        browser.close()
    print(json.dumps({"layouts": layouts, "console": console}))


main(*sys.argv[1:])
