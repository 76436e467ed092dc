"""Computes figures of a large cohort by SQL from the Parquet files alone, and compares them with
plumb's: path length and RMS of the positions with `plumb figures --filter none` of some trials, the
means of the table of figures with those of `plumb study`."""

import csv
import json
import time

import duckdb

POINTS = "cohort/points/**/*.parquet"
SQL = f"""
with samples as (
    select trial, time_s, lower_ap_mm as ap, lower_ml_mm as ml from '{POINTS}'
    where lower_ap_mm is not null and time_s >= 0
), steps as (
    select *, ap - lag(ap) over each as dap, ml - lag(ml) over each as dml from samples
    window each as (partition by trial order by time_s)
)
select trial, sum(sqrt(dap * dap + dml * dml)), stddev_pop(ap) from steps group by all
"""

begun = time.monotonic()
found = {trial: {"path length": path, "RMS": rms} for trial, path, rms in duckdb.sql(SQL).fetchall()}
took_s = time.monotonic() - begun
folders = dict(duckdb.sql("select 'trials/' || folder, trial from 'cohort/trials/*.parquet'").fetchall())
assert len(found) == len(folders)

worst, compared = 0.0, 0
with open("none.csv", newline="", encoding="utf-8") as file:
    for row in csv.DictReader(file):
        chosen = (row["figure"], row["direction"]) in [("path length", "APML"), ("RMS", "AP")]
        if chosen and row["trunk"] == "lower" and row["segment"] == "whole":
            own = found[folders[row["trial"]]][row["figure"]]
            worst = max(worst, abs(own / float(row["value"]) - 1))
            compared += 1
assert compared > 0 and worst < 1e-10, (compared, worst)

with open("study.json", encoding="utf-8") as file:
    study = json.load(file)
means = duckdb.sql(
    """select figure, direction, trunk, condition, segment, avg(value), count(value)
       from 'cohort/figures/*.parquet' where figure = 'path length' group by all"""
).fetchall()
means = {row[:5]: row[5:] for row in means}
differs, cells = 0.0, 0
for response in study["sway"]:
    if response["figure"] != "path length":
        continue
    for cell in response["inference"]["cells"]:
        condition, segment = cell["levels"]
        key = (response["figure"], response["direction"], response["point"], condition, segment)
        mean, count = means[key]
        assert count == response["n"], (key, count, response["n"])
        differs = max(differs, abs(mean / cell["raw"]["mean"] - 1))
        cells += 1
assert cells > 0 and differs < 1e-12, (cells, differs)
print(
    f"DuckDB: path length and RMS of {len(found)} trials in {took_s:.1f} s; {compared} figures within "
    f"{worst:.1e} of plumb's, {cells} means within {differs:.1e}"
)
