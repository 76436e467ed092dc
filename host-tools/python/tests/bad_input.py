"""What cannot be used: an exception with a place, what was found and a remedy, and never a panic."""

import os
import pathlib
import pickle
import random
import shutil

import numpy as np

import plumbline

trial = plumbline.open_trial("trials/p01-control")


def refused(work, place, field="", found=""):
    try:
        work()
    except plumbline.BadInput as error:
        assert place in error.place, error
        assert field in error.field, error
        assert found in error.found, error
        assert error.remedy and error.found in str(error) and error.remedy in str(error)
        # As one process hands it to another.
        copy = pickle.loads(pickle.dumps(error))
        assert (type(copy), str(copy), copy.field) == (type(error), str(error), error.field)
        return error
    raise AssertionError(f"{place}, {field}: nothing was refused")


refused(lambda: plumbline.open_trial("nowhere"), "nowhere")
refused(lambda: plumbline.open_trial("packets.bin"), "packets.bin", found="not the folder of a trial")
refused(lambda: plumbline.open_trial("trials"), "trials/trial.toml")
refused(lambda: plumbline.open_trial("trials/p01-foam", zero="noon"), "open_trial", "zero", "noon")
refused(lambda: plumbline.open_trial("trials/p01-foam", zero="onset"), "p01-foam", found="rises")

for name, value in (
    ("filter", "butterworth"),
    ("span", "some"),
    ("span", (5, 5)),
    ("span", (0, float("inf"))),
    ("bins", [(3, 2)]),
    ("bins", [(0, float("nan"))]),
    ("covered_min", 90),
    ("covered_min", float("nan")),
    ("radius_mm", 0),
    ("radius_mm", float("inf")),
):
    refused(lambda: trial.figures(**{name: value}), "figures", name)
    refused(lambda: trial.analyze(**{name: value}), "analyze", name)
    refused(lambda: plumbline.figures(["trials/p01-foam"], **{name: value}), "figures", name)
refused(lambda: trial.analyze(span=(500, 600)), "p01-control")

refused(lambda: plumbline.figures(["trials/p01-foam", "nowhere"]), "nowhere")
refused(lambda: plumbline.figures(["trials/p01-foam"] * 2), "p01-foam", found="twice")
table = plumbline.figures(["nowhere", "trials/p01-foam"], errors="collect")
assert [error.place for error in table.errors] == ["nowhere"] and len(table) > 100
assert len(plumbline.figures([])) == 0

refused(lambda: plumbline.study("nowhere.toml"), "nowhere.toml")
pathlib.Path("wrong.toml").write_text(
    'title = "wrong"\ntrials = ["trials/*"]\nconditions = ["control"]\n'
)
refused(lambda: plumbline.study("wrong.toml"), "wrong.toml", "conditions")
long = {"response": "path", "within": ["condition"], "subject": "id"}
refused(lambda: plumbline.study_of_table("nowhere.csv", **long), "nowhere.csv")
refused(lambda: plumbline.study_of_table("x.csv", **{**long, "within": []}), "table", "within")
refused(lambda: plumbline.study_of_table("x.csv", delimiter="bar", **long), "table", "delimiter")

refused(lambda: trial.export("docx", "out"), "export", "format", "docx")
refused(lambda: trial.export("csv", "out", run=1), "--run")
refused(lambda: trial.export("bids", "out", run=0), "export", "run")
refused(lambda: trial.export("csv", "packets.bin/out.csv"), "packets.bin")
assert not os.path.exists("out")

refused(lambda: plumbline.Camera.open("nowhere.toml"), "nowhere.toml")
pathlib.Path("camera.toml").write_text("width_px = 640\nheight_px = 480\nfx_px = -1\n")
refused(lambda: plumbline.Camera.open("camera.toml"), "camera.toml")
refused(lambda: plumbline.calibrate(["nowhere.png"]), "nowhere.png")
refused(lambda: plumbline.calibrate([]), "INPUT")
refused(lambda: plumbline.calibrate([], model="pinhole"), "calibrate", "model", "pinhole")
refused(lambda: plumbline.calibrate(["x.png"], board=(1, 1)), "--board")
refused(lambda: plumbline.calibrate(["x.png"], pitch_mm=float("nan")), "--board")
refused(lambda: plumbline.Tracker("camera.toml", "targets.toml"), "camera.toml")

refused(lambda: plumbline.receive(udp="here"), "receive", "udp", "here")
refused(lambda: plumbline.receive(udp="127.0.0.1:1", serial="/dev/null"), "receive", "serial")
refused(lambda: plumbline.receive(timeout_s=0), "receive", "timeout_s")
refused(lambda: plumbline.receive(timeout_s=float("nan")), "receive", "timeout_s")
refused(lambda: plumbline.receive(udp="127.0.0.1:0"), "keys", found="no key of a box is known here")

# What is of another type is Python's own TypeError.
for work in (
    lambda: plumbline.open_trial(3.5),
    lambda: plumbline.calibrate(["x.png"], board=9),
    lambda: trial.figures(span=[1]),
    lambda: trial.figures(filter=10),
    lambda: plumbline.figures("trials/p01-foam"),
):
    try:
        work()
    except TypeError:
        pass
    else:
        raise AssertionError("a wrong type was taken")

# A recording that is damaged anywhere is read as far as it goes, or refused.
packets = pathlib.Path("packets.bin").read_bytes()
chance = random.Random(7)
shutil.copytree("trials/p01-foam", "damaged")
for attempt in range(12):
    damaged = bytearray(packets)
    for _ in range(1 + attempt * 20):
        damaged[chance.randrange(len(damaged))] = chance.randrange(256)
    pathlib.Path("damaged/packets.bin").write_bytes(damaged[: chance.randrange(len(damaged))])
    try:
        read = plumbline.open_trial("damaged")
        assert read.lower.position_mm.shape == (len(read), 3)
        assert not np.isinf(read.lower.position_mm).any()
        read.figures()
    except plumbline.BadInput as error:
        assert "damaged" in error.place
