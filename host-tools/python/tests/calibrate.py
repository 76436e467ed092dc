"""A calibration against that of `plumb calibrate`, and a camera's file."""

import glob
import pathlib

import numpy as np

import plumbline

photographs = sorted(glob.glob("dry/photos/*"))
camera = plumbline.calibrate(photographs, board=(9, 6), pitch_mm=20, model="radial2")
written = pathlib.Path("plumb.toml").read_text()
# Only the day may have changed meanwhile.
undated = [line for line in written.splitlines() if not line.startswith("date")]
assert [it for it in camera.to_toml().splitlines() if not it.startswith("date")] == undated
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
