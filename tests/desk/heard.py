"""Full screen, photographs that are taken by themselves, and the tones.

    heard.py URL
"""

import sys

from desk_page import begin_of, begin_session, browser, button, expect, go, shot, short_study, tell, wait_until_ready

# Each oscillator that a page starts is written down: its pitch, when it is due, and whether it can be heard.
LISTEN = """
window.heard = [];
const make = BaseAudioContext.prototype.createOscillator;
BaseAudioContext.prototype.createOscillator = function () {
    const source = make.call(this);
    const start = source.start.bind(source);
    source.start = (when) => {
        window.heard.push({ pitch: source.frequency.value, at_s: when, is_heard: this.state === "running" });
        start(when);
    };
    return source;
};
"""

# Pitches, Hz.
TICK, BEGIN, END, SHUTTER = [587], [880], [660, 440], [784, 1047]

COUNTDOWN_S = 3
SECONDS = 2

# Of whoever stands two metres away.
LETTERS_PX = 35


def heard(page):
    return page.evaluate("window.heard")


def pitches(page):
    assert all(it["is_heard"] for it in heard(page)), heard(page)
    return [it["pitch"] for it in heard(page)]


def fills_the_screen(page, of):
    """The sentence and the picture are in full screen, wholly in sight, and the sentence is large."""
    button(page, "Full screen").click()
    page.wait_for_function("document.fullscreenElement?.matches('.aim')")
    for name in (".sentence", ".picture canvas"):
        part = page.locator(f".aim:fullscreen {name}")
        expect(part).to_be_in_viewport(ratio=0.99)
    letters = page.locator(".sentence").evaluate("it => parseFloat(getComputedStyle(it).fontSize)")
    assert letters >= LETTERS_PX, letters
    shot(page, f"full-screen-{of}")
    page.keyboard.press("Escape")
    page.evaluate("document.fullscreenElement && document.exitFullscreen()")
    page.wait_for_function("!document.fullscreenElement")


def photographs(page):
    """Taken by themselves: a countdown, and a tone at each."""
    go(page, "Calibrate")
    button(page, "Begin").click()
    page.get_by_label("one every").fill("2")
    button(page, "Take 15 by themselves").click()
    countdown = page.locator(".countdown")
    expect(countdown).to_have_text("2")
    expect(countdown).to_have_text("1")
    expect(page.get_by_text(begin_of("2 photographs with the board"))).to_be_visible()
    button(page, "Pause").click()
    expect(button(page, "Pause")).to_be_hidden()
    expect(countdown).to_be_hidden()
    # More may have been taken until it was paused.
    count = len(pitches(page)) // len(SHUTTER)
    assert count >= 2 and pitches(page) == SHUTTER * count, pitches(page)
    first, second = (heard(page)[index * len(SHUTTER)]["at_s"] for index in (0, 1))
    assert second - first > 1.9, (first, second)
    tell(f"{count} photographs were heard")


def trial(page):
    """A countdown, the beginning and the end."""
    before = len(heard(page))
    short_study(page, SECONDS, countdown_s=COUNTDOWN_S)
    begin_session(page)
    button(page, "Ready: begin").click()
    expect(page.get_by_role("article", name="Verdict")).to_be_visible()
    tones = heard(page)[before:]
    assert pitches(page)[before:] == TICK * COUNTDOWN_S + BEGIN + END, tones
    at_s = [it["at_s"] for it in tones]
    tell("seconds from tone to tone: " + " ".join(f"{then - now:.2f}" for now, then in zip(at_s, at_s[1:])))
    # As long as the trial, and no tone before the one that it follows.
    assert at_s == sorted(at_s) and at_s[COUNTDOWN_S + 1] - at_s[COUNTDOWN_S] > SECONDS - 0.5, at_s


def main(url):
    with browser(url) as watched:
        context = watched.context()
        context.add_init_script(LISTEN)
        page = context.new_page()
        page.goto(url)
        wait_until_ready(page)
        go(page, "Aim")
        button(page, "Show the picture").click()
        expect(page.get_by_role("img", name="What the camera sees")).to_be_visible()
        fills_the_screen(page, "aim")
        photographs(page)
        fills_the_screen(page, "photographs")
        go(page, "Aim")
        button(page, "End").click()
        trial(page)


if __name__ == "__main__":
    main(*sys.argv[1:])
