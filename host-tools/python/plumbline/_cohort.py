"""A cohort: a data set of many trials."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING

from . import _plumbline
from ._tables import Table

if TYPE_CHECKING:
    from ._plumbline import Bin, Span


def open_cohort(path: str | os.PathLike[str]) -> Cohort:
    """Opens a cohort: the folder that ``plumb cohort add --to`` has made.

    Raises:
        BadInput: there is no cohort, or another program is changing it right now.
    """
    return Cohort(_plumbline.open_cohort(path))


class Cohort:
    """A cohort, as it was when it was opened. For one that a single computer is too slow for, see
    :mod:`plumbline.spark`."""

    def __init__(self, inner: _plumbline.Cohort) -> None:
        self._inner = inner
        #: The cohort's folder.
        self.path = inner.path

    def __len__(self) -> int:
        return len(self._inner)

    def __repr__(self) -> str:
        return repr(self._inner)

    def trials(self) -> Table:
        """The table of trials, a row each, ordered by participant, session, condition and run.

        The columns are those of its Parquet; whole numbers that may be missing are of float.
        """
        return Table(self._inner._trials())

    def figures(
        self,
        trials: Iterable[str] | None = None,
        *,
        filter: str | None = None,
        span: Span | None = None,
        bins: list[Bin] | None = None,
        covered_min: float | None = None,
        radius_mm: float | None = None,
    ) -> Table:
        """All sway figures of the trials, computed from their points on all processor cores.

        The values are those of ``plumb figures``, to the last bit; the columns ``session`` and ``run``
        are added, ``trial`` is that of the table of trials, and ``standard_uncertainty`` is missing,
        since the points have no covariances. Those of the paper's settings are in the cohort's own
        table of figures.

        Args:
            trials: which: values of the column ``trial``; all unless it is given.
            filter, span, bins, covered_min, radius_mm: as in :meth:`Trial.figures`.

        Raises:
            BadInput: an argument is wrong, or the points of a trial cannot be read.
        """
        return Table(
            self._inner._figures(
                trials=None if trials is None else list(trials),
                filter=filter,
                span=span,
                bins=bins,
                covered_min=covered_min,
                radius_mm=radius_mm,
            )
        )
