"""Every step at three sizes, light and dark: nothing is cut off, and axe-core finds nothing.

    looks.py URL
"""

import re
import sys

from axe_playwright_python.sync_playwright import Axe
from desk_page import api, ask, begin_session, box_of, browser, button, expect, go, link, shot, short_study, wait_until_ready

SIZES = [(1280, 800), (1024, 768), (390, 844)]
SCHEMES = ["light", "dark"]


def look(page, name):
    """At what is shown now. Nobody who looks at it has a command line."""
    said = page.locator("body").inner_text()
    assert not re.search(r"\bplumb |(^|\s)--[a-z]", said), f"{name} names a command: {said}"
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        beyond = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        assert beyond <= 0, f"{name} at {width} px: {beyond} px are beyond the right edge"
        for scheme in SCHEMES:
            page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            violations = Axe().run(page).response["violations"]
            said = [(it["id"], [node["html"][:200] for node in it["nodes"]]) for it in violations]
            assert not said, f"{name} at {width} px, {scheme}: {said}"
            shot(page, f"{name}-{width}-{scheme}")
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})


def main(url):
    with browser(url) as watched:
        page = watched.page()
        wait_until_ready(page)
        button(page, "Examine it").click()
        expect(page.get_by_role("heading", name="The doctor finds")).to_be_visible()
        look(page, "boxes")

        link(page, "Settings").click()
        page.get_by_label("This box has wires").check()
        expect(page.get_by_label("Line for marks")).to_be_visible()
        look(page, "settings")
        go(page, "Print")
        expect(link(page, "Download the targets (PDF)")).to_be_visible()
        page.locator("summary", has_text="For experts").click()
        look(page, "print")

        go(page, "Aim")
        look(page, "aim-before")
        button(page, "Show the picture").click()
        expect(page.get_by_role("article", name="lumbar").get_by_text("Focus")).to_be_visible()
        expect(page.get_by_role("img", name="What the camera sees")).to_be_visible()
        look(page, "aim")

        go(page, "Calibrate")
        look(page, "calibrate-before")
        button(page, "Begin").click()
        ask("show photograph 0")
        for number in (1, 2, 3):
            button(page, "Take one now").click()
            expect(page.locator("summary", has_text="The photographs")).to_be_visible()
            page.wait_for_function("count => document.querySelectorAll('tbody tr').length >= count", arg=number)
            ask(f"show photograph {number}")
        page.locator("summary", has_text="The photographs").click()
        look(page, "calibrate")
        go(page, "Aim")
        button(page, "End").click()

        go(page, "Scene")
        ask("show standing")
        wait_until_ready(page)
        look(page, "scene-before")
        button(page, "Measure").click()
        expect(page.get_by_role("article", name="The scene")).to_be_visible()
        look(page, "scene")
        ask("show person")

        go(page, "Session")
        look(page, "session-first")
        short_study(page, 2, marks=["rises", "zero-not"])
        expect(button(page, "Edit the protocol")).to_be_visible()
        look(page, "session-before")
        button(page, "Edit the protocol").click()
        expect(page.get_by_text("1 trial, at least")).to_be_visible()
        look(page, "protocol")
        button(page, "Leave it as it was").click()
        begin_session(page)
        look(page, "session-instruction")
        button(page, "Skip it").click()
        look(page, "session-reason")
        button(page, "Back").click()
        button(page, "Ready: begin").click()
        expect(page.get_by_role("article", name="Recording")).to_be_visible()
        shot(page, "session-recording")
        expect(page.get_by_role("article", name="Verdict")).to_be_visible()
        look(page, "session-verdict")
        box = box_of(page)
        event = {"step": box["session"]["step"], "event": "accept", "why": "a short trial of a test"}
        api(page, f"/api/boxes/{box['id']}/session/event", event)
        expect(page.get_by_role("heading", name="The session is over")).to_be_visible()
        look(page, "session-over")
        go(page, "Trials")
        expect(page.get_by_role("link", name="Report of")).to_be_visible()
        look(page, "trials")
        go(page, "Study")
        expect(page.get_by_role("link", name="Open the study's report")).to_be_visible()
        look(page, "study")

        go(page, "Boxes")
        link(page, "New box").click()
        page.get_by_label("Name", exact=True).fill("ward 4")
        page.get_by_label("Its own address").select_option(label="a fixed one")
        expect(page.get_by_text("network.address")).to_be_visible()
        look(page, "new-box")
        page.get_by_label("Address and prefix").fill("192.168.1.30/24")
        expect(page.get_by_text("network.address")).to_be_hidden()
        page.get_by_label("For experts").check()
        expect(page.get_by_label("box.toml", exact=True)).to_be_visible()
        button(page, "Make the box").click()
        expect(button(page, "Download box.key")).to_be_visible()
        button(page, "Correct what it has to know").click()
        expect(button(page, "Make its files again")).to_be_visible()
        look(page, "card")


if __name__ == "__main__":
    main(*sys.argv[1:])
