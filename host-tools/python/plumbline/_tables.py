"""Tables of named columns, for pandas, Polars and Arrow where these are installed."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ._errors import BadInput

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow


def _installed(module: str, extra: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f"{module} is not installed here: pip install 'plumbline[{extra}]'", name=module
        ) from error


class Table:
    """Columns by their names, all of one length: arrays of numbers, and lists of texts.

    A number that is missing is NaN here and in pandas, and null in Polars and Arrow.
    """

    def __init__(
        self,
        columns: dict[str, Any],
        warnings: Sequence[str] = (),
        errors: Sequence[BadInput] = (),
    ) -> None:
        self.columns = columns
        #: What a user should know.
        self.warnings = list(warnings)
        #: Trials that could not be read, where these were to be collected.
        self.errors = list(errors)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> Any:
        return self.columns[name]

    def __repr__(self) -> str:
        return f"<Table of {len(self)} rows: {', '.join(self.columns)}>"

    def rows(self) -> Iterator[dict[str, Any]]:
        """Each row as a dictionary; a missing number is None."""
        for values in zip(*(_listed(column) for column in self.columns.values())):
            yield dict(zip(self.columns, values))

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a data frame of pandas."""
        made: pandas.DataFrame = _installed("pandas", "pandas").DataFrame(self.columns)
        return made

    def to_polars(self) -> polars.DataFrame:
        """The table as a data frame of Polars."""
        return _installed("polars", "polars").DataFrame(self.columns, nan_to_null=True)

    def to_arrow(self) -> pyarrow.Table:
        """The table as one of Arrow."""
        arrow = _installed("pyarrow", "arrow")
        # Of these, NaN becomes null.
        columns = {name: arrow.array(it, from_pandas=True) for name, it in self.columns.items()}
        return arrow.table(columns)


def _listed(column: Any) -> list[Any]:
    if not isinstance(column, np.ndarray):
        return list(column)
    values: list[Any] = column.tolist()
    if column.dtype.kind != "f":
        return values
    return [None if value != value else value for value in values]
