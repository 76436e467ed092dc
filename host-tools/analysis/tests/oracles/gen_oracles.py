"""Other people's statistics on made-up data, for the tests of `plumbline-analysis` to agree with.

Writes inputs/*.csv and oracles.json beside itself. The inputs are rounded before they are
analysed, so that the files are the data. What is asked, and of whom:

- repeated measures ANOVA: statsmodels (F, p) and pingouin (sums of squares, epsilons, corrected
  p, Mauchly, effect sizes); paired t tests, Cohen's d and Bonferroni: scipy and pingouin
- Shapiro-Wilk, regression, noncentral t (limits of agreement): scipy
- tails and quantiles: mpmath with 60 digits

    pip install numpy scipy pandas statsmodels pingouin mpmath
    python3 host-tools/analysis/tests/oracles/gen_oracles.py

Two runs with the versions that oracles.json names write the same bytes.
"""

import json
import platform
from itertools import product
from pathlib import Path

import mpmath
import numpy as np
import pandas as pd
import pingouin
import scipy
import statsmodels
from scipy import stats
from statsmodels.stats.anova import AnovaRM

HERE = Path(__file__).resolve().parent
PACKAGES = (np, scipy, pd, statsmodels, pingouin, mpmath)
FACTORS = ["condition", "time"]

rng = np.random.Generator(np.random.PCG64(20240601))


def keep(name, frame, digits=6):
    """Writes a table, and gives it back as a reader will find it."""
    path = HERE / "inputs" / f"{name}.csv"
    frame.to_csv(path, index=False, float_format=f"%.{digits}g", lineterminator="\n")
    return pd.read_csv(path)


def study(subjects, conditions, times, spread):
    """A within-subject study, its cells' noise the farther from spherical the larger `spread`."""
    cells = list(product(conditions, times))
    mixing = np.eye(len(cells)) + spread * rng.standard_normal((len(cells), len(cells)))
    noise = rng.standard_normal((subjects, len(cells))) @ mixing * 8
    noise = noise + rng.normal(0, 15, (subjects, 1))

    def mean(cell):
        condition, time = cells[cell]
        slopes = 6 * conditions.index(condition) - 9 * times.index(time)
        return 100 + slopes + 4 * (cell == 1)

    rows = [
        (f"P{subject + 1:02}", *cells[cell], mean(cell) + noise[subject, cell])
        for subject, cell in product(range(subjects), range(len(cells)))
    ]
    return pd.DataFrame(rows, columns=["subject", *FACTORS, "value"])


def two_way(data):
    """The effects of both factors and of their interaction."""
    by_statsmodels = AnovaRM(data, "value", "subject", within=FACTORS).fit().anova_table
    columns = {"dv": "value", "within": FACTORS, "subject": "subject"}
    by_pingouin = pingouin.rm_anova(data, detailed=True, effsize="ng2", **columns)
    partial = pingouin.rm_anova(data, effsize="np2", **columns)
    wide = data.pivot(index="subject", columns=FACTORS, values="value")
    tables = {
        factor: wide.T.groupby(level=level, sort=False).mean().T
        for level, factor in enumerate(FACTORS)
    }
    tables["condition:time"] = wide
    effects = {}
    for row, (effect, table) in enumerate(tables.items()):
        ours = by_pingouin.iloc[row]
        effects[effect] = {
            "statsmodels_f": by_statsmodels.iloc[row]["F Value"],
            "statsmodels_p": by_statsmodels.iloc[row]["Pr > F"],
            "sum_of_squares": ours["SS"],
            "df": ours["ddof1"],
            "error_df": ours["ddof2"],
            "f": ours["F"],
            "p": ours["p_unc"],
            "generalized_eta_squared": ours["ng2"],
            "partial_eta_squared": partial.iloc[row]["np2"],
            "greenhouse_geisser": ours["eps"],
            "greenhouse_geisser_p": ours["p_GG_corr"],
            "huynh_feldt": pingouin.epsilon(table, correction="hf"),
            "mauchly_w": ours["W_spher"],
            "mauchly_p": ours["p_spher"],
        }
        if ours["ddof1"] > 1:
            _, _, chi_squared, df, _ = pingouin.sphericity(table)
            effects[effect] |= {"mauchly_chi_squared": chi_squared, "mauchly_df": df}
    values = wide.to_numpy()
    residuals = values - values.mean(0) - values.mean(1, keepdims=True) + values.mean()
    w, p = stats.shapiro(residuals.ravel())
    return {"effects": effects, "residuals": {"w": w, "p": p}}


def one_way(data):
    """The effect of time within the first condition."""
    first = data[data.condition == data.condition[0]]
    table = pingouin.rm_anova(
        first, dv="value", within="time", subject="subject", detailed=True, correction=True
    )
    effect, error = table.iloc[0], table.iloc[1]
    wide = first.pivot(index="subject", columns="time", values="value")
    return {
        "condition": data.condition[0],
        "sum_of_squares": effect["SS"],
        "df": effect["DF"],
        "error_sum_of_squares": error["SS"],
        "error_df": error["DF"],
        "f": effect["F"],
        "p": effect["p_unc"],
        "generalized_eta_squared": effect["ng2"],
        "greenhouse_geisser": effect["eps"],
        "greenhouse_geisser_p": effect["p_GG_corr"],
        "huynh_feldt": pingouin.epsilon(wide, correction="hf"),
        "mauchly_w": effect["W_spher"],
        "mauchly_p": effect["p_spher"],
    }


def paired(data):
    """The second condition against the first, at each time."""
    wide = data.pivot(index="subject", columns=FACTORS, values="value")
    first, second = list(dict.fromkeys(data.condition))[:2]
    tests = []
    for time in dict.fromkeys(data.time):
        to, by = wide[(second, time)].to_numpy(), wide[(first, time)].to_numpy()
        test = stats.ttest_rel(to, by)
        interval = test.confidence_interval()
        tests.append(
            {
                "time": time,
                "t": test.statistic,
                "df": test.df,
                "p": test.pvalue,
                "difference_ci95": [interval.low, interval.high],
                "d_av": pingouin.compute_effsize(to, by, paired=True, eftype="cohen"),
            }
        )
    _, corrected = pingouin.multicomp([test["p"] for test in tests], method="bonf")
    for test, p in zip(tests, corrected):
        test["p_bonferroni"] = p
    return {"from": first, "to": second, "tests": tests}


def normality():
    """Samples from normal to far from it, with ties and with an offset."""
    sizes = (3, 4, 5, 6, 7, 11, 12, 14, 20, 50, 500)
    samples = {f"normal {n}": rng.normal(10, 2, n) for n in sizes}
    samples |= {
        "skewed 14": rng.exponential(3, 14),
        "skewed 200": rng.exponential(3, 200),
        "ties 20": np.round(rng.normal(5, 1, 20)),
        "ties 100": np.round(rng.normal(5, 1, 100)),
        "two values 10": np.array([1.0] * 4 + [2.0] * 6),
        "offset 30": 1e6 + rng.normal(0, 1, 30),
    }
    rows = [(name, value) for name, sample in samples.items() for value in sample]
    table = keep("normality", pd.DataFrame(rows, columns=["sample", "value"]), digits=9)
    groups = [(name, group.value) for name, group in table.groupby("sample", sort=False)]
    # The most values that the algorithm takes; the test makes them itself.
    groups.append(("1 to 5000", np.arange(1.0, 5001.0)))
    return {name: dict(zip("wp", stats.shapiro(values))) for name, values in groups}


def agreement():
    """A measurement with bias, proportional error and noise, against its reference."""
    truth = np.cumsum(rng.normal(0, 0.4, 300))
    measured = 1.01 * truth + 0.05 + rng.normal(0, 0.25, 300)
    table = keep("agreement", pd.DataFrame({"reference": truth, "measured": measured}), digits=9)
    difference = table.measured - table.reference
    middle = (table.measured + table.reference) / 2

    def line(x, y):
        fit = stats.linregress(x, y)
        return {
            "slope": fit.slope,
            "slope_se": fit.stderr,
            "intercept": fit.intercept,
            "intercept_se": fit.intercept_stderr,
            "r": fit.rvalue,
            "p": fit.pvalue,
        }

    return {
        "regression": line(table.reference, table.measured),
        "proportional": line(middle, difference),
        "bias": difference.mean(),
        "sd": difference.std(ddof=1),
        "bias_ci95": stats.t.interval(
            0.95, len(table) - 1, loc=difference.mean(), scale=stats.sem(difference)
        ),
    }


def limit_quantiles():
    """n, and the noncentral t quantiles / sqrt(n) between which a limit of agreement lies."""
    return [
        [n, *(stats.nct.ppf(q, n - 1, 1.96 * np.sqrt(n)) / np.sqrt(n) for q in (0.025, 0.975))]
        for n in (3, 5, 17, 50, 300, 1000)
    ]


def f_tail(x, df1, df2):
    df1, df2 = mpmath.mpf(df1), mpmath.mpf(df2)
    return mpmath.betainc(df2 / 2, df1 / 2, 0, df2 / (df2 + df1 * x), regularized=True)


def t_tail(t, df):
    """Of one side, for a positive t."""
    return f_tail(t * t, 1, df) / 2


def chi_squared_tail(x, df):
    return mpmath.gammainc(mpmath.mpf(df) / 2, x / 2, mpmath.inf, regularized=True)


def normal_tail(z):
    return mpmath.erfc(z / mpmath.sqrt(2)) / 2


def tails():
    """Upper tails [argument, degrees of freedom ..., tail], down to 1e-300."""

    def table(tail, *axes):
        rows = [[*row, float(tail(mpmath.mpf(row[0]), *row[1:]))] for row in product(*axes)]
        return [row for row in rows if row[-1] > 1e-300]

    arguments, shapes = (0.01, 0.5, 1, 3.7, 15, 120, 3000), (1, 2.2, 3, 6, 40)
    return {
        "f": table(f_tail, arguments, shapes, (3.7, 13, 39, 200, 6000)),
        "t": table(t_tail, (0.01, 1, 2.1, 5, 12, 60), (1, 2, 5.3, 13, 27, 500)),
        "chi_squared": table(
            chi_squared_tail, (0.01, 0.5, 2, 8, 35, 94, 300), (1, 2.184, 2.7, 3, 7, 50)
        ),
        "normal": table(normal_tail, (-3, -0.5, 0, 0.1, 1, 2, 4, 6, 10, 20, 37)),
    }


def quantiles():
    """[probability, degrees of freedom ..., quantile], from scipy's by the secant method."""

    def table(tail, start, *axes):
        def refined(p, *shape):
            above = 1 - mpmath.mpf(p)
            return mpmath.findroot(lambda x: tail(x, *shape) - above, start(p, *shape))

        return [[*row, float(refined(*row))] for row in product(*axes)]

    return {
        "t": table(t_tail, stats.t.ppf, (0.6, 0.95, 0.975, 0.995), (1, 1.3, 2, 13, 299, 50000)),
        "normal": table(
            normal_tail, stats.norm.ppf, (1e-12, 1.25e-4, 0.05, 0.3, 0.4999, 0.7, 0.975, 0.9995)
        ),
    }


def plain(value):
    """As JSON has it; what is not a number becomes null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (np.integer, np.floating)):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def main():
    mpmath.mp.dps = 60
    (HERE / "inputs").mkdir(exist_ok=True)
    versions = {package.__name__: package.__version__ for package in PACKAGES}
    out = {"versions": {"python": platform.python_version()} | versions}
    studies = {
        # The paper's design on its physiology, and a larger one far from sphericity.
        "paper": study(14, ["control", "hypoperfusion"], ["t0", "t1", "t2", "t3"], 0.3),
        "large": study(12, ["a", "b", "c"], ["u", "v", "w", "x", "y"], 0.6),
    }
    tables = {name: keep(f"study_{name}", table) for name, table in studies.items()}
    out["two_way"] = {name: two_way(table) for name, table in tables.items()}
    out["one_way"] = {name: one_way(table) for name, table in tables.items()}
    out["paired"] = {name: paired(table) for name, table in tables.items()}
    out["shapiro_wilk"] = normality()
    out["agreement"] = agreement()
    out["limit_quantiles"] = limit_quantiles()
    out["tails"] = tails()
    out["quantiles"] = quantiles()
    (HERE / "oracles.json").write_text(json.dumps(plain(out), indent=1) + "\n")


if __name__ == "__main__":
    main()
