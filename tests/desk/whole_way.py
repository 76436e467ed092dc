"""From the paper and a new box to a study's report.

    whole_way.py URL mouse|keyboard
"""

import sys
import tempfile
from pathlib import Path

from desk_page import Keyboard, Mouse, ask, begin_of, browser, button, expect, keep, link, shot, tell

PHOTOGRAPHS = 12
SECONDS = 3
# A box that shares a busy computer may have measured a little less when they are over.
COMPARED_S = 2
MEASURED_TIMES_MAX = 3


def sheets(page, hands):
    expect(page.get_by_text("No box is known to this computer.")).to_be_visible()
    hands.press(link(page, "Print"))
    with tempfile.TemporaryDirectory() as folder:
        for name in ("Download the targets (PDF)", "Download the board (PDF)"):
            sheet = keep(page, folder, lambda: hands.press(link(page, name)))
            assert sheet.read_bytes().startswith(b"%PDF"), name
    hands.write(page.get_by_label("Square of the board, mm"), "20.0")
    hands.press(button(page, "Keep what was measured"))
    expect(page.get_by_text("Kept.", exact=True)).to_be_visible()
    shot(page, "way-print")
    hands.press(link(page, "Go on to the boxes"))


def new_box(page, hands):
    hands.press(link(page, "New box"))
    hands.write(page.get_by_label("Name", exact=True), "ward 3")
    hands.write(page.get_by_label("Serial number"), "PL-0003")
    hands.write(page.get_by_label("Size of the frames"), "640x480")
    shot(page, "way-new-box")
    hands.press(button(page, "Make the box"))
    with tempfile.TemporaryDirectory() as card:
        for name in ("config.plb", "box.key"):
            kept = keep(page, card, lambda: hands.press(button(page, f"Download {name}")))
            assert kept.name == name, kept
        shot(page, "way-card")
        ask(f"start {Path(card)}")
    hands.press(link(page, "Go on to the boxes: it is looked for"))


def settings(page, hands):
    card = page.get_by_role("article", name="ward 3")
    expect(card.get_by_text("connected")).to_be_visible()
    hands.press(link(card, "Settings"))
    hands.write(page.get_by_label("Exposure, µs"), "4000")
    hands.press(button(page, "Send them to the box"))
    expect(page.get_by_text("Its settings are shown once the box is heard.")).to_be_hidden()
    # It has restarted with them: there is nothing to send any more.
    expect(button(page, "Send them to the box")).to_be_disabled()
    expect(page.get_by_label("Exposure, µs")).to_have_value("4000")
    shot(page, "way-settings")
    hands.press(link(page, "Back to the boxes"))
    expect(card.get_by_text("the box has restarted with it")).to_be_visible()


def aim(page, hands):
    card = page.get_by_role("article", name="ward 3")
    expect(card.get_by_text("connected")).to_be_visible()
    hands.press(button(page, "Examine it"))
    expect(card.get_by_role("heading", name=begin_of("The doctor finds"))).to_be_visible()
    hands.press(link(page, "Aim the camera"))
    hands.press(button(page, "Show the picture"))
    expect(page.get_by_role("img", name="What the camera sees")).to_be_visible()
    expect(page.get_by_role("article", name="board").get_by_text("Focus")).to_be_visible()
    shot(page, "way-aim")
    hands.press(link(page, "Go on to calibrate"))


def calibrate(page, hands):
    hands.press(button(page, "Begin"))
    taken = page.get_by_text(begin_of("0 photographs with the board"))
    expect(taken).to_be_visible()
    for number in range(PHOTOGRAPHS):
        ask(f"show photograph {number}")
        pictures = picture_number(page)
        page.wait_for_function("from => Number(document.querySelector('.picture canvas').dataset.picture) > from + 1", arg=pictures)
        hands.press(button(page, "Take one now"))
        words = f"{number + 1} photograph{'s' if number else ''} with the board"
        expect(page.get_by_text(begin_of(words))).to_be_visible()
    hands.press(button(page, "Calibrate with these"))
    expect(page.get_by_role("article", name="The calibration")).to_be_visible()
    shot(page, "way-calibrate")
    hands.press(button(page, "Give it to the box"))
    expect(page.get_by_text("The box has this camera.")).to_be_visible()
    hands.press(link(page, "Go on to the scene"))


def picture_number(page):
    return int(page.locator(".picture canvas").get_attribute("data-picture") or 0)


def scene(page, hands):
    ask("show standing")
    measured = page.get_by_role("article", name="The scene")
    for _ in range(MEASURED_TIMES_MAX):
        hands.press(button(page, "Measure"))
        expect(page.get_by_role("progressbar")).to_be_visible()
        failed = page.get_by_role("alert")
        expect(measured.or_(failed).first).to_be_visible()
        if measured.is_visible():
            break
        # Of a box that shares a busy computer too little may have been heard: then a person measures again.
        words = failed.first.inner_text()
        assert "are needed" in words, words
        tell(f"the scene: {words}")
    hands.press(button(page, "Keep it in the box"))
    expect(page.get_by_role("heading", name="The box has this scene")).to_be_visible()
    shot(page, "way-scene")
    hands.press(link(page, "Go on to a session"))


def prepare(page, hands):
    ask("show person")
    hands.write(page.get_by_label("Title"), "Quiet standing")
    hands.choose(page.get_by_label("Protocol to begin with"), "Eyes open, eyes closed")
    hands.press(button(page, "Make the study"))
    hands.press(button(page, "Edit the protocol"))
    hands.write(page.get_by_label("Rest between trials, s"), "0")
    hands.write(page.get_by_label("Countdown, s"), "1")
    hands.write(page.get_by_label("Repeats of each"), "1")
    hands.write(page.get_by_label("Times that are compared, s"), f"0 to {COMPARED_S}")
    for number in (1, 2):
        condition = page.get_by_role("group", name=f"Condition {number}")
        hands.write(condition.get_by_label("Measured for, s"), str(SECONDS))
    expect(page.get_by_text(begin_of("2 trials, at least"))).to_be_visible()
    shot(page, "way-protocol")
    hands.press(button(page, "Save the protocol"))
    hands.write(page.get_by_label("Code"), "P01")
    hands.write(page.get_by_label("Age, years"), "71")
    hands.choose(page.get_by_label("Sex"), "female")
    hands.write(page.get_by_label("Height, cm"), "168")
    hands.press(button(page, "Add"))
    expect(page.get_by_label("Participant", exact=True)).to_have_value("P01")
    shot(page, "way-prepare")
    hands.press(button(page, "Begin the session"))


def trial(page, hands):
    expect(page.get_by_role("article", name="Instruction")).to_be_visible()
    shot(page, "way-instruction")
    hands.press(button(page, "Ready: begin"))
    expect(page.get_by_role("article", name="Recording")).to_be_visible()
    shot(page, "way-recording")
    verdict = page.get_by_role("article", name="Verdict")
    expect(verdict).to_be_visible()
    shot(page, "way-verdict")
    # A trial of few seconds is not a good one.
    accept = button(verdict, "Accept")
    hands.press(accept)
    dialog = page.get_by_role("dialog")
    if needs_reason(page):
        hands.write(dialog.get_by_label("Reason"), "a short trial of a test")
        hands.press(button(dialog, "Accept"))
    expect(verdict).to_be_hidden()


def needs_reason(page):
    page.wait_for_function(
        "() => document.querySelector('dialog[open]') || !document.querySelector('article[aria-label=Verdict]')")
    return page.get_by_role("dialog").is_visible()


def report(page):
    title = page.get_by_role("heading", level=1)
    expect(title).to_be_visible()
    assert title.inner_text() != "No report", page.get_by_role("main").inner_text()


def reports(page, hands):
    expect(page.get_by_role("heading", name="The session is over")).to_be_visible()
    hands.press(link(page, "To the trials"))
    table = page.get_by_role("region", name="Trials of P01-1")
    expect(table.get_by_role("row")).to_have_count(3)
    shot(page, "way-trials")
    with page.expect_popup() as popup:
        hands.press(table.get_by_role("link").first)
    report(popup.value)
    shot(popup.value, "way-report")
    popup.value.close()
    hands.press(link(page, "Study"))
    with page.expect_popup() as popup:
        hands.press(link(page, "Open the study's report"))
    report(popup.value)
    shot(popup.value, "way-study-report")
    popup.value.close()
    shot(page, "way-study")


def main(url, kind):
    with browser(url) as watched:
        page = watched.page()
        hands = {"mouse": Mouse, "keyboard": Keyboard}[kind](page)
        for part in (sheets, new_box, settings, aim, calibrate, scene, prepare, trial, trial, reports):
            part(page, hands)


if __name__ == "__main__":
    main(*sys.argv[1:])
