"""The desk is killed in the middle of a trial, and started again.

    restarted.py URL
"""

import sys

from desk_page import ask, begin_session, box_of, browser, button, expect, go, short_study, tell

SECONDS = 600


def main(url):
    # While it is killed, the browser cannot reach it, and says so in its console.
    with browser(url, is_strict=False) as watched:
        page = watched.page()
        short_study(page, SECONDS)
        begin_session(page)
        button(page, "Ready: begin").click()
        expect(page.get_by_role("article", name="Recording")).to_be_visible()
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
