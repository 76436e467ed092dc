"""How long it is from exposure to screen, and whether the page's memory grows.

    pace.py URL SECONDS

Once what is kept of the frames is full, it asks to have the desk's memory looked at.
"""

import statistics
import sys
import time

from desk_page import ask, box_of, browser, expect, tell

# The page's buffers fill up in the first part.
SETTLED = 0.25
STEPS = 12


def heap_bytes(devtools):
    devtools.send("HeapProfiler.collectGarbage")
    metrics = devtools.send("Performance.getMetrics")["metrics"]
    return next(it["value"] for it in metrics if it["name"] == "JSHeapUsedSize")


def main(url, seconds):
    with browser(url) as watched:
        page = watched.page("Session")
        expect(page.get_by_role("img", name="Both trunk points from above")).to_be_visible()
        devtools = page.context.new_cdp_session(page)
        devtools.send("Performance.enable")
        heaps, delays = [], []
        rates = []
        for step in range(STEPS):
            time.sleep(float(seconds) / STEPS)
            heaps.append(heap_bytes(devtools))
            live = box_of(page)["live"]
            rates.append(live["rate_hz"])
            if live["screen_ms"]:
                delays.append(live["screen_ms"][0])
            if step == int(SETTLED * STEPS):
                ask("look at the memory")
        settled = heaps[int(SETTLED * STEPS):]
        tell(f"screen_ms {statistics.median(delays):.1f}")
        tell(f"heap_kb {settled[0] / 1000:.0f} {max(settled) / 1000:.0f} {settled[-1] / 1000:.0f}")
        tell(f"rate_hz {min(rates):.1f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
