"""A page that is reloaded, slow, closed and opened again in the middle of a trial.

    disturbed.py URL SECONDS
"""

import sys

from desk_page import begin_session, browser, button, expect, go, short_study, shot, tell

# A slow network: 1 Mbit/s, and 100 ms until anything comes.
SLOW = {"offline": False, "latency": 100, "downloadThroughput": 125_000, "uploadThroughput": 125_000}


def recording(page):
    return page.get_by_role("article", name="Recording")


def main(url, seconds):
    with browser(url) as watched:
        context = watched.context()
        page = context.new_page()
        page.goto(url)
        short_study(page, float(seconds))
        begin_session(page)
        button(page, "Ready: begin").click()
        expect(recording(page)).to_be_visible()

        page.reload()
        expect(recording(page)).to_be_visible()
        tell("reloaded")

        devtools = context.new_cdp_session(page)
        devtools.send("Network.enable")
        devtools.send("Network.emulateNetworkConditions", SLOW)
        page.wait_for_timeout(3000)
        expect(recording(page)).to_be_visible()
        shot(page, "disturbed-slow")
        tell("slow for 3 s")

        context.set_offline(True)
        page.wait_for_timeout(2000)
        context.set_offline(False)
        expect(recording(page)).to_be_visible()
        tell("without a network for 2 s")

        page.close()
        page = context.new_page()
        page.goto(url)
        go(page, "Session")
        expect(recording(page)).to_be_visible()
        tell("closed and opened again")
        expect(page.get_by_role("article", name="Verdict")).to_be_visible()


if __name__ == "__main__":
    main(*sys.argv[1:])
