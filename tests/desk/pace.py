"""How long it is from exposure to screen, and whether the page's memory grows.

    pace.py URL SECONDS
"""

import statistics
import sys
import time

from desk_page import box_of, browser, expect, go, tell

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
        for _ in range(STEPS):
            time.sleep(float(seconds) / STEPS)
            heaps.append(heap_bytes(devtools))
            screen_ms = box_of(page)["live"]["screen_ms"]
            if screen_ms:
                delays.append(screen_ms[0])
        settled = heaps[int(SETTLED * STEPS):]
        tell(f"screen_ms {statistics.median(delays):.1f}")
        tell(f"heap_kb {settled[0] / 1000:.0f} {max(settled) / 1000:.0f} {settled[-1] / 1000:.0f}")
        tell(f"rate_hz {box_of(page)['live']['rate_hz']:.1f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
