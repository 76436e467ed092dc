"""A calibration against that of `plumb calibrate`, and a camera's file."""

import glob
import pathlib

import numpy as np
from lock import beside_another_thread
from PIL import Image

import plumbline

photographs = sorted(glob.glob("dry/photos/*"))
HOW = {"board": (9, 6), "pitch_mm": 20, "model": "radial2"}
camera = beside_another_thread(lambda: plumbline.calibrate(photographs, **HOW))
written = pathlib.Path("plumb.toml").read_text()
# Only the day may have changed meanwhile.
undated = [line for line in written.splitlines() if not line.startswith("date")]
assert [it for it in camera.to_toml().splitlines() if not it.startswith("date")] == undated
# The same photographs in arrays have names of their own.
grey = [np.asarray(Image.open(path).convert("L")) for path in photographs]
wide = [image.astype(np.uint16) * 4 for image in grey]
named = camera.to_toml()
for at, path in enumerate(photographs):
    named = named.replace(f'"{path}"', f'"images[{at}]"')
assert named != camera.to_toml()
assert plumbline.calibrate(grey, **HOW).to_toml() == named
# Of 10 bits, every other row of an array twice as high.
views = [np.repeat(image, 2, axis=0)[::2] for image in wide]
assert plumbline.calibrate(views, white_level=1020, **HOW).to_toml() == named


def refused(kind, found, images, **options):
    try:
        plumbline.calibrate(images, **{**HOW, **options})
    except kind as error:
        assert found in str(error), error
    else:
        raise AssertionError(f"{found}: nothing was refused")


refused(plumbline.BadInput, "images[1]: image size", [grey[0], grey[1][:-1]])
refused(plumbline.BadInput, "images[0]: image size", [grey[0][:, :600]] * 3)
refused(plumbline.BadInput, "more than 200", [grey[0]] * 201)
refused(plumbline.BadInput, "white_level", grey, white_level=0)
refused(plumbline.BadInput, "white_level", photographs, white_level=255)
refused(plumbline.BadInput, "1 of 1 show", grey[:1])
refused(TypeError, "images[1]", [grey[0], grey[1].astype(float)])
refused(TypeError, "files and arrays", [grey[0], photographs[0]])

camera.save("python.toml")
try:
    camera.save("python.toml")
except plumbline.BadInput as error:
    assert error.place == "python.toml"
else:
    raise AssertionError("a file was replaced")
camera.save("python.toml", force=True)
again = plumbline.Camera.open("python.toml")
assert again.to_toml() == camera.to_toml()

for camera in (camera, again):
    count = len(camera.names)
    assert camera.names == ["fx_px", "fy_px", "cx_px", "cy_px", "skew_px", "k1", "k2"]
    assert (camera.model, camera.width_px, camera.height_px) == ("radial2", 640, 480)
    assert camera.values.shape == camera.sd.shape == (count,) and np.all(camera.sd > 0)
    assert camera.correlations.shape == (count, count)
    assert np.array_equal(camera.correlations, camera.correlations.T)
    assert np.all(np.linalg.eigvalsh(camera.correlations) > -1e-9)
    assert camera.distortion.tolist() == camera.values[5:].tolist()
    fx, fy, cx, cy, skew = camera.values[:5]
    assert camera.matrix.tolist() == [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]
    assert 0 < camera.rms_px < 1 and camera.images == 6 and camera.readout_ms == 0
    assert isinstance(camera.concerns, list) and camera.date
    assert [it["file"] for it in camera.photographs] == photographs

# The truth that the photographs were rendered with lies within a few standard deviations.
truth = plumbline.Camera.open("dry/truth/camera.toml")
off = (camera.values[:4] - truth.values[:4]) / camera.sd[:4]
assert np.all(np.abs(off) < 6), off
assert truth.sd is None and truth.correlations is None and truth.concerns is None
