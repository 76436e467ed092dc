"""A hostile page in the browser of somebody who is signed in, and hostile words in the desk's own page.

    hostile.py URL
"""

import http.server
import json
import sys
import threading
from urllib.parse import urlsplit

from desk_page import api, begin_session, box_of, browser, expect, go, short_study, tell

WORDS = "<img src=x onerror=\"window.taken=1\"><script>window.taken=1</script>"
REBOUND = "rebound.example"

# What a page of another origin can try. Each attempt ends as "nothing", or as what it got.
ATTEMPTS = """async ([desk, box]) => {
    const got = {};
    const attempt = async (name, act) => {
        const patience = new Promise(resolve => setTimeout(() => resolve("nothing"), 5000));
        got[name] = await Promise.race([act().catch(() => "nothing"), patience]);
    };
    const body = answer => answer.ok ? answer.text() : Promise.reject();
    const path = `${desk}/api/boxes/${box}/aim/begin`;
    const json = { "Content-Type": "application/json" };
    await attempt("read", () => fetch(`${desk}/api/state`, { credentials: "include" }).then(body));
    await attempt("json", () => fetch(path, { method: "POST", credentials: "include", headers: json, body: "{}" }).then(body));
    const whole = { method: "POST", credentials: "include", headers: json, body: "{}" };
    await attempt("key", () => fetch(`${desk}/api/boxes/${box}/card/box.key`, whole).then(body));
    await attempt("settings", () => fetch(`${desk}/api/boxes/${box}/settings`, { credentials: "include" }).then(body));
    await attempt("new box", () => fetch(`${desk}/api/new-box`, whole).then(body));
    await attempt("plain", () => fetch(path, { method: "POST", credentials: "include", mode: "no-cors", body: "{}" }).then(() => "nothing"));
    await attempt("socket", () => new Promise((resolve, reject) => {
        const socket = new WebSocket(desk.replace("http", "ws") + "/ws");
        socket.onopen = () => socket.send('{"is":"watch","box":"' + box + '"}');
        socket.onmessage = event => resolve(event.data);
        socket.onerror = reject;
    }));
    await attempt("form", () => new Promise(resolve => {
        const frame = document.body.appendChild(document.createElement("iframe"));
        frame.name = "answer";
        frame.onload = () => { try { resolve(frame.contentDocument?.body?.textContent || "nothing"); } catch { resolve("nothing"); } };
        const form = document.body.appendChild(document.createElement("form"));
        Object.assign(form, { action: path, method: "post", target: "answer", enctype: "text/plain" });
        form.appendChild(Object.assign(document.createElement("input"), { name: '{"force":false,"x":"', value: '"}' }));
        form.submit();
    }));
    await attempt("frame", () => new Promise(resolve => {
        const frame = document.body.appendChild(document.createElement("iframe"));
        frame.onload = () => { try { resolve(frame.contentDocument?.body?.textContent || "nothing"); } catch { resolve("nothing"); } };
        frame.src = desk;
    }));
    return got;
}"""


class Blank(http.server.BaseHTTPRequestHandler):
    """A page of its own origin."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!DOCTYPE html><title>Hostile</title><body></body>")

    def log_message(self, *_):
        pass


def foreign_page(watched, page, box):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Blank)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    desk = f"http://{watched.host}"
    # In the same browser, with the cookie of the desk.
    for host in ("127.0.0.1", "localhost"):
        foreign = page.context.new_page()
        foreign.goto(f"http://{host}:{server.server_port}/")
        got = foreign.evaluate(ATTEMPTS, [desk, box])
        tell(f"a page of {host} at another port got {json.dumps(got)}")
        assert set(got.values()) == {"nothing"}, got
        foreign.close()
    server.shutdown()


def rebound_name(watched, page):
    """Another name that leads to the desk's address, as after DNS rebinding."""
    port = urlsplit(watched.url).port
    foreign = page.context.new_page()
    for path in ("", "api/hello", "api/state", "?" + urlsplit(watched.url).query):
        answer = foreign.goto(f"http://{REBOUND}:{port}/{path}")
        assert answer.status == 421, f"{path}: {answer.status}"
    foreign.close()
    tell("under another name it answers 421")


def hostile_words(page):
    short_study(page, 1, title=f"Study {WORDS}"[:80])
    api(page, "/api/studies/short/participants", {"code": "P02"})
    box = box_of(page)["id"]
    for step in ("Session", "Trials", "Study"):
        go(page, step)
        expect(page.get_by_label("Study", exact=True).locator("option")).to_contain_text(["onerror"])
        assert page.evaluate("window.taken") is None
    begin_session(page)
    expect(page.get_by_role("heading", name="onerror")).to_be_visible()
    event = {"step": box_of(page)["session"]["step"], "event": "skip", "why": WORDS}
    api(page, f"/api/boxes/{box}/session/event", event)
    expect(page.get_by_role("heading", name="The session is over")).to_be_visible()
    assert page.evaluate("window.taken") is None and page.locator("main img").count() == 0
    tell("hostile words are words")


def main(url):
    resolver = f"--host-resolver-rules=MAP {REBOUND} 127.0.0.1"
    with browser(url, is_strict=False, more=[resolver]) as watched:
        page = watched.page()
        box = box_of(page)["id"]
        foreign_page(watched, page, box)
        rebound_name(watched, page)
        doing = box_of(page)
        assert doing["aim"] is None and doing["doing"] == "watching", doing["doing"]
        hostile_words(page)


if __name__ == "__main__":
    main(*sys.argv[1:])
