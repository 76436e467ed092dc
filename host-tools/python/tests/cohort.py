"""A cohort against its own Parquet and what `plumb` computes, to the last bit."""

import csv
import json
import shutil

import numpy as np
import pyarrow.dataset
from lock import beside_another_thread

import plumbline

cohort = beside_another_thread(lambda: plumbline.open_cohort("cohort"))
assert len(cohort) == 6 and str(cohort.path) == "cohort" and "6 trials" in repr(cohort)

# The table of trials is that of the Parquet.
trials = cohort.trials()
assert [*zip(trials["participant"], trials["condition"])][:3] == [
    ("p01", "control"),
    ("p01", "foam"),
    ("p02", "control"),
]
kept = pyarrow.dataset.dataset("cohort/trials").to_table()
kept = kept.sort_by([(name, "ascending") for name in ("participant", "session", "condition", "run")])
ours = trials.to_arrow()
assert ours.column_names == kept.column_names
for name in kept.column_names:
    theirs = kept[name].to_pylist()
    if pyarrow.types.is_timestamp(kept[name].type):
        theirs = [it and it.replace(tzinfo=None) for it in theirs]
    assert ours[name].to_pylist() == theirs, name
assert all(row["age_years"] is None and row["run"] == 1 for row in trials.rows())
assert trials["started"].dtype == np.dtype("datetime64[us]")
trials.to_pandas()
trials.to_polars()


def values(path):
    with open(path, newline="") as file:
        return [float(row["value"]) if row["value"] else None for row in csv.DictReader(file)]


figures = beside_another_thread(cohort._inner._figures)
figures = list(plumbline.Table(figures).rows())
assert [row["value"] for row in figures] == values("figures.csv")
assert all(row["standard_uncertainty"] is None for row in figures)
chosen = [row["trial"] for row in trials.rows() if row["condition"] == "foam"]
method = {"filter": "butterworth:10", "bins": [(0, 8), (8, 20)]}
found = list(cohort.figures(iter(chosen), **method).rows())
assert [row["value"] for row in found] == values("chosen.csv")
assert {row["trial"] for row in found} == set(chosen) and {row["session"] for row in found} == {"1"}
assert len(cohort.figures([])) == 0

# The study names other trials, which are not read.
with open("study.json") as file:
    assert plumbline.study("elsewhere.toml", cohort="cohort") == json.load(file)


def refused(work, place, field="", found=""):
    try:
        work()
    except plumbline.BadInput as error:
        assert place in error.place and field in error.field and found in error.found, error
    else:
        raise AssertionError(f"{place}, {field}: nothing was refused")


refused(lambda: plumbline.open_cohort("trials"), "trials", found="no cohort")
refused(lambda: cohort.figures(["x"]), "figures", "trials", "x")
refused(lambda: cohort.figures(filter="gauss"), "figures", "filter", "gauss")
refused(lambda: plumbline.study("elsewhere.toml", cohort="nowhere"), "nowhere")

# The same of columns, as a cluster has them; what does not belong together is refused.
path = "cohort/points/participant=p01/session=1/condition=foam/run=1/points.parquet"
points = pyarrow.dataset.dataset(path).to_table()
row = kept.slice(1, 1)


def columns(table):
    def given(column):
        if pyarrow.types.is_timestamp(column.type):
            return column.cast(pyarrow.int64()).to_pylist()
        return column.to_numpy() if pyarrow.types.is_floating(column.type) else column.to_pylist()

    return {name: given(table[name]) for name in table.column_names}


one = plumbline._plumbline.figures_of_points
found = plumbline.Table(one(columns(row), columns(points)))
assert list(found.rows()) == figures[len(figures) // 6 : len(figures) // 3]
names = [name for table in ("trials", "points") for name, _ in plumbline._plumbline.cohort_columns(table)]
assert names == kept.column_names + points.column_names
refused(lambda: one(columns(row), columns(points.slice(1))), "p01", found="1794 frames")
refused(lambda: one(columns(kept), columns(points)), "table of trials", found="not one row")
refused(lambda: one(columns(row.drop(["zero_s"])), columns(points)), "table of trials", "zero_s")
refused(lambda: one(columns(row), columns(points.drop(["upper_ap_mm"]))), "p01", "upper_ap_mm")
refused(lambda: one({**columns(row), "run": ["one"]}, columns(points)), "table of trials", "run")
backwards = columns(points.take(list(range(len(points)))[::-1]))
refused(lambda: one(columns(row), backwards), "p01", "lower")
refused(lambda: plumbline._plumbline.cohort_columns("people"), "cohort_columns", "table", "people")

shutil.rmtree("cohort/points/participant=p02")
refused(cohort.figures, "p02")
