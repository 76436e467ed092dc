"""What the page draws from, and how it reads what is typed: its modules, asked in the browser that runs
them.

    drawings.py URL
"""

import math
import sys

from desk_page import browser, tell

SAMPLES = """async () => {
    const { Samples } = await import("/draw/samples.js");
    const kept = new Samples(8);
    const reference = { number: 1, upper: null, lower: [1, 2, 3] };
    const row = ap => ({ p: [ap, 2 * ap, 3 * ap], c: [0.04, 0.01, 0.09] });
    const frame = (number, at_ms, ap) => ({ number, at_ms, lower: ap === null ? null : row(ap), upper: null });
    kept.add([1, 2, 3, 5, 6].map(it => frame(it, 10 * it, it)), reference);
    kept.add([frame(7, 40, 4)], reference);
    const list = of => Array.from({ length: of.count - of.oldest }, (_, at) =>
        [of.at_ms(of.oldest + at), of.value("lower", 0, of.oldest + at), of.value("lower", 2, of.oldest + at)]);
    const late = list(kept);
    const sd = [0, 1, 2].map(axis => String(kept.sd("lower", axis, 3)));
    const origin = [kept.origin("lower", 0), kept.origin("upper", 0)];
    const gap_ms = kept.gap_ms();
    for (let number = 8; number < 100; number += 1) kept.add([frame(number, 10 * number, number)], reference);
    const newest = list(kept);
    // Too late: nothing that is kept is older.
    kept.add([frame(100, 5, 5)], reference);
    const after = list(kept);
    kept.add([frame(101, 1000, null)], reference);
    return { late, sd, origin, gap_ms, newest, after, latest: kept.latest,
        missing: kept.is_missing("lower", kept.count - 1), since: kept.since(980) - kept.oldest };
}"""

ELLIPSE = """async covariance => (await import("/draw/plane.js")).ellipse(covariance)"""

WIRES = """async states => {
    const { WiresOf } = await import("/parts/wires.js");
    const { html, render } = await import("/vendor/preact-htm.js");
    return states.map(wires => {
        const at = document.createElement("div");
        render(html`<${WiresOf} wires=${wires} />`, at);
        return at.textContent.replace(/\\s+/g, " ");
    });
}"""

REACH = """async () => {
    const { Reach, step_up } = await import("/draw/scale.js");
    const reach = new Reach(1);
    const steps = [0, 0.9, 1.1, 2.5, 7, 11, 4000].map(it => step_up(it, 1));
    return { steps, reaches: [0.1, 1.5, 4, 3.9, 1.1, 0.1].map(it => reach.fit(it)) };
}"""

TYPED = """async () => {
    const { needed_number, typed_number } = await import("/words.js");
    const read = (of, text) => {
        try {
            return of(text, "Height, cm");
        } catch (error) {
            return error.message;
        }
    };
    const texts = ["12.5", "12,5", " 7 ", "", "  ", "12,5,0", "tall", "Infinity"];
    return [typed_number, needed_number].map(of => texts.map(it => read(of, it)));
}"""


def samples(page):
    got = page.evaluate(SAMPLES)
    assert got["late"] == [[10 * it, it, 3 * it] for it in (1, 2, 3, 4, 5, 6)], got["late"]
    ap, ml, si = map(float, got["sd"])
    assert math.isclose(ap, 0.2, rel_tol=1e-6) and math.isclose(ml, 0.3, rel_tol=1e-6) and math.isnan(si)
    assert got["origin"] == [[1, 2, 3], None]
    assert math.isclose(got["gap_ms"], 16)
    assert [row[1] for row in got["newest"]] == list(range(92, 100))
    assert got["after"] == got["newest"]
    assert got["latest"] == 101 and got["missing"] and got["since"] == 5, got


def ellipse(page):
    # Along AP alone: upright on the screen. Along both: up and to the right, where y points down.
    for covariance, long_sd, short_sd, turn in [
        ([0.04, 0, 0.01], 0.2, 0.1, -math.pi / 2),
        ([0.01, 0, 0.04], 0.2, 0.1, 0),
        ([0.05, 0.03, 0.05], math.sqrt(0.08), math.sqrt(0.02), -math.pi / 4),
    ]:
        got = page.evaluate(ELLIPSE, covariance)
        wanted = [math.sqrt(5.991) * long_sd, math.sqrt(5.991) * short_sd, turn]
        assert all(math.isclose(a, b, abs_tol=1e-6) for a, b in zip(got, wanted)), (got, wanted)


def reach(page):
    got = page.evaluate(REACH)
    assert got["steps"] == [1, 1, 2, 5, 10, 20, 5000], got
    assert got["reaches"] == [1, 2, 5, 5, 2, 2], got


def typed(page):
    # Never NaN, which JSON makes null: as if nothing had been typed.
    wrong = [f"Height, cm: “{it}” is not a number – type one such as 12.5" for it in ("12,5,0", "tall", "Infinity")]
    nothing = "Height, cm: nothing is typed – type a number such as 12.5"
    may_be_empty, must_be_there = page.evaluate(TYPED)
    assert may_be_empty == [12.5, 12.5, 7, None, None, *wrong], may_be_empty
    assert must_be_there == [12.5, 12.5, 7, nothing, nothing, *wrong], must_be_there


def wires(page):
    counts = {"sent": 3, "bounces": 1, "dropped": 0, "pulses": 600}
    both, lossy, missing = page.evaluate(WIRES, [
        {"input": "ready", "output": "ready", **counts},
        {"input": "ready", "output": "off", **counts, "dropped": 2},
        {"input": "missing", "output": "off", **counts},
    ])
    assert "3 marks since its start, 1 bounce left out" in both and "600 pulses given" in both, both
    assert "2 edges came faster" in lossy and "Output line" not in lossy, lossy
    assert "missing" in missing and "cannot be used" in missing and "marks since" not in missing, missing


def main(url):
    with browser(url) as watched:
        page = watched.page()
        for part in (samples, ellipse, reach, typed, wires):
            part(page)
            tell(f"{part.__name__}: right")


if __name__ == "__main__":
    main(*sys.argv[1:])
