"""Sway of a whole cohort on a cluster: run it, or open it as a notebook (`# %%` begins a cell).

    spark-submit --master spark://HOST:7077 cluster.py cohort study.toml cluster.png
"""

# %% The cohort
import sys

import matplotlib.pyplot as plt
import numpy as np
from pyspark.sql import SparkSession
from pyspark.sql import functions as F

import plumbline.spark

folder, study_file, picture = sys.argv[1:] if len(sys.argv) == 4 else ("cohort", "study.toml", "cluster.png")
session = SparkSession.builder.appName("sway of a cohort").getOrCreate()
cohort = plumbline.spark.Cohort(session, folder)
cohort.trials.groupBy("condition", "verdict").agg(F.count("*"), F.sum("duration_s")).show()

# %% Every figure of every trial, and what Spark makes of them
figures = cohort.figures(cohort.trials.where("verdict != 'unusable'"))
# Kept, since they are asked for twice.
velocities = figures.where("figure = 'mean velocity' and direction = 'APML' and segment = 'whole'").persist()
quartiles = [F.percentile(F.col("value"), share).alias(f"at {share}") for share in (0.25, 0.5, 0.75)]
velocities.groupBy("trunk", "condition").agg(*quartiles).orderBy("trunk", "condition").show()

# %% The paper's statistics
study = cohort.study(study_file)
most = study.comparisons.where("factor = 'condition' and p_bonferroni < 0.05").orderBy(F.desc(F.abs("d")))
most.select("point", "figure", "direction", "under", "t", "p_bonferroni", "d").show(10, truncate=False)

# %% The distribution of a figure, and its mean at each time
window, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
of_upper = velocities.where("trunk = 'upper'").select("condition", "value").toArrow().to_pylist()
cells = study.cells.where("point = 'upper' and figure = 'path length' and direction = 'APML'")
cells = cells.orderBy("condition", "time").toArrow().to_pylist()
conditions = sorted({row["condition"] for row in of_upper})
steps = np.linspace(0, max(row["value"] for row in of_upper), 11)
for condition in conditions:
    values = [row["value"] for row in of_upper if row["condition"] == condition]
    left.hist(values, bins=steps, alpha=0.6, label=condition)
    own = [row for row in cells if row["condition"] == condition]
    right.errorbar(
        [row["time"] for row in own],
        [row["mean"] for row in own],
        yerr=[row["normalised_sem"] for row in own],
        marker="o",
        capsize=3,
        label=f"{condition} (n = {own[0]['n']})",
    )
left.set(title="upper trunk", xlabel="mean velocity, AP and ML (mm/s)", ylabel="trials")
right.set(title="upper trunk", ylabel="path length, AP and ML (mm)")
right.margins(x=0.2)
right.set_ylim(bottom=0)
left.legend()
right.legend()
window.savefig(picture, dpi=120)
study.unpersist()
session.stop()
