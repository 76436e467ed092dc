"""Reads cohort/ with the programs that people use, and prints as JSON what they find."""

import csv
import json
import math

import duckdb
import pandas
import polars
import pyarrow.dataset

KEY = ["participant", "session", "condition", "run"]
TRIAL = KEY + ["started", "age_years", "sex", "verdict", "rate_hz", "is_zero_set"]
POINTS = "cohort/points/**/*.parquet"


def plain(rows):
    """Values as JSON has them: instants as ISO, no value as null."""

    def of(value):
        if value is None or isinstance(value, float) and math.isnan(value):
            return None
        if hasattr(value, "isoformat"):
            return value.isoformat().replace("+00:00", "").replace("Z", "")
        return value.item() if hasattr(value, "item") else value

    return [[of(value) for value in row] for row in rows]


def trials():
    order = ", ".join(KEY)
    con = duckdb.connect()
    con.sql("SET TimeZone = 'UTC'")
    names = ", ".join(TRIAL)
    by_duckdb = con.sql(f"select {names} from 'cohort/trials/*.parquet' order by {order}").fetchall()
    by_polars = polars.scan_parquet("cohort/trials/*.parquet").select(TRIAL).sort(KEY).collect().rows()
    table = pyarrow.dataset.dataset("cohort/trials", format="parquet").to_table(TRIAL)
    by_pyarrow = [tuple(row.values()) for row in table.sort_by([(it, "ascending") for it in KEY]).to_pylist()]
    frame = pandas.read_parquet("cohort/trials")[TRIAL].sort_values(KEY)
    by_pandas = frame.astype(object).where(frame.notna(), None).itertuples(index=False)
    found = {"duckdb": by_duckdb, "polars": by_polars, "pyarrow": by_pyarrow, "pandas": by_pandas}
    return {name: plain(rows) for name, rows in found.items()}


def points():
    """Rows, positions and the sum of the lower trunk's, by the key that the folders' names hold."""
    key = {name: "varchar" for name in KEY}
    types = ", ".join(f"'{name}': {of}" for name, of in key.items())
    source = f"read_parquet('{POINTS}', hive_partitioning = true, hive_types = {{{types}}})"
    by_duckdb = duckdb.sql(
        f"select {', '.join(KEY)}, count(*), count(lower_ap_mm), round(sum(lower_ap_mm), 6) "
        f"from {source} group by all order by {', '.join(KEY)}"
    ).fetchall()
    strings = {name: polars.String for name in KEY}
    scan = polars.scan_parquet(POINTS, hive_partitioning=True, hive_schema=strings)
    rows = scan.group_by(KEY).agg(
        polars.len(), polars.col("lower_ap_mm").count().alias("n"), polars.col("lower_ap_mm").sum().round(6)
    )
    by_polars = rows.sort(KEY).collect().rows()
    schema = pyarrow.schema([(name, pyarrow.string()) for name in KEY])
    partitioning = pyarrow.dataset.partitioning(schema, flavor="hive")
    table = pyarrow.dataset.dataset("cohort/points", format="parquet", partitioning=partitioning).to_table()
    frame = table.to_pandas()
    by_pyarrow, by_pandas = [], []
    for of, into in [(frame, by_pyarrow), (pandas.read_parquet("cohort/points", partitioning=partitioning), by_pandas)]:
        for of_trial, own in of.groupby(KEY):
            own = own["lower_ap_mm"]
            into.append([*of_trial, len(own), int(own.count()), round(float(own.sum()), 6)])
    found = {"duckdb": by_duckdb, "polars": by_polars, "pyarrow": by_pyarrow, "pandas": by_pandas}
    return {name: plain(rows) for name, rows in found.items()}


SQL = """
with samples as (
    select trial, trunk, time_s, ap, ml from (
        select trial, 'lower' as trunk, coalesce(lower_time_s, time_s) as time_s,
               lower_ap_mm as ap, lower_ml_mm as ml from 'POINTS'
        union all
        select trial, 'upper', coalesce(upper_time_s, time_s), upper_ap_mm, upper_ml_mm from 'POINTS'
    ) where ap is not null and time_s >= 0
), steps as (
    select *, ap - lag(ap) over each as dap, ml - lag(ml) over each as dml from samples
    window each as (partition by trial, trunk order by time_s)
)
select trial, trunk, sum(sqrt(dap * dap + dml * dml)) as path, stddev_pop(ap) as rms
from steps group by all order by all
""".replace("POINTS", POINTS)


def table(name):
    with open(name, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def sql():
    """Path length and RMS of the positions as they are, by SQL and by plumb."""
    folders = dict(duckdb.sql("select 'trials/' || folder, trial from 'cohort/trials/*.parquet'").fetchall())
    wanted = {
        (folders[row["trial"]], row["trunk"], row["figure"]): float(row["value"])
        for row in table("none.csv")
        if row["segment"] == "whole" and (row["figure"], row["direction"]) in [("path length", "APML"), ("RMS", "AP")]
    }
    worst, compared = 0.0, 0
    for trial, trunk, path, rms in duckdb.sql(SQL).fetchall():
        for figure, found in [("path length", path), ("RMS", rms)]:
            worst = max(worst, abs(found / wanted[trial, trunk, figure] - 1))
            compared += 1
    return {"worst": worst, "compared": compared}


def figures():
    """How many rows of the table of figures differ from those of `plumb figures`."""
    folders = dict(duckdb.sql("select 'trials/' || folder, trial from 'cohort/trials/*.parquet'").fetchall())
    names = ["trunk", "segment", "direction", "figure"]
    numbers = ["value", "standard_uncertainty", "start_s", "end_s", "measured_s", "rate_hz"]
    found = duckdb.sql(f"select trial, {', '.join(names + numbers + ['reason'])} from 'cohort/figures/*.parquet'").fetchall()
    found = {tuple(row[:5]): row[5:] for row in found}
    rows = table("paper.csv")
    differ = 0
    for row in rows:
        own = found.pop((folders[row["trial"]], *[row[name] for name in names]))
        wanted = tuple(float(row[name]) if row[name] else None for name in numbers)
        differ += own != (*wanted, row["reason"])
    return {"rows": len(rows), "differ": differ + len(found)}


print(json.dumps({"trials": trials(), "points": points(), "sql": sql(), "figures": figures()}))
