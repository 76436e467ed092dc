"""Figures and statistics against what `plumb` has written, to the last bit."""

import csv
import json
import pathlib

import plumbline

TRIALS = ["trials/p01-control", "trials/p02-foam"]
METHOD = {
    "filter": "butterworth:10",
    "span": (0, 25),
    "bins": [(0, 8), (8, 20)],
    "covered_min": 0.75,
    "radius_mm": 2.5,
}
TEXTS = {"participant", "condition", "trial", "verdict", "trunk", "segment", "direction", "figure"}
TEXTS |= {"unit", "filter", "reason"}


def read(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        for name in row.keys() - TEXTS:
            row[name] = float(row[name]) if row[name] else None
    return rows


def check(table, path):
    expected = read(path)
    found = list(table.rows())
    assert list(table.columns) == list(expected[0]), path
    assert len(found) == len(table) == len(expected) > 0
    for number, (row, wanted) in enumerate(zip(found, expected)):
        assert row == wanted, (path, number, row, wanted)
    values = [row["value"] for row in found]
    assert sum(value is not None for value in values) > len(values) / 2
    return found


found = check(plumbline.figures(TRIALS), "figures.csv")
paths = iter([pathlib.Path(TRIALS[0])])
chosen = plumbline.figures(paths, zero="start", **METHOD)
check(chosen, "chosen.csv")
assert chosen.errors == [] and all(it.startswith(TRIALS[0]) for it in chosen.warnings)
# Those of a trial that is open are the same.
trial = plumbline.open_trial(TRIALS[0])
assert list(trial.figures().rows()) == found[: len(found) // 2]

assert trial.analyze() == json.load(open("analysis.json"))
assert trial.analyze(**METHOD) == json.load(open("chosen.json"))

study = plumbline.study("study.toml")
assert study == json.load(open("study.json"))
assert study["participants"] == ["p01", "p02", "p03"] and len(study["sway"]) > 50

long = plumbline.study_of_table(
    "long.csv", response="path", within=["condition", "half"], subject="id"
)
assert long == json.load(open("long.json"))
