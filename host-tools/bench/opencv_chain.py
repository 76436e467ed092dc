"""OpenCV on the frames of `cargo xtask bench`: its time and its spread.

Two chains, each on every frame and on both targets, one thread:

- warm: projectPoints of the previous pose, cornerSubPix around the projected
  corners, solvePnP with that pose as its guess. Of the windows tried, the one with
  the least spread is reported, and only its time counts.
- search: remap (undistortion, with its maps made beforehand), findChessboardCorners,
  cornerSubPix, solvePnP.

Reads the directory that `plumb simulate --out` has written.
Prints one line per figure: name, tab, value. The spread is 1.96 standard
deviations of (depth found - true depth), in millimetres; times are microseconds.
"""

import sys
import time
import tomllib
from pathlib import Path

import cv2
import numpy as np

from recording import read_poses

WINDOWS = range(3, 11)
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)


def read_frames(path):
    """The luma of every frame, as arrays of rows."""
    data = path.read_bytes()
    end = data.index(b"\n")
    fields = {word[:1]: word[1:] for word in data[:end].split()[1:]}
    width, height = int(fields[b"W"]), int(fields[b"H"])
    colour = fields.get(b"C", b"420")
    size = width * height
    if not colour.startswith(b"mono"):
        size += 2 * ((width + 1) // 2) * ((height + 1) // 2)
    frames = []
    at = end + 1
    while at < len(data):
        at = data.index(b"\n", at) + 1
        luma = np.frombuffer(data, np.uint8, width * height, at)
        frames.append(luma.reshape(height, width))
        at += size
    return frames


def read_camera(path):
    camera = tomllib.loads(path.read_text())
    matrix = np.array(
        [
            [camera["fx_px"], camera.get("skew_px", 0.0), camera["cx_px"]],
            [0.0, camera["fy_px"], camera["cy_px"]],
            [0.0, 0.0, 1.0],
        ]
    )
    if matrix[0, 1] != 0.0:
        sys.exit("OpenCV's model has no skew; choose a camera without it")
    distortion = list(camera["distortion"])
    return matrix, np.array(distortion + [0.0] * (5 - len(distortion)))


def read_targets(path):
    """Per target that is tracked on the body: name -> (grid, points)."""
    targets = {}
    for target in tomllib.loads(path.read_text())["target"]:
        if target["role"] == "scene":
            continue
        columns, rows = target["columns"], target["rows"]
        y, x = np.mgrid[:rows, :columns].astype(float)
        if target.get("origin", "center") == "center":
            x, y = x - (columns - 1) / 2, y - (rows - 1) / 2
        points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * target["pitch_mm"]
        targets[target["name"]] = ((columns, rows), points)
    return targets


def read_truth(path):
    """(frame, target) -> (rotation vector, translation)."""
    return {
        key: (cv2.Rodrigues(rotation)[0].ravel(), position)
        for key, (rotation, position) in read_poses(path).items()
    }


def spread(errors):
    return 1.96 * float(np.std(errors)) if len(errors) > 1 else float("nan")


def warm(frames, targets, truth, matrix, distortion, window):
    """Times per frame, and depth errors and lost frames per target."""
    first = min(frame for frame, _ in truth)
    poses = {name: truth[first, name] for name in targets}
    times, errors, lost = [], {name: [] for name in targets}, dict.fromkeys(targets, 0)
    for number, frame in enumerate(frames, first):
        took = 0
        for name, (_, points) in targets.items():
            rotation, position = (value.copy() for value in poses[name])
            start = time.perf_counter_ns()
            guess, _ = cv2.projectPoints(points, rotation, position, matrix, distortion)
            corners = guess.astype(np.float32)
            cv2.cornerSubPix(frame, corners, (window, window), (-1, -1), STOP)
            _, rotation, position = cv2.solvePnP(
                points, corners, matrix, distortion, rotation, position, True
            )
            took += time.perf_counter_ns() - start
            rotation, position = rotation.ravel(), position.ravel()
            error = position - truth[number, name][1]
            if np.linalg.norm(error) < 20:
                errors[name].append(error[2])
                poses[name] = rotation, position
            else:
                lost[name] += 1
                poses[name] = truth[number, name]
        times.append(took)
    return times, errors, lost


def search(frames, targets, truth, matrix, distortion):
    first = min(frame for frame, _ in truth)
    size = frames[0].shape[::-1]
    maps = cv2.initUndistortRectifyMap(matrix, distortion, None, matrix, size, cv2.CV_16SC2)
    times, errors, lost = [], {name: [] for name in targets}, dict.fromkeys(targets, 0)
    for number, frame in enumerate(frames, first):
        start = time.perf_counter_ns()
        flat = cv2.remap(frame, *maps, cv2.INTER_LINEAR)
        positions = {}
        for name, (grid, points) in targets.items():
            found, corners = cv2.findChessboardCorners(flat, grid)
            if not found:
                continue
            cv2.cornerSubPix(flat, corners, (5, 5), (-1, -1), STOP)
            _, _, position = cv2.solvePnP(points, corners, matrix, None)
            positions[name] = position.ravel()
        times.append(time.perf_counter_ns() - start)
        for name in targets:
            error = positions.get(name, np.full(3, np.inf)) - truth[number, name][1]
            if np.linalg.norm(error) < 20:
                errors[name].append(error[2])
            else:
                lost[name] += 1
    return times, errors, lost


def say(chain, times, errors, lost):
    print(f"{chain}_median_us\t{np.median(times) / 1e3:.1f}")
    print(f"{chain}_worst_us\t{max(times) / 1e3:.1f}")
    for name in errors:
        print(f"{chain}_spread_mm:{name}\t{spread(errors[name]):.3f}")
        print(f"{chain}_lost:{name}\t{lost[name]}")


def main():
    directory = Path(sys.argv[1])
    cv2.setNumThreads(1)
    frames = read_frames(directory / "frames.y4m")
    matrix, distortion = read_camera(directory / "camera.toml")
    targets = read_targets(directory / "targets.toml")
    truth = read_truth(directory / "truth.csv")
    print(f"version\t{cv2.__version__}")
    print(f"frames\t{len(frames)}")
    runs = {
        window: warm(frames, targets, truth, matrix, distortion, window) for window in WINDOWS
    }
    best = min(runs, key=lambda window: sum(map(spread, runs[window][1].values())))
    print(f"warm_window_px\t{best}")
    say("warm", *runs[best])
    say("search", *search(frames, targets, truth, matrix, distortion))


if __name__ == "__main__":
    main()
