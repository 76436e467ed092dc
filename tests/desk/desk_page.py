"""The desk's page in a real Chromium, for the scripts beside this file.

Whatever a script does, the page must neither complain in its console nor ask another host for anything:
`Browser` looks at both at its end.
"""

import os
import re
import sys
import traceback
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from playwright.sync_api import expect, sync_playwright

# Generous: the machine may be busy with other tests.
PATIENCE_MS = int(os.environ.get("PLUMBLINE_PATIENCE_S", "120")) * 1000
TABS_MAX = 200

expect.set_options(timeout=PATIENCE_MS)

# What a browser asks for by itself is not the page's.
ARGUMENTS = [
    # In a container its sandbox has no rights; the pages are this project's own.
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--autoplay-policy=user-gesture-required",
]


def ask(what):
    """Has the test do something, such as showing the camera something else; its answer, once it has."""
    print(f"ask {what}", flush=True)
    answer = sys.stdin.readline().strip()
    assert answer, what
    return answer


def tell(figure):
    print(figure, flush=True)


class Browser:
    """A browser whose pages are watched."""

    def __init__(self, chromium, url):
        self.chromium = chromium
        self.url = url
        self.host = urlsplit(url).netloc
        self.complaints = []
        self.others = []

    def context(self, width=1280, height=800, scheme="light"):
        size = {"width": width, "height": height}
        context = self.chromium.new_context(viewport=size, color_scheme=scheme, reduced_motion="reduce")
        context.set_default_timeout(PATIENCE_MS)
        context.on("request", self._request)
        context.on("page", self._page)
        return context

    def page(self, step="", **options):
        page = self.context(**options).new_page()
        page.goto(self.url)
        expect(page.get_by_role("navigation", name="Steps")).to_be_visible()
        if step:
            go(page, step)
        return page

    def _request(self, request):
        parts = urlsplit(request.url)
        if parts.scheme not in ("data", "blob") and parts.netloc != self.host:
            self.others.append(request.url)

    def _page(self, page):
        def complain(message):
            if message.type in ("error", "warning"):
                self.complaints.append(f"{message.text} {message.location['url']}")

        page.on("console", complain)
        page.on("pageerror", lambda it: self.complaints.append(str(it)))

    def check(self):
        assert not self.complaints, self.complaints
        assert not self.others, self.others


@contextmanager
def browser(url, is_strict=True, more=()):
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=chromium_path(), args=[*ARGUMENTS, *more])
        watched = Browser(chromium, url)
        try:
            yield watched
            if is_strict:
                watched.check()
        except BaseException as error:
            pages = [it for context in chromium.contexts for it in context.pages]
            for number, page in enumerate(pages):
                keep_picture(page, f"failed-{Path(sys.argv[0]).stem}-{number}")
            tell(f"failed {failure(error, pages)}")
            raise
        finally:
            chromium.close()


def failure(error, pages):
    """Where a script failed, why, and what its pages said then: one line, which a short report has too."""
    frames = traceback.extract_tb(error.__traceback__)
    places = [f"{it.name}, line {it.lineno}" for it in frames if Path(it.filename).parent == Path(__file__).parent]
    said = [f"the page says: {page.locator('body').inner_text()}" for page in pages]
    # A snapshot of the whole page would push out what the page says.
    why = str(error).split("Aria snapshot:")[0]
    return " | ".join(line.strip() for text in (*places, why, *said) for line in text.splitlines() if line.strip())


def chromium_path():
    places = os.environ["PATH"].split(":")
    return next(str(it) for it in (Path(place) / "chromium" for place in places) if it.is_file())


def shot(page, name):
    """Keeps a picture of the whole page if somebody wants to look at it: pictures take longer than the tests."""
    if "PLUMBLINE_SHOTS" in os.environ:
        keep_picture(page, name)


def keep_picture(page, name):
    folder = Path(os.environ["PLUMBLINE_PICTURES"])
    folder.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=folder / f"{name}.png", full_page=True)


def go(page, step):
    """To a step, by its address."""
    page.evaluate("step => { location.hash = step; }", step.lower())
    expect(page.get_by_role("link", name=step, exact=True)).to_have_attribute("aria-current", "step")


class Mouse:
    """Somebody who has a mouse, and types only texts."""

    def __init__(self, page):
        self.page = page

    def press(self, what):
        what.click()

    def write(self, what, text):
        what.click()
        what.press("ControlOrMeta+a")
        self.page.keyboard.type(text)

    def choose(self, what, words):
        what.select_option(label=words)


class Keyboard:
    """Somebody who has no mouse."""

    def __init__(self, page):
        self.page = page

    def reach(self, what):
        """By the tabulator alone."""
        expect(what).to_be_visible()
        for _ in range(TABS_MAX):
            if what.evaluate("it => it === document.activeElement"):
                return
            self.page.keyboard.press("Tab")
        raise AssertionError(f"the tabulator does not lead to {what}")

    def press(self, what):
        # The tabulator skips a button that is disabled, say until the box is heard again.
        expect(what).to_be_enabled()
        self.reach(what)
        # One that keeps the focus may have begun to wait.
        expect(what).to_be_enabled()
        self.page.keyboard.press("Enter")

    def write(self, what, text):
        self.reach(what)
        self.page.keyboard.press("ControlOrMeta+a")
        self.page.keyboard.type(text)

    def choose(self, what, words):
        self.reach(what)
        # A list goes to what begins with the letters.
        self.page.keyboard.type(words.split()[0])
        chosen = what.evaluate("it => it.selectedOptions[0].label")
        assert chosen == words, chosen


def begin_of(words):
    """Matches a name that begins with these words."""
    return re.compile("^" + re.escape(words))


def api(page, path, body=None):
    """What the page itself would ask for."""
    return page.evaluate(
        """async ([path, body]) => {
            const headers = { "Content-Type": "application/json" };
            const options = body === null ? {} : { method: "POST", headers, body: JSON.stringify(body) };
            const answer = await fetch(path, options);
            if (!answer.ok) throw new Error(path + ": " + (await answer.text()));
            return answer.json();
        }""",
        [path, body],
    )


def box_of(page):
    """The first box, as the desk describes it."""
    return api(page, "/api/state")["boxes"][0]


def short_study(page, seconds, title="Quiet standing", marks=(), countdown_s=0):
    """A study of one condition and one participant, made without the page's help."""
    condition = {
        "name": "eyes-open",
        "label": "Eyes open",
        "instruction": "Stand still and look straight ahead.",
        "duration_s": seconds,
    }
    fields = {
        "name": "Short",
        "order": {"by": "fixed"},
        "countdown_s": countdown_s,
        "tones": {"start": True, "end": True},
        "zero": "start",
        "marks": list(marks),
        "bins_s": [[0, seconds]],
        "condition": [condition],
    }
    study = {"folder": "short", "title": title, "protocol": {"fields": fields}}
    api(page, "/api/studies", study)
    api(page, "/api/studies/short/participants", {"code": "P01"})


def wait_until_ready(page):
    """Until the box can begin a session."""
    page.wait_for_function(
        """async () => {
            const state = await (await fetch("/api/state")).json();
            const box = state.boxes[0];
            return box?.live && box.doing === "watching" && box.can.includes("session_begin");
        }""",
        polling=200,
    )


def keep(page, folder, press):
    """The file that comes when something is pressed, in this folder under its own name."""
    with page.expect_download() as download:
        press()
    path = Path(folder) / download.value.suggested_filename
    download.value.save_as(path)
    return path


def begin_session(page):
    """A session of that study, up to its first instruction."""
    wait_until_ready(page)
    api(page, f"/api/boxes/{box_of(page)['id']}/session/begin", {"study": "short", "participant": "P01"})
    go(page, "Session")
    expect(page.get_by_role("article", name="Instruction")).to_be_visible()


def button(of, name):
    return of.get_by_role("button", name=name, exact=True)


def link(of, name):
    return of.get_by_role("link", name=name, exact=True)
