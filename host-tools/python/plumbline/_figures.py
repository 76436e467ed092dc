"""Figures of many trials, and the statistics of studies."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal

from . import _plumbline
from ._tables import Table

if TYPE_CHECKING:
    from ._plumbline import Bin, Span


def figures(
    paths: Iterable[str | os.PathLike[str]],
    *,
    filter: str | None = None,
    span: Span | None = None,
    bins: list[Bin] | None = None,
    covered_min: float | None = None,
    radius_mm: float | None = None,
    zero: Literal["mark", "start", "onset"] | None = None,
    errors: Literal["raise", "collect"] = "raise",
) -> Table:
    """All sway figures of many trials, a row each, as ``plumb figures`` gives them.

    The trials are read on all processor cores; other threads of Python go on meanwhile.

    Args:
        paths: the trials' folders.
        filter, span, bins, covered_min, radius_mm: as in :meth:`Trial.figures`.
        zero: as in :func:`open_trial`.
        errors: "raise" raises the first error; "collect" leaves out a trial that cannot be read, and
            keeps its error in ``errors`` of the table.

    Raises:
        BadInput: an argument is wrong, a trial is given twice, or one cannot be read.
    """
    if isinstance(paths, str):
        raise TypeError("figures: paths: a text; give a list of folders")
    if errors not in ("raise", "collect"):
        raise ValueError(f'figures: errors: {errors!r}; give "raise" or "collect"')
    columns, warnings, found = _plumbline.figures(
        list(paths),
        filter=filter,
        span=span,
        bins=bins,
        covered_min=covered_min,
        radius_mm=radius_mm,
        zero=zero,
    )
    if found and errors == "raise":
        raise found[0]
    return Table(columns, warnings, found)


def study(
    path: str | os.PathLike[str], *, cohort: str | os.PathLike[str] | None = None
) -> dict[str, Any]:
    """The statistics of a study.toml, as ``plumb study --json`` writes them.

    Args:
        path: the study.
        cohort: the cohort whose trials are compared, whatever trials the study names itself.

    Raises:
        BadInput: the study, or one of its trials, cannot be used.
    """
    return _plumbline.study(path, cohort=cohort)


def study_of_table(
    path: str | os.PathLike[str],
    *,
    response: str,
    within: list[str],
    subject: str,
    delimiter: Literal["comma", "semicolon", "tab"] = "comma",
    drop_incomplete: bool = False,
) -> dict[str, Any]:
    """The statistics of a table with one measurement per line, as ``plumb study --long`` makes them.

    Args:
        path: the table's file.
        response: the column with what was measured.
        within: the columns with the within-subject factors, one or two.
        subject: the column that identifies the subject.
        delimiter: what separates the columns.
        drop_incomplete: leave out subjects that lack a measurement.

    Raises:
        BadInput: the table cannot be used.
    """
    return _plumbline.study_of_table(
        path,
        response=response,
        within=within,
        subject=subject,
        delimiter=delimiter,
        drop_incomplete=drop_incomplete,
    )
