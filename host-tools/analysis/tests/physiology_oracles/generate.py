"""Makes two ECGs and has NeuroKit find their R waves: writes the files beside itself.

    pip install neurokit2==0.2.13
    python generate.py

The ECGs are those of the model of McSharry et al. (2003), with noise; in microvolts, rounded
before they are analysed, so that the file is the data.
"""
import json
from pathlib import Path

import neurokit2 as nk
import numpy as np

HERE = Path(__file__).resolve().parent
out = []
for name, rate, duration, rate_bpm, spread, noise, seed in [
    ("rest", 250, 30, 62, 4, 0.02, 1),
    ("standing", 200, 24, 104, 6, 0.08, 2),
]:
    ecg = nk.ecg_simulate(duration, sampling_rate=rate, heart_rate=rate_bpm, heart_rate_std=spread, noise=noise, random_state=seed)
    ecg = np.round(ecg * 1e3).astype(int)
    (HERE / f"{name}.csv").write_text("ecg_uv\n" + "".join(f"{it}\n" for it in ecg))
    clean = nk.ecg_clean(ecg.astype(float), sampling_rate=rate)
    _, info = nk.ecg_peaks(clean, sampling_rate=rate)
    out.append({"name": name, "rate_hz": rate, "r_samples": info["ECG_R_Peaks"].tolist()})
(HERE / "oracles.json").write_text(json.dumps({"neurokit2": nk.__version__, "ecgs": out}) + "\n")
