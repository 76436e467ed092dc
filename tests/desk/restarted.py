"""The desk is killed in the middle of a trial, and started again.

    restarted.py URL
"""

import sys
import time

from desk_page import ask, begin_session, box_of, browser, button, expect, go, short_study, tell

SECONDS = 600

# Of a trial no more than its last second is lost.
RECORDED_S = 2
PATIENCE_S = 60


def wait_until_recorded(page):
    """Until some of the trial is on the disk: a recording without a frame is none."""
    give_up = time.monotonic() + PATIENCE_S
    while box_of(page)["session"]["at"]["first_frame_at_ms"] is None:
        assert time.monotonic() < give_up, "no frame is recorded"
        time.sleep(0.1)
    time.sleep(RECORDED_S)


def main(url):
    # While it is killed, the browser cannot reach it, and says so in its console.
    with browser(url, is_strict=False) as watched:
        page = watched.page()
        short_study(page, SECONDS)
        begin_session(page)
        button(page, "Ready: begin").click()
        expect(page.get_by_role("article", name="Recording")).to_be_visible()
        wait_until_recorded(page)
        ask("kill the desk")
        expect(page.get_by_text("No connection to the desk.")).to_be_visible()
        again = ask("start the desk")
        # Whoever was signed in by the address of before is asked for the new one.
        expect(page.get_by_text("No connection to the desk.")).to_be_hidden()
        page.goto(again)
        go(page, "Session")
        expect(page.get_by_role("article", name="Verdict")).to_be_visible()
        session = box_of(page)["session"]
        assert len(session["trials"]) == 1 and session["trials"][0]["outcome"] == "open", session["trials"]
        tell(f"it goes on: {session['at']['ended']}")


if __name__ == "__main__":
    main(*sys.argv[1:])
