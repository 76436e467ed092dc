"""The simulated scene drawn by an independent renderer, and tracked.

`plumb simulate` and the tracker have the same authors, and could share a mistake
about where a pixel's centre or a print's edge lies. Here the ray tracer Mitsuba 3
draws the same prints at the same true poses; of the project's own renderer only the
parameters are used.

    python3 -m venv venv && venv/bin/pip install mitsuba
    cargo build --release --locked --package plumb
    target/release/plumb simulate --lens none --frames 120 --out trial
    venv/bin/python host-tools/bench/mitsuba_scene.py trial trial-mitsuba

The second directory gets frames.y4m, its truth.csv, and the first one's other files,
so that whatever reads the first can read the second. `cargo xtask bench` does the same when
its python3 has Mitsuba. It is not part of the tests. A drawing takes some six seconds on
two cores; where Mitsuba finds no LLVM (Debian's libllvm), four times that.

What is drawn: each target is a rectangle whose texture has one texel per square,
unfiltered, so that its edges are the ray tracer's own. It glows with the grey that
the paper would reflect, which is how paper looks in even light. Every pixel is
divided into 8 x 8 cells, each the mean of 16 rays that differ from cell to cell: with 4,
the drawing's own noise moved the depth by a third of what the sensor's does, with 16 by
a tenth (0.002 and 0.003 mm, +-1.96 SD, compared with 64 rays). The lens's blur (Gaussian),
the pixel's square, and the sensor's noise and 8 bits are computed with numpy. Everything
else is grey: only the prints and their surroundings are traced, and have noise.

Drawing takes longest, so each drawing can be exposed many times, with independent noise.
The target then stands still for all exposures of a drawing, and moves on by a frame's way
for the next one: with only four, it would stop and go fifteen times a second as nobody
does, which no prediction follows and which costs the lumbar target 4 % of its precision.

Prints, after tracking, one line per figure: name, tab, value. Errors are what
`plumb track` found minus the truth, in millimetres in the camera's frame: `spread`
is 1.96 standard deviations over the frames, `bias` the mean; where no axis is named,
both are those of the depth. `normalised` is the root mean square of the depth's errors in
stated standard deviations. `drawn` is the part of `spread` that is the same in all exposures of
a drawing: what the drawing, and not the sensor's noise, contributes. The first frame is
left out, since its targets are searched for.
"""

import argparse
import csv
import math
import os
import re
import shutil
import subprocess
import sys
import tomllib
from fractions import Fraction
from pathlib import Path

try:
    import mitsuba as mi
    import numpy as np

    from recording import read_deviations, read_poses
except ImportError as error:
    sys.exit(
        f"error: {error}: Mitsuba 3 is needed, which brings numpy along; "
        "get it with `python3 -m venv venv && venv/bin/pip install mitsuba`, "
        "and run this script with venv/bin/python"
    )

# The standard scene of `plumb simulate`.
BLACK, WHITE, BACKGROUND = 20.0, 220.0, 90.0
BLUR_PX = 0.6
NOISE, NOISE_AT_GREY, READ_VARIANCE_SHARE = 2.0, 120.0, 0.25

FINE = 8
RAYS = 16
# The blur's reach: beyond 6 standard deviations and half a pixel nothing is left.
REACH_PX = math.ceil(6 * BLUR_PX + 0.5)

# A pose farther from the truth than this belongs to something else.
FALSE_MM = 20.0

PROGRESS_EVERY = 20


def newest_llvm():
    """The path of the newest LLVM that the system has, or None.

    Mitsuba takes any, and old ones abort on what it compiles for new processors.
    """
    found = {}
    for path in Path("/usr/lib").glob("*/libLLVM*.so*"):
        if version := re.fullmatch(r"libLLVM(?:-(\d+)[.\d]*\.so|\.so\.(\d+)).*", path.name):
            found[int(version[1] or version[2])] = path
    return found[max(found)] if found else None


def choose_variant():
    """Chooses the fast variant, which compiles with LLVM, or else the slow one."""
    if llvm := newest_llvm():
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(llvm))
    for variant in ("llvm_ad_mono", "scalar_rgb"):
        try:
            mi.set_variant(variant)
            mi.Float(0.0) + 1.0
            return
        except (ImportError, RuntimeError) as error:
            print(f"{variant} does not run here: {error}", file=sys.stderr)
    sys.exit("error: this build of Mitsuba runs neither with LLVM nor without")


def read_camera(path):
    camera = tomllib.loads(path.read_text())
    if any(camera["distortion"]) or camera.get("skew_px", 0.0) != 0.0:
        sys.exit(f"error: {path}: Mitsuba's lens is a pinhole; use `plumb simulate --lens none`")
    if camera["fx_px"] != camera["fy_px"]:
        sys.exit(f"error: {path}: Mitsuba's pixels are square, but fx_px and fy_px differ")
    if camera.get("readout_ms", 0.0) != 0.0:
        sys.exit(f"error: {path}: all rows are drawn at once, but readout_ms is not 0")
    return camera


def read_targets(path):
    """name -> the print, one grey per square, and half its width and height in mm."""
    targets = {}
    for target in tomllib.loads(path.read_text())["target"]:
        if target.get("origin", "center") != "center":
            sys.exit(f'error: {path}: {target["name"]}: only origin = "center" is drawn')
        # One more square than corners, and a margin of one pitch on either side.
        columns, rows = target["columns"] + 3, target["rows"] + 3
        print_greys = np.full((rows, columns), WHITE)
        squares = print_greys[1:-1, 1:-1]
        y, x = np.indices(squares.shape)
        squares[(x + y) % 2 == 0] = BLACK
        half_mm = np.array([columns, rows]) * target["pitch_mm"] / 2
        targets[target["name"]] = print_greys, half_mm
    return targets


def crop_around(camera, half_mm, pose):
    """The pixels that the print and its blur reach: left, top, width, height."""
    rotation, position_mm = pose
    outline_mm = np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)])
    outline_mm[:, :2] *= half_mm
    x, y, z = rotation @ outline_mm.T + position_mm[:, None]
    outline_px = np.array(
        [camera["fx_px"] * x / z + camera["cx_px"], camera["fy_px"] * y / z + camera["cy_px"]]
    )
    # Twice the reach, so that what the blur mixes in at the crop's own border is grey too.
    low = np.floor(outline_px.min(1)).astype(int) - 2 * REACH_PX
    high = np.ceil(outline_px.max(1)).astype(int) + 2 * REACH_PX
    if low.min() < 0 or high[0] >= camera["width_px"] or high[1] >= camera["height_px"]:
        sys.exit("error: a print leaves the frame; give `plumb simulate` a larger --distance")
    return *low, *(high - low)


def sensor(camera, crop):
    width, height = camera["width_px"], camera["height_px"]
    left, top, crop_width, crop_height = (int(value) * FINE for value in crop)
    return {
        "type": "perspective",
        # Mitsuba's camera has x to the left and y up.
        "to_world": mi.ScalarTransform4f().scale([-1, -1, 1]),
        "fov": math.degrees(2 * math.atan(width / 2 / camera["fx_px"])),
        "fov_axis": "x",
        # From the film's middle, as shares of its sides; it moves the picture in the
        # opposite direction. Mitsuba's origin is the first pixel's corner, not its centre.
        "principal_point_offset_x": 0.5 - (camera["cx_px"] + 0.5) / width,
        "principal_point_offset_y": 0.5 - (camera["cy_px"] + 0.5) / height,
        "near_clip": 10.0,
        "far_clip": 1e5,
        "film": {
            "type": "hdrfilm",
            "width": width * FINE,
            "height": height * FINE,
            "crop_offset_x": left,
            "crop_offset_y": top,
            "crop_width": crop_width,
            "crop_height": crop_height,
            "rfilter": {"type": "box"},
            "pixel_format": "luminance",
            "component_format": "float32",
        },
        "sampler": {"type": "multijitter", "sample_count": RAYS},
    }


def glowing_print(print_greys, half_mm, pose):
    # Mitsuba's rectangle has sides of 2, y up and its face towards +z; a target has y
    # down and its face towards -z.
    cam_from_rectangle = np.eye(4)
    cam_from_rectangle[:3, :3] = pose[0] @ np.diag([half_mm[0], -half_mm[1], -1.0])
    cam_from_rectangle[:3, 3] = pose[1]
    # A picture's first row is at v = 0, the rectangle's lower side.
    greys = np.ascontiguousarray(print_greys[::-1, :, None], dtype=np.float32)
    radiance = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(greys),
        "raw": True,
        "filter_type": "nearest",
        "wrap_mode": "clamp",
    }
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(cam_from_rectangle),
        "emitter": {"type": "area", "radiance": radiance},
    }


def pixels_from_fine(count):
    """The matrix from the fine cells along a side to its pixels: each pixel's own
    square, blurred. The REACH_PX pixels at either end are left out."""

    def normal_cdf(distance_px):
        return 0.5 * math.erfc(-distance_px / BLUR_PX / math.sqrt(2))

    fine_px = (np.arange(count * FINE) + 0.5) / FINE - 0.5
    matrix = np.zeros((count - 2 * REACH_PX, count * FINE))
    for row, pixel in enumerate(range(REACH_PX, count - REACH_PX)):
        for cell in np.flatnonzero(abs(fine_px - pixel) < REACH_PX):
            distance_px = fine_px[cell] - pixel
            matrix[row, cell] = normal_cdf(distance_px + 0.5) - normal_cdf(distance_px - 0.5)
    return matrix / matrix.sum(1, keepdims=True)


def draw(camera, targets, poses, number):
    """One frame before noise, in levels of 255, and the parts of it that were traced."""
    frame = np.full((camera["height_px"], camera["width_px"]), BACKGROUND)
    here = {name: poses[number, name] for name in targets}
    scene = {
        "type": "scene",
        # Glowing surfaces are seen, but light nothing.
        "integrator": {"type": "path", "max_depth": 1},
        "background": {"type": "constant", "radiance": {"type": "rgb", "value": BACKGROUND}},
    }
    for name, (print_greys, half_mm) in targets.items():
        scene[name] = glowing_print(print_greys, half_mm, here[name])
    scene = mi.load_dict(scene)
    traced = []
    for index, (name, (_, half_mm)) in enumerate(targets.items()):
        crop = crop_around(camera, half_mm, here[name])
        left, top, width, height = crop
        view = mi.load_dict(sensor(camera, crop))
        seed = number * len(targets) + index
        fine = np.array(mi.render(scene, sensor=view, spp=RAYS, seed=seed), dtype=float)
        fine = fine.reshape(height * FINE, width * FINE)
        inner = np.s_[
            top + REACH_PX : top + height - REACH_PX, left + REACH_PX : left + width - REACH_PX
        ]
        frame[inner] = pixels_from_fine(height) @ fine @ pixels_from_fine(width).T
        traced.append(inner)
    return frame, traced


def expose(frame, traced, random):
    """The frame in 8 bits, with the sensor's photon and read noise where it was traced."""
    noisy = frame.copy()
    for part in traced:
        photons = (1 - READ_VARIANCE_SHARE) * frame[part] / NOISE_AT_GREY
        sd = NOISE * np.sqrt(READ_VARIANCE_SHARE + photons)
        noisy[part] = random.normal(frame[part], sd)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def read_rate(path):
    """Frames per second, as the header of a Y4M video writes it."""
    with path.open("rb") as video:
        header = video.readline().decode()
    return next(field[1:] for field in header.split() if field.startswith("F"))


def write_truth(simulated, out, drawings, exposures, rate):
    """The truth of each exposure: that of its drawing, at its own time."""
    rate_hz = Fraction(rate.replace(":", "/"))
    with simulated.open(newline="") as source, out.open("w", newline="") as copy:
        rows = csv.DictReader(source)
        of_drawing = [[] for _ in range(drawings)]
        for row in rows:
            if (number := int(row["frame"])) < drawings:
                of_drawing[number].append(row)
        table = csv.DictWriter(copy, rows.fieldnames, lineterminator="\n")
        table.writeheader()
        for frame in range(drawings * exposures):
            own = {"frame": frame, "time_s": float(frame / rate_hz)}
            table.writerows(row | own for row in of_drawing[frame // exposures])


def write_frames(path, camera, targets, poses, drawings, exposures, rate):
    random = np.random.default_rng(1)
    with path.open("wb") as video:
        width, height = camera["width_px"], camera["height_px"]
        video.write(f"YUV4MPEG2 W{width} H{height} F{rate} Ip Cmono\n".encode())
        for number in range(drawings):
            if number % PROGRESS_EVERY == 0:
                print(f"drawing {number} of {drawings}", file=sys.stderr, flush=True)
            frame, traced = draw(camera, targets, poses, number)
            for _ in range(exposures):
                video.write(b"FRAME\n")
                video.write(expose(frame, traced, random).tobytes())


def find_plumb():
    built = Path(__file__).resolve().parents[2] / "target/release/plumb"
    found = built if built.exists() else shutil.which("plumb")
    if not found:
        sys.exit("error: no program plumb; make it with `cargo build --release --locked --package plumb`")
    return found


def track(plumb, directory):
    """The poses that `plumb track` finds, and the deviations that it states."""
    files = {name: directory / name for name in ("camera.toml", "targets.toml", "poses.csv")}
    command = [plumb, "track", "--camera", files["camera.toml"], "--targets", files["targets.toml"]]
    command += ["--out", files["poses.csv"], directory / "frames.y4m"]
    subprocess.run(command, check=True, stdout=sys.stderr)
    return read_poses(files["poses.csv"]), read_deviations(files["poses.csv"])


def say_errors(name, found, truth, drawings, exposures):
    poses, deviations_mm = found
    errors_mm = np.full((drawings * exposures, 3), np.nan)
    in_sd = np.full(drawings * exposures, np.nan)
    # The first frame is that of the search.
    for frame in range(1, drawings * exposures):
        if (frame, name) not in poses:
            continue
        error_mm = poses[frame, name][1] - truth[frame, name][1]
        if np.linalg.norm(error_mm) < FALSE_MM:
            errors_mm[frame] = error_mm
            in_sd[frame] = error_mm[2] / deviations_mm[frame, name][2]
    lost = np.isnan(in_sd[1:]).sum()
    print(f"tracking_lost:{name}\t{lost}")
    if lost == drawings * exposures - 1:
        sys.exit(f"error: {name} was found in no frame")
    spreads, biases = 1.96 * np.nanstd(errors_mm, 0), np.nanmean(errors_mm, 0)
    for axis, spread, bias in zip(("_x", "_y", ""), spreads, biases):
        print(f"tracking_spread{axis}_mm:{name}\t{spread:.4f}")
        print(f"tracking_bias{axis}_mm:{name}\t{bias:.4f}")
    print(f"tracking_normalised:{name}\t{np.sqrt(np.nanmean(in_sd**2)):.3f}")
    if drawings > 1 and exposures > 2:
        drawn = math.sqrt(drawn_variance(errors_mm[:, 2].reshape(drawings, exposures)))
        print(f"tracking_drawn_mm:{name}\t{1.96 * drawn:.4f}")


def drawn_variance(errors):
    """The variance of the drawings' own errors, from those of their exposures: that of the
    drawings' means, less what the noise leaves in a mean."""
    counts = np.sum(~np.isnan(errors), 1)
    errors, counts = errors[counts > 1], counts[counts > 1]
    of_noise = np.mean(np.nanvar(errors, 1, ddof=1) / counts)
    return max(0.0, np.nanmean(errors, 1).var(ddof=1) - of_noise)


def main():
    arguments = argparse.ArgumentParser(
        description="Draws a scene of `plumb simulate --lens none` with Mitsuba 3 and tracks it."
    )
    arguments.add_argument("simulated", type=Path, help="directory that plumb simulate has written")
    arguments.add_argument("out", type=Path, help="directory to write into")
    arguments.add_argument("--drawings", type=int, help="draw only the first DRAWINGS frames")
    arguments.add_argument(
        "--exposures", type=int, default=1, help="frames of each drawing, with their own noise"
    )
    arguments.add_argument("--plumb", type=Path, help="the program plumb, if not found")
    arguments = arguments.parse_args()
    plumb = arguments.plumb or find_plumb()
    camera = read_camera(arguments.simulated / "camera.toml")
    targets = read_targets(arguments.simulated / "targets.toml")
    poses = read_poses(arguments.simulated / "truth.csv")
    drawings = 1 + max(number for number, _ in poses)
    drawings = min(drawings, arguments.drawings or drawings)
    exposures = arguments.exposures
    choose_variant()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in ("camera.toml", "targets.toml", "scene.toml"):
        shutil.copy(arguments.simulated / name, arguments.out / name)
    rate = read_rate(arguments.simulated / "frames.y4m")
    truth_csv = arguments.out / "truth.csv"
    write_truth(arguments.simulated / "truth.csv", truth_csv, drawings, exposures, rate)
    frames = arguments.out / "frames.y4m"
    write_frames(frames, camera, targets, poses, drawings, exposures, rate)
    found = track(plumb, arguments.out)
    truth = read_poses(truth_csv)
    print(f"version\t{mi.__version__}")
    print(f"frames\t{drawings * exposures}")
    print(f"drawings\t{drawings}")
    for name in targets:
        say_errors(name, found, truth, drawings, exposures)


if __name__ == "__main__":
    main()
