"""Makes a trial and has scipy analyse it: writes signal.csv and oracles.json beside itself.

    pip install numpy==2.4.6 scipy==1.17.1
    python generate.py

The positions are rounded before they are analysed, so that the file is the data. Filter, spectra,
Butterworth and peaks are scipy's; percentiles, sway density and diffusion have no package and are
plain numpy by their definitions.
"""
import json
from pathlib import Path

import numpy as np
from scipy import signal

HERE = Path(__file__).resolve().parent
RATE, SAMPLES = 60, 2400
rng = np.random.Generator(np.random.PCG64(20250301))


def wander(speed, pull):
    """A point that is pushed at random, slowed down and pulled back."""
    x, v, out = 0.0, 0.0, []
    for push in rng.normal(0, speed, SAMPLES):
        v += push - 0.15 * v - pull * x
        x += v
        out.append(x)
    return np.array(out) + rng.normal(0, 0.02, SAMPLES)


xy = np.round([wander(0.035, 0.00035), wander(0.02, 0.0005)], 4)
with open(HERE / "signal.csv", "w", newline="\n") as file:
    file.write("ap_mm,ml_mm\n")
    file.writelines(f"{x:.4f},{y:.4f}\n" for x, y in xy.T)
out = {}

at = [0, 1, 2, 14, 15, 16, 1023, 1024, 1025, 1200, 2383, 2384, 2385, 2397, 2398, 2399]
out["savgol"] = []
for window in (5, 15, 31):
    value = signal.savgol_filter(xy[0], window, 2, mode="interp")
    out["savgol"].append({"window": window, "at": at, "value": value[at].tolist(), "path": np.abs(np.diff(value)).sum()})

out["butterworth"] = []
for order, cutoff in [(1, 3), (2, 10), (2, 0.5), (3, 6), (4, 5), (5, 12.5), (8, 20)]:
    value = signal.sosfiltfilt(signal.butter(order, cutoff, fs=RATE, output="sos"), xy[0])
    # A part as short as the filter takes.
    short = signal.sosfiltfilt(signal.butter(order, cutoff, fs=RATE, output="sos"), xy[0][: 3 * order + 4])
    out["butterworth"].append({"order": order, "cutoff_hz": cutoff, "at": at, "value": value[at].tolist(), "path": np.abs(np.diff(value)).sum(), "short": short.tolist()})


def percentile(f, p, q):
    running = np.concatenate([[0], np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(f))])
    return np.interp(q * running[-1], running, f)


out["spectra"] = {}
for name, (f, p) in {
    "periodogram_mean": signal.periodogram(xy[0], RATE, detrend="constant"),
    "periodogram_line": signal.periodogram(xy[0], RATE, detrend="linear"),
    "welch_mean": signal.welch(xy[0], RATE, "hann", 10 * RATE, detrend="constant"),
    # An odd number of samples in a part.
    "welch_line": signal.welch(xy[0], RATE, "hann", 7 * RATE + 1, detrend="linear"),
}.items():
    out["spectra"][name] = [(f * p).sum() / p.sum(), np.sqrt((f * f * p).sum() / p.sum()), percentile(f, p, 0.5), percentile(f, p, 0.95)]

RADIUS = 2.0
near = np.hypot(xy[0][:, None] - xy[0], xy[1][:, None] - xy[1]) <= RADIUS
dwell = np.empty(SAMPLES)
for i in range(SAMPLES):
    a = b = i
    while a > 0 and near[i, a - 1]:
        a -= 1
    while b + 1 < SAMPLES and near[i, b + 1]:
        b += 1
    dwell[i] = (b - a + 1) / RATE
curve = signal.sosfiltfilt(signal.butter(4, 2.5, fs=RATE, output="sos"), dwell)
peaks, _ = signal.find_peaks(curve)
out["density"] = {"radius_mm": RADIUS, "means": [curve[peaks].mean(), np.diff(peaks).mean() / RATE, np.hypot(*np.diff(xy[:, peaks])).mean()]}

lags = np.arange(1, 10 * RATE + 1)
x2, y2 = ([np.mean((x[k:] - x[:-k]) ** 2) for k in lags] for x in xy)
out["diffusion"] = {}
for name, msd in {"ap": np.array(x2), "ml": np.array(y2), "transverse": np.array(x2) + np.array(y2)}.items():
    t = lags / RATE

    def error(split):
        return sum(((np.polyval(np.polyfit(t[r], msd[r], 1), t[r]) - msd[r]) ** 2).sum() for r in (slice(0, split), slice(split, None)))

    split = min(range(round(0.1 * RATE), round(2.5 * RATE) + 1), key=error)
    short, long = np.polyfit(t[:split], msd[:split], 1), np.polyfit(t[split:], msd[split:], 1)
    critical = (long[1] - short[1]) / (short[0] - long[0])
    hurst = [np.polyfit(np.log(t[r]), np.log(msd[r]), 1)[0] / 2 for r in (slice(0, split), slice(split, None))]
    out["diffusion"][name] = [short[0] / 2, long[0] / 2, critical, np.polyval(short, critical), *hurst, split / RATE]

(HERE / "oracles.json").write_text(json.dumps(out, indent=1) + "\n")
