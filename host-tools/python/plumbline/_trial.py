"""A trial, with its tables."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _plumbline
from ._tables import Table

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow

    from ._plumbline import Bin, Exported, Span, Trunk

AXES = ("ap", "ml", "si")
THETA = ("theta1_rad", "theta2_rad", "theta3_rad", "x_mm", "y_mm", "z_mm")


def open_trial(
    path: str | os.PathLike[str], *, zero: Literal["mark", "start", "onset"] | None = None
) -> Trial:
    """Reads a trial: the folder that ``plumb receive --out`` or the desk has made.

    Args:
        path: the folder.
        zero: what t = 0 is: the mark called "zero" or the first one ("mark"), the first frame
            ("start"), or the moment at which the person stands up ("onset"). Unless it is given,
            trial.toml says it.

    Raises:
        BadInput: there is no trial, or it cannot be read.
    """
    return Trial(_plumbline.open_trial(path, zero=zero))


class Trial:
    """A trial. Its arrays have a row for each frame that the camera took, in the order of time.

    A frame that never came has a row too, in which ``received`` is False; its time lies evenly
    between those of its neighbours. What was not measured is NaN; nothing is filled.
    """

    def __init__(self, inner: _plumbline.Trial) -> None:
        self._inner = inner
        #: The trial's folder.
        self.path = inner.path
        #: The participant and the condition or, without them, the folder's name.
        self.title: str = inner.title
        #: Who was measured, as a code.
        self.participant: str | None = inner.participant
        #: The condition under which.
        self.condition: str | None = inner.condition
        #: When each frame was taken, seconds from t = 0: (rows,).
        self.time_s = inner.time_s
        #: The box's run, from 1: (rows,).
        self.session = inner.session
        #: The number that the box gave the frame: (rows,).
        self.frame = inner.frame
        #: Whether the frame came: (rows,).
        self.received = inner.received
        #: The lower trunk (L3).
        self.lower: Trunk = inner.lower
        #: The upper trunk (acromion).
        self.upper: Trunk = inner.upper
        #: What t = 0 is, in words.
        self.zero: str = inner.zero
        #: The time of day of t = 0, seconds since 1970 by the clock of the computer that recorded.
        self.zero_utc_s: float | None = inner.zero_utc_s
        #: Frames per second on average, those that were lost included.
        self.rate_hz: float | None = inner.rate_hz
        #: Marks and triggers, by the names of their fields in trial.toml; ``time_s`` is from t = 0.
        self.events: list[dict[str, Any]] = inner.events
        #: trial.toml, by the names of its fields, made of the packets anew; times in it are since the
        #: first frame.
        self.manifest: dict[str, Any] = inner.manifest
        #: The verdict: ``is``, where a person overruled it ``overruled``, ``by`` and ``why``, and a list
        #: ``reason`` of ``key``, ``is``, ``found``, ``bound``, ``words``, ``remedy``.
        self.verdict: dict[str, Any] = inner.verdict
        #: The grade that counts: "good", "doubtful" or "unusable".
        self.grade: str = inner.grade
        #: What a user should know.
        self.warnings: list[str] = inner.warnings

    def __len__(self) -> int:
        return len(self._inner)

    def __repr__(self) -> str:
        return repr(self._inner)

    def figures(
        self,
        *,
        filter: str | None = None,
        span: Span | None = None,
        bins: list[Bin] | None = None,
        covered_min: float | None = None,
        radius_mm: float | None = None,
    ) -> Table:
        """All sway figures of the trial, a row each, as ``plumb figures`` gives them.

        Args:
            filter: "paper" or "paper:SECONDS", "butterworth:HZ" or "butterworth:HZ:ORDER", "none".
            span: the seconds from and to, or "all"; unless it is given, from t = 0 on where a mark or
                the onset sets that, otherwise all.
            bins: times with a path length each, seconds from and to; those of the paper are
                (0, 20), (20, 40), (40, 60).
            covered_min: the share of a bin, 0 to 1, that must have been measured; 0.9 unless given.
            radius_mm: the radius of the sway density; 3 unless given.

        Raises:
            BadInput: an argument is wrong, or the trial has no trunk points.
        """
        columns, warnings = self._inner._figures(
            filter=filter, span=span, bins=bins, covered_min=covered_min, radius_mm=radius_mm
        )
        return Table(columns, warnings)

    def analyze(
        self,
        *,
        filter: str | None = None,
        span: Span | None = None,
        bins: list[Bin] | None = None,
        covered_min: float | None = None,
        radius_mm: float | None = None,
    ) -> dict[str, Any]:
        """All figures, filtered and unfiltered, as ``plumb analyze --json`` writes them.

        The arguments are those of :meth:`figures`.

        Raises:
            BadInput: an argument is wrong, or does not suit the trial.
        """
        return self._inner.analyze(
            filter=filter, span=span, bins=bins, covered_min=covered_min, radius_mm=radius_mm
        )

    def export(
        self,
        format: Literal["csv", "parquet", "trc", "c3d", "bids"],
        path: str | os.PathLike[str],
        *,
        session: str | None = None,
        run: int | None = None,
        force: bool = False,
    ) -> Exported:
        """Writes the trial for other programs, byte by byte as ``plumb export`` does.

        Args:
            format: what to write.
            path: the file; for BIDS the folder of a data set, new or not.
            session: BIDS: the session's label.
            run: BIDS: the number of the run, from 1; the next one unless it is given.
            force: replace what is there.

        Raises:
            BadInput: the trial has nothing to write, or the file exists or cannot be written.
        """
        return self._inner.export(format, path, session=session, run=run, force=force)

    def table(self) -> Table:
        """The frames as a table, a row each.

        Columns: ``time_s``, ``session``, ``frame``, ``received``; then of ``lower`` and of ``upper``,
        with that word before them: ``time_s``, ``ap_mm``, ``ml_mm``, ``si_mm``, their standard
        deviations ``sd_ap_mm``, ``sd_ml_mm``, ``sd_si_mm``, the target's pose ``theta1_rad``,
        ``theta2_rad``, ``theta3_rad``, ``x_mm``, ``y_mm``, ``z_mm``, ``rms_px`` and ``state``.
        """
        columns: dict[str, Any] = {
            "time_s": self.time_s,
            "session": self.session,
            "frame": self.frame,
            "received": self.received,
        }
        for trunk in (self.lower, self.upper):
            columns[f"{trunk.name}_time_s"] = trunk.time_s
            for at, axis in enumerate(AXES):
                columns[f"{trunk.name}_{axis}_mm"] = trunk.position_mm[:, at]
            for at, axis in enumerate(AXES):
                columns[f"{trunk.name}_sd_{axis}_mm"] = np.sqrt(trunk.covariance_mm2[:, at, at])
            for at, name in enumerate(THETA):
                columns[f"{trunk.name}_{name}"] = trunk.theta[:, at]
            columns[f"{trunk.name}_rms_px"] = trunk.rms_px
            columns[f"{trunk.name}_state"] = trunk.state
        return Table(columns, self.warnings)

    def to_pandas(self) -> pandas.DataFrame:
        """The frames as a data frame of pandas: see :meth:`table`."""
        return self.table().to_pandas()

    def to_polars(self) -> polars.DataFrame:
        """The frames as a data frame of Polars: see :meth:`table`."""
        return self.table().to_polars()

    def to_arrow(self) -> pyarrow.Table:
        """The frames as a table of Arrow: see :meth:`table`."""
        return self.table().to_arrow()
