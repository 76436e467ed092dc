"""The tables of other packages: those that are installed have the same numbers, the others say how to
get them."""

import importlib.util
import sys

import numpy as np

import plumbline

trial = plumbline.open_trial("trials/p01-control")
figures = trial.figures()
table = trial.table()
missing = int(np.isnan(trial.lower.position_mm[:, 0]).sum())
assert missing == 25
installed = {name: importlib.util.find_spec(name) for name in ("pandas", "polars", "pyarrow")}
assert installed["pyarrow"]

for source in (trial, figures):
    own = table if source is trial else source
    for name, make in (("pandas", "to_pandas"), ("polars", "to_polars"), ("pyarrow", "to_arrow")):
        if not installed[name]:
            print(f"{name} is not installed")
            continue
        made = getattr(source, make)()
        names = list(made.columns) if name != "pyarrow" else made.column_names
        assert names == list(own.columns) and made.shape[0] == len(own)
        for column in names:
            if isinstance(own[column], list):
                values = made[column].to_list() if name != "pyarrow" else made[column].to_pylist()
                assert values == own[column], (name, column)
            else:
                values = np.asarray(made[column].to_numpy(), dtype=own[column].dtype)
                assert np.array_equal(values, own[column], equal_nan=values.dtype.kind == "f")
if installed["polars"]:
    assert trial.to_polars()["lower_ap_mm"].null_count() == missing
assert trial.to_arrow()["lower_ap_mm"].null_count == missing

# As if they were not there: the import system's own way to say so.
for name, make in (("pandas", "to_pandas"), ("polars", "to_polars"), ("pyarrow", "to_arrow")):
    there = sys.modules.get(name)
    sys.modules[name] = None
    try:
        getattr(trial, make)()
    except ImportError as error:
        assert error.name == name and "pip install 'plumbline[" in str(error), error
    else:
        raise AssertionError(f"{make} needs no {name}")
    finally:
        sys.modules[name] = there
        if there is None:
            del sys.modules[name]
