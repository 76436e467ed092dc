"""Poses of frames in arrays against the rows of `plumb track`, to the last bit."""

import csv
import threading

import numpy as np
from lock import beside_another_thread

import plumbline

TEXTS = ("target", "state")


def frames(path):
    """Each frame of a grey Y4M."""
    with open(path, "rb") as file:
        header = file.readline().decode().split()
        sides = {word[0]: word[1:] for word in header[1:]}
        width, height = int(sides["W"]), int(sides["H"])
        kind = np.dtype("<u2" if sides["C"] == "mono12" else np.uint8)
        while file.readline() == b"FRAME\n":
            samples = file.read(width * height * kind.itemsize)
            yield np.frombuffer(samples, kind).reshape(height, width)


def rows(path):
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            yield {name: value if name in TEXTS else float(value) if value else None
                   for name, value in row.items()}


def track(tracker, path, **options):
    return [tracker.step(frame, at / 60, **options) for at, frame in enumerate(frames(path))]


def check(results, path):
    found, expected = [row for result in results for row in result.rows()], list(rows(path))
    assert len(found) == len(expected) > 0
    for row, wanted in zip(found, expected):
        assert row == wanted, (row, wanted)


FILES = ("camera.toml", "targets.toml")
tracker = plumbline.Tracker(*FILES, "scene.toml")
results = track(tracker, "grey8.y4m")
check(results, "grey8.csv")
check(track(plumbline.Tracker(*FILES, "scene.toml"), "grey12.y4m", white_level=4095), "grey12.csv")
camera = plumbline.Camera.open("camera.toml")
bare = track(plumbline.Tracker(camera, "targets.toml"), "grey8.y4m")
check(bare, "no_scene.csv")
assert all(result.lower is None and result.upper is None for result in bare)

assert tracker.targets == [target.name for target in results[0].targets]
assert isinstance(tracker.warnings, list)
poses, missing = 0, 0
for number, result in enumerate(results):
    assert result.index == number and result.time_s == number / 60
    for target, row in zip(result.targets, result.rows()):
        assert target.time_s == row["time_s"] and target.role in ("lower", "upper")
        assert target.state in row["state"]
        if target.no_pose:
            assert target.theta is None and target.covariance is None and target.rms_px is None
            assert row["state"] == f"{target.state}: {target.no_pose}"
            missing += 1
            continue
        poses += 1
        numbers = [row[name] for name in ("theta1_rad", "theta2_rad", "theta3_rad")]
        numbers += [row[name] for name in ("x_mm", "y_mm", "z_mm")]
        assert target.theta.tolist() == numbers
        assert target.translation_mm.tolist() == numbers[3:]
        one, two, three = target.theta[:3]
        turns = [
            [[np.cos(one), -np.sin(one), 0], [np.sin(one), np.cos(one), 0], [0, 0, 1]],
            [[np.cos(two), 0, np.sin(two)], [0, 1, 0], [-np.sin(two), 0, np.cos(two)]],
            [[1, 0, 0], [0, np.cos(three), -np.sin(three)], [0, np.sin(three), np.cos(three)]],
        ]
        assert np.allclose(np.linalg.multi_dot(turns), target.rotation, atol=1e-12)
        assert target.covariance.shape == (6, 6)
        sd_mm = np.sqrt(np.diag(target.covariance))[3:]
        assert sd_mm.tolist() == [row[name] for name in ("sd_x_mm", "sd_y_mm", "sd_z_mm")]
        assert (target.rms_px, target.corners) == (row["rms_px"], row["points"])
        assert target.corners <= target.corners_total
        trunk = result.lower if target.role == "lower" else result.upper
        assert trunk.tolist() == [row["ap_mm"], row["ml_mm"], row["si_mm"]]
assert poses > 10 and missing > 3, (poses, missing)

# Any array of these samples is the same frame: turned, a part of another, not to be written.
frame = next(frames("grey8.y4m"))
wide = np.zeros((frame.shape[0], frame.shape[1] + 10), np.uint8)
wide[:, 5:-5] = frame
for same in (np.asfortranarray(frame), wide[:, 5:-5], frame[::-1].copy()[::-1]):
    result = plumbline.Tracker(*FILES, "scene.toml").step(same, 0)
    assert result.rows() == results[0].rows()
grey12 = next(frames("grey12.y4m"))
odd = np.frombuffer(b"-" + grey12.tobytes(), "<u2", offset=1).reshape(grey12.shape)
assert not odd.flags.aligned
result = plumbline.Tracker(*FILES, "scene.toml").step(odd, 0, white_level=4095)
assert result.rows() == list(rows("grey12.csv"))[:2]
# Frames that do not follow each other, and those of half the size.
alone = plumbline.Tracker(*FILES, "scene.toml", independent=True)
check(track(alone, "grey8.y4m"), "independent.csv")
half = plumbline.Tracker(*FILES, "scene.toml", scale_camera=(728, 544))
check(track(half, "half.y4m"), "half.csv")
for sides, found in (((728, 500), "another shape"), ((0, 0), "width_px"), ((8, 6), "px")):
    try:
        plumbline.Tracker(*FILES, scale_camera=sides)
    except plumbline.BadInput as error:
        assert found in str(error), error
    else:
        raise AssertionError(f"{sides} was taken")
# Other threads go on meanwhile.
for tracker_of_one in (alone, plumbline.Tracker(*FILES)):
    beside_another_thread(lambda: tracker_of_one.step(frame, 0))
# A frame of the past, or the same time again, is a frame like any other.
tracker.forget()
for time_s in (7.5, 7.5, 0):
    assert len(tracker.step(frame, time_s).targets) == 2


def refused(kind, field, *arguments, **options):
    try:
        tracker.step(*arguments, **options)
    except kind as error:
        assert field in str(error), error
    else:
        raise AssertionError(f"{field}: nothing was refused")


refused(plumbline.BadInput, "scale_camera", frame[:-1], 0)
refused(plumbline.BadInput, "frame size", np.zeros((0, 0), np.uint8), 0)
refused(plumbline.BadInput, "white_level", frame, 0, white_level=0)
for time_s in (-1.0, float("nan"), float("inf"), 1e30):
    refused(plumbline.BadInput, "time_s", frame, time_s)
for wrong in (frame.astype(float), frame.astype(">u2"), frame.ravel(), frame[None], [[1]], None):
    refused(TypeError, "two-dimensional numpy array of uint8 or uint16", wrong, 0)
# The brightest samples beyond the white level, and samples of nothing but noise.
bright = np.full(frame.shape, 65535, np.uint16)
noise = np.random.default_rng(7).integers(0, 256, frame.shape, np.uint8)
for sample, level in ((bright, 1), (noise, 255)):
    result = tracker.step(sample, 100.0, white_level=level)
    assert all(target.no_pose for target in result.targets)

# Two threads, a tracker each, at once.
at_once = [None, None]


def run(place):
    at_once[place] = track(plumbline.Tracker(*FILES, "scene.toml"), "grey8.y4m")


threads = [threading.Thread(target=run, args=(place,)) for place in (0, 1)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
for found in at_once:
    check(found, "grey8.csv")
