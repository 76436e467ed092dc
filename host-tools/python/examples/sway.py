"""Sway by condition, from a folder of trials: run it, or open it as a notebook (`# %%` begins a cell).

    python sway.py trials sway.png
"""

# %% The trials
import pathlib
import sys

import matplotlib.pyplot as plt
import numpy as np

import plumbline

folder, picture = sys.argv[1:] if len(sys.argv) == 3 else ("trials", "sway.png")
trials = [plumbline.open_trial(path) for path in sorted(pathlib.Path(folder).iterdir())]
usable = [trial for trial in trials if trial.grade != "unusable"]
for trial in trials:
    print(f"{trial.title}: {trial.grade}; {len(trial)} frames, {np.sum(~trial.received)} never came")

# %% Their figures, one row each: as `plumb figures`
table = plumbline.figures([trial.path for trial in usable])
paths = [
    row
    for row in table.rows()
    if (row["figure"], row["direction"], row["segment"]) == ("mean velocity", "APML", "whole")
]
conditions = list(dict.fromkeys(row["condition"] for row in paths))
for condition in conditions:
    for trunk in ("lower", "upper"):
        values = [it["value"] for it in paths if (it["condition"], it["trunk"]) == (condition, trunk)]
        print(f"{condition}, {trunk} trunk: mean velocity {np.mean(values):.2f} mm/s (n = {len(values)})")

# %% Paths from above, and the figure by condition
figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
colours = {condition: f"C{at}" for at, condition in enumerate(conditions)}
for axes, name in ((left, "lower"), (middle, "upper")):
    for trial in usable[: len(conditions)]:
        points = getattr(trial, name)
        # t = 0 is the mark; NaN leaves a gap in the line.
        ap, ml, _ = points.position_mm[trial.time_s >= 0].T
        axes.plot(
            ml - np.nanmean(ml),
            ap - np.nanmean(ap),
            lw=0.7,
            color=colours[trial.condition],
            label=trial.title,
        )
    axes.set(title=f"{name} trunk, from above", xlabel="ML, to the right (mm)", ylabel="AP, forward (mm)")
    axes.set_aspect("equal", "datalim")
    axes.legend(fontsize="small")
for at, condition in enumerate(conditions):
    of_condition = [it for it in paths if it["condition"] == condition and it["trunk"] == "upper"]
    values = [it["value"] for it in of_condition]
    # None where it is not known.
    noise = np.array([it["standard_uncertainty"] for it in of_condition], float)
    places = at + np.linspace(-0.1, 0.1, len(values))
    right.errorbar(places, values, yerr=noise, fmt="o", color=colours[condition])
    right.hlines(np.mean(values), at - 0.25, at + 0.25, color=colours[condition])
right.set(title="upper trunk, each participant", ylabel="mean velocity, AP and ML (mm/s)")
right.set_xticks(range(len(conditions)), conditions)
right.set_xlim(-0.5, len(conditions) - 0.5)
right.set_ylim(bottom=0)
figure.savefig(picture, dpi=120)
