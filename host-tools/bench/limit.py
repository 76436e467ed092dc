"""The physical limit of one frame: the Cramer-Rao bound of each target's depth.

Whatever the method, an unbiased pose from one frame cannot scatter less than the
frame's noise allows. The bound follows from how the pixels change with the pose:

- The picture is the whole printed grid at its true pose in frame 0 of a directory that
  `plumb simulate` wrote, through its lens with its distortion, blurred by the lens
  (Gaussian) and the pixel's square (taken as a Gaussian of its variance, 1/12 px^2).
- Its derivatives by the six numbers of the pose are central differences. Offset, contrast
  and blur are unknown as well: a measurement does not know them beforehand.
- The noise is that of the simulated sensor (photon and read noise) and of the rounding.

With F = sum over pixels of (derivative derivative^T / noise variance), the bound of the
covariance is F^-1. Not counted: that the noise itself depends on the grey, and the
paper's outer edges, which need not be cut exactly.

    python3 host-tools/bench/limit.py trial --black 20 --white 220 --psf 0.6 --noise 2

Needs numpy and scipy. Prints one line per figure: name, tab, value; `limit_mm` is 1.96
standard deviations of the depth, `limit_x_mm` and `limit_y_mm` those along x and y.
"""

import argparse
import csv
import tomllib
from pathlib import Path

import numpy as np
from scipy.special import erf

# The sensor of `plumb simulate`: the grey at which the noise has the given value, and the
# share of its variance that is not photon noise.
NOISE_AT_GREY, READ_VARIANCE_SHARE = 120.0, 0.25
PIXEL_VARIANCE = ROUNDING_VARIANCE = 1 / 12

# Pixels included around the printed grid; the blur ends well before.
MARGIN_PX = 8

# Steps of the central differences, radians and millimetres.
STEP_RAD, STEP_MM = 1e-5, 1e-3
# Those of offset (grey levels), contrast and blur (relative).
STEPS_OF_APPEARANCE = (1.0, 1e-3, 1e-3)


def distort(camera, x, y):
    """Raw pixels of rays, as in OpenCV."""
    k1, k2, p1, p2, k3 = (list(camera["distortion"]) + [0.0] * 5)[:5]
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    x, y = (
        x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
    )
    x_px = camera["fx_px"] * x + camera.get("skew_px", 0.0) * y + camera["cx_px"]
    return x_px, camera["fy_px"] * y + camera["cy_px"]


def undistort(camera, x_px, y_px):
    """Rays of raw pixels, by fixed-point iteration."""
    x, y = np.zeros_like(x_px), np.zeros_like(y_px)
    for _ in range(100):
        off_x, off_y = distort(camera, x, y)
        x = x + (x_px - off_x) / camera["fx_px"]
        y = y + (y_px - off_y) / camera["fy_px"]
    assert max(abs(x_px - off_x).max(), abs(y_px - off_y).max()) < 1e-6, "the lens folds over"
    return np.stack([x, y, np.ones_like(x)])


def read_pose(path, name):
    """A target in frame 0: rotation, position in mm."""
    rows = csv.DictReader(path.open())
    row = next(row for row in rows if row["frame"] == "0" and row["target"] == name)
    t1, t2, t3 = (float(row[f"theta{i}_rad"]) for i in (1, 2, 3))
    z_axis, y_axis, x_axis = np.eye(3)[::-1]
    rotation = turn(t1 * z_axis) @ turn(t2 * y_axis) @ turn(t3 * x_axis)
    return rotation, np.array([float(row[f"{axis}_mm"]) for axis in "xyz"])


def turn(vector):
    """The rotation by a vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


class Print:
    """One target's picture, as a function of its pose and how it appears."""

    def __init__(self, camera, target, pose, options):
        self.lines_mm = [
            (np.arange(count) - (count - 1) / 2) * target["pitch_mm"]
            for count in (target["columns"], target["rows"])
        ]
        self.half_mm = [lines[-1] + target["pitch_mm"] for lines in self.lines_mm]
        self.grey = options.black, options.white
        self.blur_px = np.sqrt(options.psf**2 + PIXEL_VARIANCE)
        rotation, position_mm = pose
        outline_mm = [[x * self.half_mm[0], y * self.half_mm[1], 0] for x in (-1, 1) for y in (-1, 1)]
        x, y, z = rotation @ np.array(outline_mm).T + position_mm[:, None]
        outline_px = distort(camera, x / z, y / z)
        sides = [np.arange(int(px.min()) - MARGIN_PX, px.max() + MARGIN_PX) for px in outline_px]
        self.rays = undistort(camera, *np.meshgrid(*sides))

    def draw(self, pose, offset=0.0, contrast=0.0, blur=0.0):
        rotation, position_mm = pose
        depth = (rotation[:, 2] @ position_mm) / np.tensordot(rotation[:, 2], self.rays, 1)
        place = self.rays * depth - position_mm[:, None, None]
        crossing, inside = 1.0, 1.0
        for axis in (0, 1):
            place_mm = np.tensordot(rotation[:, axis], place, 1)
            # Millimetres per pixel at right angles to the lines, anywhere in the picture.
            scale = np.hypot(*np.gradient(place_mm)) * self.blur_px * (1 + blur) * np.sqrt(2)
            for line_mm in self.lines_mm[axis]:
                crossing = crossing * erf((place_mm - line_mm) / scale)
            low, high = (erf((place_mm + side * self.half_mm[axis]) / scale) for side in (1, -1))
            inside = inside * (low - high) / 2
        black, white = self.grey
        # The outermost square at the top left is dark; to its right and below they alternate.
        parity = (-1) ** sum(map(len, self.lines_mm))
        dark = inside * (1 + parity * crossing) / 2
        return white + offset - (white - black) * (1 + contrast) * dark


def bound(picture, pose, noise, bits):
    """The least covariance of [turn in rad, position in mm]."""
    rotation, position_mm = pose
    columns = []
    for axis in np.eye(3):
        ahead, behind = (rotation @ turn(sign * STEP_RAD * axis) for sign in (1, -1))
        change = picture.draw((ahead, position_mm)) - picture.draw((behind, position_mm))
        columns.append(change / (2 * STEP_RAD))
    for axis in np.eye(3):
        ahead, behind = (position_mm + sign * STEP_MM * axis for sign in (1, -1))
        change = picture.draw((rotation, ahead)) - picture.draw((rotation, behind))
        columns.append(change / (2 * STEP_MM))
    for step in np.diag(STEPS_OF_APPEARANCE):
        columns.append((picture.draw(pose, *step) - picture.draw(pose, *-step)) / (2 * step.sum()))
    photons = (1 - READ_VARIANCE_SHARE) * picture.draw(pose) / NOISE_AT_GREY
    rounding = ROUNDING_VARIANCE * (255 / (2**bits - 1)) ** 2
    variance = noise**2 * (READ_VARIANCE_SHARE + photons) + rounding
    columns = np.stack([column.ravel() for column in columns], axis=1)
    information = columns.T @ (columns / variance.ravel()[:, None])
    return np.linalg.inv(information)[:6, :6]


def main():
    arguments = argparse.ArgumentParser(
        description="The Cramer-Rao bound of the positions in frame 0 of a simulated recording."
    )
    arguments.add_argument("simulated", type=Path, help="directory that plumb simulate has written")
    arguments.add_argument("--black", type=float, default=20.0, help="as given to plumb simulate")
    arguments.add_argument("--white", type=float, default=220.0, help="as given to plumb simulate")
    arguments.add_argument("--psf", type=float, default=0.6, help="as given to plumb simulate")
    arguments.add_argument("--noise", type=float, default=2.0, help="as given to plumb simulate")
    arguments.add_argument("--bits", type=int, default=8, help="as given to plumb simulate")
    options = arguments.parse_args()
    camera = tomllib.loads((options.simulated / "camera.toml").read_text())
    targets = tomllib.loads((options.simulated / "targets.toml").read_text())["target"]
    for target in targets:
        name = target["name"]
        pose = read_pose(options.simulated / "truth.csv", name)
        picture = Print(camera, target, pose, options)
        covariance = bound(picture, pose, options.noise, options.bits)
        for axis, variance in zip(("_x", "_y", ""), np.diag(covariance)[3:]):
            print(f"limit{axis}_mm:{name}\t{1.96 * np.sqrt(variance):.4f}")


if __name__ == "__main__":
    main()
