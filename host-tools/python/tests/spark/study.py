"""Figures and statistics of a cohort on a cluster, against those of one computer and of `plumb`."""

import csv
import json
import os
import pathlib
import struct
import subprocess
import sys
import threading
import time

import pyarrow.dataset
from cluster import HOME, HOST, PATIENCE_S, Cluster, executors, until

import plumbline
import plumbline.spark

COHORT = "cohort"
#: More than there are processor cores, so that there is a middle.
PARTS = 16
CHOSEN = {"filter": "butterworth:10", "span": (0, 25), "bins": [(0, 8), (8, 20)], "radius_mm": 2.5}
KEY = ("participant", "session", "condition", "run", "trial", "trunk", "segment", "direction", "figure")


def say(line):
    print(line, flush=True)


def bits(value):
    return struct.pack("<d", value) if isinstance(value, float) else value


def by_key(rows, leave_out=()):
    """Each row's bits, by its key."""
    found = {}
    for row in rows:
        key = tuple(row[name] for name in KEY)
        assert key not in found, key
        found[key] = {name: bits(it) for name, it in row.items() if name not in leave_out}
    return found


def rows_of(frame):
    return frame.toArrow().to_pylist()


def check_figures(session, cohort, here):
    spark = plumbline.spark.Cohort(session, COHORT)
    ours = rows_of(spark.figures())
    theirs = list(here.figures().rows())
    assert len(ours) == len(theirs) > 1000
    assert by_key(ours) == by_key(theirs)
    # The cohort's own table of figures knows the noise as well.
    kept = pyarrow.dataset.dataset(f"{COHORT}/figures").to_table().to_pylist()
    noise = ("standard_uncertainty",)
    assert by_key(ours, noise) == by_key(kept, noise)
    # `plumb figures` of the trials' folders, in its order.
    with open("figures.csv", newline="") as file:
        values = [float(row["value"]) if row["value"] else None for row in csv.DictReader(file)]
    assert [row["value"] for row in theirs] == values
    assert sum(value is not None for value in values) > len(values) / 2
    # Some trials, in another way.
    some = spark.trials.where("condition = 'foam' and participant < 'p03'")
    chosen = [row["trial"] for row in rows_of(some)]
    ours = by_key(rows_of(spark.figures(some, **CHOSEN)))
    assert len(chosen) == 2 and ours == by_key(here.figures(chosen, **CHOSEN).rows())
    say(f"{len(theirs)} figures of {len(here)} trials: the same bits")


def near(one, other, path=""):
    """The same structure, and numbers equal to 1e-12."""
    if isinstance(other, dict):
        assert one.keys() == other.keys(), (path, one.keys() ^ other.keys())
        return max((near(one[name], other[name], f"{path}.{name}") for name in other), default=0)
    if isinstance(other, list):
        assert len(one) == len(other), path
        pairs = enumerate(zip(one, other))
        return max((near(a, b, f"{path}[{at}]") for at, (a, b) in pairs), default=0)
    if isinstance(other, float):
        assert isinstance(one, float), (path, one, other)
        off = abs(one - other) / max(1, abs(other))
        assert off <= 1e-12, (path, one, other)
        return off
    assert one == other, (path, one, other)
    return 0


NAMES = ("point", "figure", "direction", "unit")


def some(stated, *names):
    """Of some statistics these; none where they are not defined."""
    return {name: (stated or {}).get(name) for name in names}


def check_study(session, study_file, expected_file):
    with open(expected_file) as file:
        expected = json.load(file)
    study = plumbline.spark.Cohort(session, COHORT).study(study_file)
    responses = rows_of(study.responses)
    compared = [json.loads(it["statistics"]) for it in responses if it["statistics"]]
    sway = [{**it, "adjusted": []} for it in expected["sway"]]
    off = near(compared, sway)
    assert len(compared) > 50 and study.title == expected["title"]
    absent = [{"name": it["name"], "reason": it["reason"]} for it in responses if it["reason"]]
    assert absent == expected["not_compared"]
    of = {tuple(it[name] for name in NAMES): it for it in expected["sway"]}

    numbers = 0
    for row in rows_of(study.cells):
        inference = of[tuple(row[name] for name in NAMES)]["inference"]
        levels = [it for it in (row["condition"], row["time"]) if it]
        (cell,) = [it for it in inference["cells"] if it["levels"] == levels]
        names = ("n", "mean", "sd", "sem")
        near({name: row[name] for name in names}, some(cell["raw"], *names))
        near(row["normalised_sem"], some(cell["normalised"], "sem")["sem"])
        numbers += 1
    assert numbers == sum(len(it["inference"]["cells"]) for it in expected["sway"])

    effects, tests = rows_of(study.effects), 0
    for row in effects:
        response = of[tuple(row[name] for name in NAMES)]
        (tested,) = [it for it in response["inference"]["anova"]["effects"] if it["effect"] == row["effect"]]
        near({name: row[name] for name in ("f", "p")}, some(tested["test"], "f", "p"))
        adjusted = [it for it in response["adjusted"] if it["effect"] == row["effect"]]
        ours = ("anova_type_p", "anova_type_p_holm", "anova_type_p_benjamini_hochberg")
        theirs = some(adjusted[0] if adjusted else None, "p", "p_holm", "p_benjamini_hochberg")
        off = max(off, near([row[it] for it in ours], list(theirs.values())))
        tests += len(adjusted)
    assert tests == sum(len(it["adjusted"]) for it in expected["sway"]) > 50

    comparisons = rows_of(study.comparisons)
    for row in comparisons:
        inference = of[tuple(row[name] for name in NAMES)]["inference"]
        levels = [row["from_level"], row["to_level"]]
        (found,) = [
            it
            for it in inference["comparisons"]
            if it["levels"] == levels and it.get("under") == row["under"]
        ]
        near({it: row[it] for it in ("t", "p_bonferroni")}, some(found["t_test"], "t", "p_bonferroni"))
        for name in ("d", "d_z"):
            near(row[name], found[name] if isinstance(found[name], float) else None)
    assert len(comparisons) == sum(len(it["inference"]["comparisons"]) for it in expected["sway"])
    left_out = sum(len(it["left_out"]) for it in expected["sway"])
    assert len(rows_of(study.left_out)) == left_out
    # Those of the choice come first, then those of the trials.
    warnings = {*study.warnings, *(it["warning"] for it in rows_of(study.trial_warnings))}
    assert warnings <= set(expected["warnings"]), warnings - set(expected["warnings"])
    study.unpersist()
    say(f"{study.title}: {len(compared)} responses: off by {off:g} at most; {left_out} left out")


def refused(work, *parts):
    try:
        work()
    except Exception as error:
        assert all(part in str(error) for part in parts), error
    else:
        raise AssertionError(f"{parts}: nothing was refused")


def check_bad_input(session):
    spark = plumbline.spark.Cohort(session, COHORT)
    refused(lambda: plumbline.spark.Cohort(session, COHORT, parts=0), "parts")
    refused(lambda: spark.figures(filter="gauss"), "filter", "gauss")
    refused(lambda: spark.study("study.toml", spark.trials.where("run = 7")), "none of the 0 trials")
    half = spark.trials.where("condition = 'foam' or participant = 'p01'")
    refused(lambda: spark.study("strict.toml", half), "has no trial in control")


def timed(session):
    """The seconds that all figures take."""
    cohort = plumbline.spark.Cohort(session, COHORT, parts=PARTS)
    begin = time.monotonic()
    found = by_key(rows_of(cohort.figures()))
    return time.monotonic() - begin, found


def under_way(session):
    """The parts that are done of the stage that computes the figures."""
    tracker = session.sparkContext.statusTracker()
    infos = [tracker.getStageInfo(it) for it in tracker.getActiveStageIds()]
    done = [it.numCompletedTasks for it in infos if it and it.numTasks == PARTS]
    return max(done, default=0)


def killed_in_the_middle(cluster, session, expected):
    """The figures while a worker is killed."""
    found = []
    thread = threading.Thread(target=lambda: found.append(timed(session)))
    thread.start()
    until("a part that is done", lambda: 2 <= under_way(session))
    done = under_way(session)
    assert 2 <= done <= PARTS - 4, done
    cluster.kill_worker()
    thread.join()
    ((seconds, figures),) = found
    assert figures == expected
    until("one executor left", lambda: executors(session) == 1)
    say(f"a worker killed when {done} of {PARTS} parts were done: the same figures, {seconds:.1f} s")


def run_example(cluster):
    """The example draws its picture, by the worker that is left."""
    example = pathlib.Path(__file__).parents[2] / "examples/cluster.py"
    settings = [f"--conf={name}={value}" for name, value in cluster.settings().items()]
    submit = [HOME / "bin/spark-submit", "--master", cluster.url, *settings, example]
    environment = {**os.environ, "PYSPARK_PYTHON": sys.executable, "SPARK_LOCAL_IP": HOST}
    log = cluster.folder / "example.log"
    with log.open("wb") as errors:
        ran = subprocess.run(
            [*submit, COHORT, "dropping.toml", "cluster.png"],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            # Far more than it takes, since a loaded computer is slow.
            timeout=5 * PATIENCE_S,
        )
    assert ran.returncode == 0, log.read_text()[-5000:]
    for part in ("good", "at 0.25", "p_bonferroni"):
        assert part in ran.stdout, ran.stdout


here = plumbline.open_cohort(COHORT)
expected = by_key(here.figures().rows())
with Cluster("spark") as cluster:
    cluster.add_worker()
    session = cluster.session()
    until("the first executor", lambda: executors(session) == 1)
    timed(session)
    seconds, found = timed(session)
    assert found == expected
    say(f"{len(here)} trials in {PARTS} parts, one worker: {seconds:.1f} s")
    cluster.add_worker()
    until("the second executor", lambda: executors(session) == 2)
    timed(session)
    seconds_of_two, found = timed(session)
    assert found == expected
    say(f"the same, two workers: {seconds_of_two:.1f} s, {seconds / seconds_of_two:.2f} times as fast")
    check_figures(session, COHORT, here)
    check_study(session, "study.toml", "study.json")
    check_study(session, "dropping.toml", "dropping.json")
    check_bad_input(session)
    killed_in_the_middle(cluster, session, expected)
    session.stop()
    run_example(cluster)
