"""While something takes long, another thread of Python goes on."""

import glob

from lock import beside_another_thread, comes_another_thread

import plumbline

trials = sorted(glob.glob("trials/*"))

# What keeps the lock is seen to keep it.
comes, _ = comes_another_thread(lambda: sum(range(100_000)), patience_s=1)
assert not comes

for work in (
    lambda: plumbline._plumbline.figures(trials),
    lambda: plumbline._plumbline.study("study.toml"),
    lambda: plumbline._plumbline.open_trial(trials[0]),
):
    beside_another_thread(work)
trial = plumbline._plumbline.open_trial(trials[0])
for work in (trial._figures, trial.analyze, lambda: trial.export("csv", "out.csv", force=True)):
    beside_another_thread(work)
