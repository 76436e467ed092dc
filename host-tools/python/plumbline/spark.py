"""Figures and statistics of a cohort on a cluster of Apache Spark, where one computer is not enough.

A cohort is read by Spark itself, from wherever Spark reads. Each trial is computed as a whole in one
place, by the same functions as elsewhere in this package; a response is compared by the same functions
as well. So the figures are equal to those of one computer to the last bit, however many there are.

The package and pyarrow must be installed on every worker. The extra ``spark`` brings Spark along:
``pip install 'plumbline[spark]'``; it needs Java 17.

>>> import plumbline.spark
>>> cohort = plumbline.spark.Cohort(session, "hdfs://.../cohort")
>>> cohort.figures(trials=cohort.trials.where("age_years >= 60"), filter="butterworth:10")
>>> cohort.study("study.toml").comparisons.where("p_bonferroni < 0.05").show()
"""

from __future__ import annotations

import json
import os
import pathlib
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from pyspark.sql import DataFrame, SparkSession
from pyspark.sql import functions as F

from . import _plumbline
from ._errors import BadInput

if TYPE_CHECKING:
    from pyspark.core.broadcast import Broadcast

    from ._plumbline import Bin, Span, TakesPart

__all__ = ["Cohort", "Study"]

#: A part holds no more trials than this: what is lost with a worker is soon computed again.
TRIALS_PER_PART = 64

_SQL = {
    "text": "string",
    "number": "double",
    "integer": "bigint",
    "flag": "boolean",
    "instant": "timestamp",
}
_ARROW = {
    "string": pa.string(),
    "double": pa.float64(),
    "bigint": pa.int64(),
}

_VALUES = {
    "trial": "string",
    "point": "string",
    "chosen": "bigint",
    "time": "bigint",
    "value": "double",
    "absent": "string",
}
_WARNINGS = {"trial": "string", "warning": "string"}

#: What identifies a response.
_RESPONSE = {"point": "string", "figure": "string", "direction": "string", "unit": "string"}
_RESPONSES = {
    "first": "bigint",
    "chosen": "bigint",
    **_RESPONSE,
    "name": "string",
    "n": "bigint",
    "reason": "string",
    "statistics": "string",
}
_CELLS = {
    "condition": "string",
    "time": "string",
    "n": "bigint",
    "mean": "double",
    "sd": "double",
    "sem": "double",
    "normalised_sd": "double",
    "normalised_sem": "double",
}
_EFFECTS = {
    "effect": "string",
    "f": "double",
    "df": "bigint",
    "error_df": "bigint",
    "p": "double",
    "generalized_eta_squared": "double",
    "partial_eta_squared": "double",
    "mauchly_w": "double",
    "mauchly_p": "double",
    "greenhouse_geisser_epsilon": "double",
    "greenhouse_geisser_p": "double",
    "anova_type_statistic": "double",
    "anova_type_df": "double",
    "anova_type_p": "double",
}
_ADJUSTED = {"anova_type_p_holm": "double", "anova_type_p_benjamini_hochberg": "double"}
_COMPARISONS = {
    "factor": "string",
    "from_level": "string",
    "to_level": "string",
    "under": "string",
    "n": "bigint",
    "mean_difference": "double",
    "t": "double",
    "df": "bigint",
    "p": "double",
    "p_bonferroni": "double",
    "rank_statistic": "double",
    "rank_df": "double",
    "rank_p": "double",
    "rank_p_bonferroni": "double",
    "d": "double",
    "d_z": "double",
}
_LEFT_OUT = {"participant": "string", "cell": "string", "reason": "string"}


def _ddl(columns: dict[str, str]) -> str:
    return ", ".join(f"`{name}` {kind}" for name, kind in columns.items())


def _columns_of(table: str) -> dict[str, str]:
    return {name: _SQL[kind] for name, kind in _plumbline.cohort_columns(table)}  # type: ignore[arg-type]


def _to_arrow(columns: dict[str, Any], kinds: dict[str, str]) -> pa.Table:
    """Columns as Spark takes them; NaN becomes null."""
    arrays = [pa.array(columns[name], _ARROW[kind], from_pandas=True) for name, kind in kinds.items()]
    return pa.table(arrays, names=list(kinds))


def _rows_to_arrow(rows: list[dict[str, Any]], kinds: dict[str, str]) -> pa.Table:
    return _to_arrow({name: [row.get(name) for row in rows] for name in kinds}, kinds)


def _given(table: pa.Table) -> dict[str, Any]:
    """The columns of a table as the extension takes them."""

    def given(column: pa.ChunkedArray) -> Any:
        if pa.types.is_floating(column.type):
            return column.to_numpy()
        if pa.types.is_timestamp(column.type):
            column = column.cast(pa.timestamp("us", column.type.tz)).cast(pa.int64())
        return column.to_pylist()

    return {name: given(table[name]) for name in table.column_names}


def _of_trial(
    work: Callable[[dict[str, Any], dict[str, Any]], pa.Table], empty: pa.Table
) -> Callable[[pa.Table, pa.Table], pa.Table]:
    """What is computed of one trial, from its points and its row."""

    def of_trial(points: pa.Table, row: pa.Table) -> pa.Table:
        if row.num_rows == 0:
            return empty
        # Spark promises no order.
        times = points["time_s"].to_numpy()
        if np.any(np.diff(times) < 0):
            points = points.take(pa.array(np.argsort(times, kind="stable")))
        return work(_given(row), _given(points))

    return of_trial


class Cohort:
    """A cohort that Spark reads.

    Args:
        session: the session of Spark.
        path: the cohort, wherever Spark reads: a folder that all workers see, hdfs://, s3a://.
        parts: into how many parts the trials are divided for the work on each; unless it is given,
            four for each processor core of the cluster, and no more than 64 trials in each.
    """

    def __init__(
        self, session: SparkSession, path: str | os.PathLike[str], *, parts: int | None = None
    ) -> None:
        self._session = session
        self._path = os.fspath(path).rstrip("/")
        self._parts = parts
        if parts is not None and parts < 1:
            raise BadInput("Cohort", "parts", str(parts), "give a whole number from 1 on")

    def _read(self, table: str, **options: str) -> DataFrame:
        reader = self._session.read.schema(_ddl(_columns_of(table))).options(**options)
        # Without these the folders' names would become columns, with 01 as a number.
        return reader.parquet(f"{self._path}/{table}")

    @property
    def trials(self) -> DataFrame:
        """The table of trials, a row each."""
        return self._read("trials")

    @property
    def points(self) -> DataFrame:
        """The points of all trials, a row for each frame: ``trial`` says of which."""
        return self._read("points", recursiveFileLookup="true")

    def _cores(self) -> int:
        """The processor cores of the cluster."""
        cores: int = self._session.sparkContext.defaultParallelism
        return cores

    def _each_trial(
        self,
        trials: DataFrame,
        work: Callable[[dict[str, Any], dict[str, Any]], pa.Table],
        kinds: dict[str, str],
    ) -> DataFrame:
        """What `work` makes of the row and the points of each of these trials."""
        parts = self._parts
        if parts is None:
            parts = max(4 * self._cores(), -(-trials.count() // TRIALS_PER_PART))
        # In so many parts also where Spark thinks fewer were enough for the few bytes: it is the
        # work on them that takes long.
        rows = trials.select(*_columns_of("trials")).repartition(parts, "trial")
        chosen = F.broadcast(trials.select("trial"))
        points = self.points.join(chosen, "trial", "left_semi").repartition(parts, "trial")
        pairs = points.groupBy("trial").cogroup(rows.groupBy("trial"))
        of_trial = _of_trial(work, _rows_to_arrow([], kinds))
        return pairs.applyInArrow(of_trial, _ddl(kinds))

    def figures(
        self,
        trials: DataFrame | None = None,
        *,
        filter: str | None = None,
        span: Span | None = None,
        bins: list[Bin] | None = None,
        covered_min: float | None = None,
        radius_mm: float | None = None,
    ) -> DataFrame:
        """All sway figures of the trials, a row each, as :meth:`plumbline.Cohort.figures` gives them,
        to the last bit, in no order.

        Args:
            trials: rows of the table of trials; all unless it is given.
            filter, span, bins, covered_min, radius_mm: as in :meth:`plumbline.Trial.figures`.

        Raises:
            BadInput: an argument is wrong. When a trial cannot be read, the task of Spark that is to
                compute it fails with it.
        """
        method: dict[str, Any] = {
            "filter": filter,
            "span": span,
            "bins": bins,
            "covered_min": covered_min,
            "radius_mm": radius_mm,
        }
        # Of no trial, for what an argument may lack: here, and not in a task.
        _plumbline.figures([], **method)
        kinds = _columns_of("figures")

        def work(row: dict[str, Any], points: dict[str, Any]) -> pa.Table:
            return _to_arrow(_plumbline.figures_of_points(row, points, **method), kinds)

        trials = self.trials if trials is None else trials
        return self._each_trial(trials, work, kinds)

    def study(
        self, path: str | os.PathLike[str], trials: DataFrame | None = None
    ) -> Study:
        """The statistics of a study.toml over this cohort, as ``plumb study --cohort`` makes them.

        Args:
            path: the study, a file of this computer. The trials or the cohort that it names are not
                read.
            trials: rows of the table of trials, from which the study chooses; all unless it is given.

        Raises:
            BadInput: the study cannot be used, chooses no trial, or some are unusable or missing.
        """
        text = pathlib.Path(path).read_text(encoding="utf-8")
        study = _plumbline.CohortStudy(text, path, self._path)
        trials = self.trials if trials is None else trials
        return Study(self, study, trials.select(*_columns_of("trials")))


class Study:
    """The statistics of a study as data frames. They are computed when they are first asked for; the
    values of the trials, and the statistics of the responses, are then kept in the cluster's memory
    until :meth:`unpersist`.

    A response is a figure of a point of the body in one direction: ``point``, ``figure``,
    ``direction``, ``unit``.
    """

    def __init__(self, cohort: Cohort, study: _plumbline.CohortStudy, trials: DataFrame) -> None:
        takes_part, warnings = study.admitted(_given(trials.toArrow()))
        #: The study's name.
        self.title: str = study.title
        #: What a user should know of the choice of trials.
        self.warnings: list[str] = warnings
        session = cohort._session
        chosen = F.broadcast(session.createDataFrame([it[:1] for it in takes_part], "trial string"))
        found = cohort._each_trial(
            trials.join(chosen, "trial", "left_semi"), _values(study), {**_VALUES, "warning": "string"}
        ).persist()
        #: What each trial contributes: ``trial``, ``point``, ``chosen`` (which of the study's figures),
        #: ``time`` (which of its times, from 0), ``value`` or, where there is none, ``absent``: why.
        self.values: DataFrame = found.where("warning is null").drop("warning")
        #: What a user should know of the trials: ``trial``, ``warning``.
        self.trial_warnings: DataFrame = found.where("warning is not null").select(*_WARNINGS)
        compare = _compare(study, session.sparkContext.broadcast(takes_part))
        # Not into the number of parts that is usual for tables a thousand times as large.
        values = self.values.repartition(4 * cohort._cores(), "point", "chosen")
        responses = values.groupBy("point", "chosen").applyInArrow(compare, _ddl(_RESPONSES))
        responses = responses.persist()
        self._kept = (found, responses)
        #: Each response in the order of ``plumb study``: ``n``, its number of participants, and
        #: ``statistics``, as ``plumb study --json`` writes them (but for ``adjusted``: see
        #: ``effects``); or ``reason``, why it was not compared.
        self.responses: DataFrame = responses.orderBy("first", "point", "chosen").drop("first", "chosen")

    def _table(
        self, function: Callable[[dict[str, Any]], list[dict[str, Any]]], columns: dict[str, str]
    ) -> DataFrame:
        kinds = {**_RESPONSE, **columns}
        _, responses = self._kept
        return responses.where("statistics is not null").mapInArrow(_rows(function, kinds), _ddl(kinds))

    @property
    def cells(self) -> DataFrame:
        """Each response under each condition at each time: ``n``, ``mean``, ``sd``, ``sem``, and these
        without the differences between participants (Cousineau-Morey): ``normalised_sd``,
        ``normalised_sem``."""
        return self._table(_cells, _CELLS)

    @property
    def effects(self) -> DataFrame:
        """Each effect on each response: the analysis of variance with repeated measures, with
        Mauchly's test and the correction of Greenhouse and Geisser; and the ANOVA-type statistic of
        Brunner, Domhof and Langer, whose p is also adjusted for the number of responses."""
        effects = self._table(_effects, _EFFECTS)
        # In one place: of each effect there is one number for each response.
        tested = effects.where("anova_type_p is not null").coalesce(1)
        by_effect = tested.groupBy("effect")
        keys = [*_RESPONSE, "effect"]
        kinds = {**_RESPONSE, "effect": "string", **_ADJUSTED}
        adjusted = by_effect.applyInArrow(_adjusted, _ddl(kinds))
        return effects.join(F.broadcast(adjusted), keys, "left")

    @property
    def comparisons(self) -> DataFrame:
        """Each pair of levels of each response: paired t test with Bonferroni, the same by ranks, and
        Cohen's d of the normalised values and of the differences."""
        return self._table(_comparisons, _COMPARISONS)

    @property
    def left_out(self) -> DataFrame:
        """Who is left out of which response: ``participant``, ``cell``, ``reason``."""
        return self._table(_left_out, _LEFT_OUT)

    def unpersist(self) -> None:
        """Frees the cluster's memory; what is asked for afterwards is computed anew."""
        for frame in self._kept:
            frame.unpersist()


# Spark takes plain functions only: it reads from their signatures what it is to give them.


def _values(study: _plumbline.CohortStudy) -> Callable[[dict[str, Any], dict[str, Any]], pa.Table]:
    """What a trial contributes, and its warnings as rows of their own."""

    def values(row: dict[str, Any], points: dict[str, Any]) -> pa.Table:
        columns, warnings = study.values(row, points)
        contributed = _to_arrow(columns, _VALUES)
        contributed = contributed.append_column("warning", pa.nulls(len(contributed), pa.string()))
        (trial,) = row["trial"]
        said = [{"trial": trial, "warning": warning} for warning in warnings]
        return pa.concat_tables([contributed, _rows_to_arrow(said, {**_VALUES, "warning": "string"})])

    return values


def _compare(
    study: _plumbline.CohortStudy, takes_part: Broadcast[list[TakesPart]]
) -> Callable[[tuple[pa.Scalar, ...], pa.Table], pa.Table]:
    """The statistics of one response."""

    def compare(key: tuple[pa.Scalar, ...], values: pa.Table) -> pa.Table:
        point, chosen = (it.as_py() for it in key)
        said = study.compare(point, chosen, takes_part.value, _given(values))
        statistics = said.pop("statistics", None)
        row = {**said, "point": point, "chosen": chosen}
        if statistics is not None:
            row.update(n=statistics["n"], statistics=json.dumps(statistics))
        return _rows_to_arrow([row], _RESPONSES)

    return compare


def _rows(
    function: Callable[[dict[str, Any]], list[dict[str, Any]]], kinds: dict[str, str]
) -> Callable[[Iterable[pa.RecordBatch]], Iterable[pa.RecordBatch]]:
    """Rows from the statistics of responses."""

    def rows(batches: Iterable[pa.RecordBatch]) -> Iterable[pa.RecordBatch]:
        for batch in batches:
            found = []
            for response in batch.to_pylist():
                named = {name: response[name] for name in _RESPONSE}
                statistics = json.loads(response["statistics"])
                found += [{**named, **row} for row in function(statistics)]
            yield from _rows_to_arrow(found, kinds).to_batches()

    return rows


def _known(stated: Any) -> dict[str, Any]:
    """A group of statistics, empty where it is not defined."""
    return {} if stated is None or "absent" in stated else stated


def _number(stated: Any) -> float | None:
    return stated if isinstance(stated, int | float) else None


def _cells(statistics: dict[str, Any]) -> list[dict[str, Any]]:
    def row(cell: dict[str, Any]) -> dict[str, Any]:
        raw, normalised = _known(cell["raw"]), _known(cell["normalised"])
        condition, *time = cell["levels"]
        return {
            "condition": condition,
            "time": time[0] if time else None,
            **{name: raw.get(name) for name in ("n", "mean", "sd", "sem")},
            "normalised_sd": normalised.get("sd"),
            "normalised_sem": normalised.get("sem"),
        }

    return [row(cell) for cell in statistics["inference"]["cells"]]


def _effects(statistics: dict[str, Any]) -> list[dict[str, Any]]:
    inference = statistics["inference"]
    rows: dict[str, dict[str, Any]] = {}
    for effect in _known(inference["anova"]).get("effects", []):
        test = effect["test"] or {}
        sphericity = test.get("sphericity") or {}
        mauchly = sphericity.get("mauchly") or {}
        corrected = sphericity.get("greenhouse_geisser") or {}
        rows[effect["effect"]] = {
            "effect": effect["effect"],
            "df": effect["df"],
            "error_df": effect["error_df"],
            **{
                name: test.get(name)
                for name in ("f", "p", "generalized_eta_squared", "partial_eta_squared")
            },
            "mauchly_w": mauchly.get("w"),
            "mauchly_p": mauchly.get("p"),
            "greenhouse_geisser_epsilon": corrected.get("epsilon"),
            "greenhouse_geisser_p": corrected.get("p"),
        }
    for effect in _known(inference["ranks"]).get("effects", []):
        test = effect["anova_type"] or {}
        rows.setdefault(effect["effect"], {"effect": effect["effect"]}).update(
            anova_type_statistic=test.get("statistic"),
            anova_type_df=test.get("df"),
            anova_type_p=test.get("p"),
        )
    return list(rows.values())


def _adjusted(effects: pa.Table) -> pa.Table:
    """The p of one effect in all responses, adjusted."""
    keys = {**_RESPONSE, "effect": "string"}
    columns = {name: effects[name].to_pylist() for name in keys}
    adjusted = _plumbline.adjusted(effects["anova_type_p"].to_pylist())
    columns.update(zip(_ADJUSTED, adjusted))
    return _to_arrow(columns, {**keys, **_ADJUSTED})


def _comparisons(statistics: dict[str, Any]) -> list[dict[str, Any]]:
    def row(comparison: dict[str, Any]) -> dict[str, Any]:
        test, ranks = _known(comparison["t_test"]), _known(comparison["ranks"])
        anova_type = ranks.get("anova_type", {})
        names = ("n", "mean_difference", "t", "df", "p", "p_bonferroni")
        return {
            "factor": comparison["factor"],
            "from_level": comparison["levels"][0],
            "to_level": comparison["levels"][1],
            "under": comparison.get("under"),
            **{name: test.get(name) for name in names},
            "rank_statistic": anova_type.get("statistic"),
            "rank_df": anova_type.get("df"),
            "rank_p": anova_type.get("p"),
            "rank_p_bonferroni": ranks.get("p_bonferroni"),
            "d": _number(comparison["d"]),
            "d_z": _number(comparison["d_z"]),
        }

    return [row(it) for it in statistics["inference"]["comparisons"]]


def _left_out(statistics: dict[str, Any]) -> list[dict[str, Any]]:
    return [{**it, "cell": ", ".join(it["cell"])} for it in statistics["left_out"]]
