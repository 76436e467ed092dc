"""A trial's arrays against what the library holds, and against `plumb export`."""

import json
import math

import numpy as np
import pyarrow.parquet

import plumbline

FRAMES, LOST, HIDDEN = 1800, range(100, 105), range(400, 420)

trial = plumbline.open_trial("trials/p01-control")
assert len(trial) == FRAMES == len(trial.time_s)
assert trial.frame.tolist() == list(range(FRAMES))
assert trial.session.tolist() == [1] * FRAMES
assert np.flatnonzero(~trial.received).tolist() == list(LOST)
assert np.all(np.diff(trial.time_s) > 0)

seen = {frame["frame"]: frame for frame in json.load(open("frames.json"))}
assert len(seen) == FRAMES - len(LOST)
for trunk in (trial.lower, trial.upper):
    assert trunk.position_mm.shape == (FRAMES, 3) and trunk.position_mm.dtype == np.float64
    assert trunk.covariance_mm2.shape == (FRAMES, 3, 3) and trunk.theta.shape == (FRAMES, 6)
    points = 0
    for row in range(FRAMES):
        numbers = [trunk.time_s[row], *trunk.position_mm[row], *trunk.covariance_mm2[row].ravel()]
        pose = [*trunk.theta[row], trunk.rms_px[row]]
        frame = seen.get(row)
        if frame is None:
            assert all(math.isnan(it) for it in numbers + pose) and trunk.state[row] == ""
            continue
        # Equal to the last bit: JSON has all digits.
        assert trial.time_s[row] == frame["time_s"]
        expected = frame[trunk.name]
        if expected["point"] is None:
            assert trunk.name == "lower" and row in HIDDEN
            assert all(math.isnan(it) for it in numbers + pose)
            assert trunk.state[row] == "coasting: too few corners"
            continue
        time_s, position, covariance = expected["point"]
        assert numbers == [time_s, *position, *covariance], row
        assert pose == [*expected["theta"], expected["rms_px"]], row
        assert trunk.state[row] == "tracking"
        points += 1
    assert points == FRAMES - len(LOST) - (len(HIDDEN) if trunk.name == "lower" else 0)
    covariances = trunk.covariance_mm2[trial.received & ~np.isnan(trunk.rms_px)]
    assert np.array_equal(covariances, covariances.transpose(0, 2, 1))
    assert np.all(np.linalg.eigvalsh(covariances) > 0)

# The same frames as in an export, in which each point is moved to its row's time.
table = pyarrow.parquet.read_table("p01.parquet")
exported = table["time_s"].to_numpy()
assert len(exported) == FRAMES and np.allclose(exported, trial.time_s, rtol=0, atol=1e-9)
for trunk in (trial.lower, trial.upper):
    for at, axis in enumerate(("ap", "ml", "si")):
        column = table[f"{trunk.name}_{axis}_mm"].to_numpy()
        assert np.allclose(column, trunk.position_mm[:, at], rtol=0, atol=1e-9, equal_nan=True)

# What is known of the whole.
assert (trial.participant, trial.condition, trial.title) == ("p01", "control", "p01, control")
assert str(trial.path) == "trials/p01-control" and "p01, control" in repr(trial)
assert trial.zero == 'the mark "stands"' and 1.7e9 < trial.zero_utc_s < 1.8e9
assert abs(trial.rate_hz - 60) < 0.1
(event,) = trial.events
assert event["label"] == "stands" and event["source"] == "key" and event["time_s"] == 0
assert trial.manifest["event"][0]["time_s"] == -trial.time_s[0]
assert trial.manifest["packets"]["lost"] == len(LOST)
assert trial.grade == trial.verdict["is"] and trial.grade in ("good", "doubtful")
for reason in trial.verdict.get("reason", []):
    assert reason["words"] and reason["remedy"]
assert isinstance(trial.warnings, list)

start = plumbline.open_trial("trials/p01-control", zero="start")
assert start.zero == "the first frame" and start.time_s[0] == 0
