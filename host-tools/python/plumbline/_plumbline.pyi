"""The part of the package that is written in Rust. Lengths are millimetres, angles radians, times
seconds; body's axes are AP, ML, SI; the camera's x right, y down, z forward."""

import os
from types import TracebackType
from typing import Any, Literal, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Unpack

from ._errors import BadInput

__version__: str

Path: TypeAlias = str | os.PathLike[str]
Bin: TypeAlias = tuple[float, float]
Span: TypeAlias = Literal["all"] | tuple[float, float]
# How figures are made.
Method = TypedDict(
    "Method",
    {
        "filter": str | None,
        "span": Span | None,
        "bins": list[Bin] | None,
        "covered_min": float | None,
        "radius_mm": float | None,
    },
    total=False,
)
Zero: TypeAlias = Literal["mark", "start", "onset"]
Numbers: TypeAlias = NDArray[np.float64]
Grey: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]

class Trunk:
    """One trunk's points, a row for each frame of the trial; NaN for what was not measured."""

    @property
    def name(self) -> Literal["lower", "upper"]: ...
    @property
    def time_s(self) -> Numbers:
        """When the target was exposed, seconds from t = 0: (rows,)."""
    @property
    def position_mm(self) -> Numbers:
        """AP, ML, SI: (rows, 3)."""
    @property
    def covariance_mm2(self) -> Numbers:
        """Covariance of AP, ML, SI from the noise of the pose: (rows, 3, 3)."""
    @property
    def theta(self) -> Numbers:
        """theta1, theta2, theta3 (radians), x, y, z (mm) of the target in the camera's frame: (rows, 6).
        Single precision, as the box sends them."""
    @property
    def rms_px(self) -> Numbers:
        """Reprojection error, raw pixels: (rows,)."""
    @property
    def state(self) -> list[str]:
        """"tracking", or the state and why there is no pose, as in "coasting: too few corners"; empty for a
        frame that never came."""

class Exported:
    """What has been exported."""

    @property
    def rows(self) -> int: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def zero(self) -> str: ...
    @property
    def warnings(self) -> list[str]: ...

class Trial:
    @property
    def path(self) -> os.PathLike[str]: ...
    @property
    def title(self) -> str: ...
    @property
    def participant(self) -> str | None: ...
    @property
    def condition(self) -> str | None: ...
    @property
    def time_s(self) -> Numbers: ...
    @property
    def session(self) -> NDArray[np.uint32]: ...
    @property
    def frame(self) -> NDArray[np.uint32]: ...
    @property
    def received(self) -> NDArray[np.bool_]: ...
    @property
    def lower(self) -> Trunk: ...
    @property
    def upper(self) -> Trunk: ...
    @property
    def manifest(self) -> dict[str, Any]: ...
    @property
    def verdict(self) -> dict[str, Any]: ...
    @property
    def grade(self) -> str: ...
    @property
    def events(self) -> list[dict[str, Any]]: ...
    @property
    def zero(self) -> str: ...
    @property
    def zero_utc_s(self) -> float | None: ...
    @property
    def rate_hz(self) -> float | None: ...
    @property
    def warnings(self) -> list[str]: ...
    def _figures(self, **method: Unpack[Method]) -> tuple[dict[str, Any], list[str]]: ...
    def analyze(self, **method: Unpack[Method]) -> dict[str, Any]: ...
    def export(
        self,
        format: str,
        path: Path,
        *,
        session: str | None = None,
        run: int | None = None,
        force: bool = False,
    ) -> Exported: ...
    def __len__(self) -> int: ...

def open_trial(path: Path, *, zero: Zero | None = None) -> Trial: ...
def figures(
    paths: list[Path],
    *,
    zero: Zero | None = None,
    **method: Unpack[Method],
) -> tuple[dict[str, Any], list[str], list[BadInput]]: ...
def study(path: Path, *, cohort: Path | None = None) -> dict[str, Any]: ...
def study_of_table(
    path: Path,
    *,
    response: str,
    within: list[str],
    subject: str,
    delimiter: str = "comma",
    drop_incomplete: bool = False,
) -> dict[str, Any]: ...

class Cohort:
    @property
    def path(self) -> os.PathLike[str]: ...
    def _trials(self) -> dict[str, Any]: ...
    def _figures(
        self,
        *,
        trials: list[str] | None = None,
        **method: Unpack[Method],
    ) -> dict[str, Any]: ...
    def __len__(self) -> int: ...

def open_cohort(path: Path) -> Cohort: ...
def cohort_columns(
    table: Literal["trials", "figures", "points"],
) -> list[tuple[str, Literal["text", "number", "integer", "flag", "instant"]]]: ...
def figures_of_points(
    row: dict[str, Any], points: dict[str, Any], **method: Unpack[Method]
) -> dict[str, Any]: ...

TakesPart: TypeAlias = tuple[str, str, str, str]

class CohortStudy:
    """A study of a cohort in steps that can be taken on different computers."""

    def __new__(cls, text: str, place: Path, cohort: Path) -> CohortStudy: ...
    @property
    def title(self) -> str: ...
    def admitted(self, trials: dict[str, Any]) -> tuple[list[TakesPart], list[str]]:
        """Of the table of trials those that take part: ``trial``, its place in messages, its
        participant and its condition; and the warnings."""
    def values(
        self, row: dict[str, Any], points: dict[str, Any]
    ) -> tuple[dict[str, Any], list[str]]:
        """What a trial contributes: columns ``trial``, ``point``, ``chosen`` (which of the study's
        figures), ``time`` (which of its times, from 0), ``value``, ``absent``; and the warnings."""
    def compare(
        self, point: str, chosen: int, takes_part: list[TakesPart], columns: dict[str, Any]
    ) -> dict[str, Any]:
        """The statistics of one response, from the columns ``trial``, ``time``, ``value``, ``absent``
        of all trials; or the ``reason`` why there are none."""

def adjusted(p: list[float]) -> tuple[list[float], list[float]]:
    """The p of one effect in many responses, adjusted after Holm, and after Benjamini and Hochberg."""

class Camera:
    """A calibrated camera. Pixel (0, 0) is the centre of the top-left pixel."""

    @staticmethod
    def open(path: Path) -> Camera:
        """Reads camera.toml, or a file of OpenCV (YAML, JSON) or ROS (camera_info YAML)."""
    def save(self, path: Path, *, force: bool = False) -> None:
        """Writes camera.toml; one that exists is replaced only with ``force``."""
    def to_toml(self) -> str: ...
    @property
    def width_px(self) -> int: ...
    @property
    def height_px(self) -> int: ...
    @property
    def model(self) -> str:
        """"radial2", "brown5", "rational8", "thin_prism12" or "fisheye4"."""
    @property
    def matrix(self) -> Numbers:
        """The pinhole's matrix, pixels: (3, 3)."""
    @property
    def distortion(self) -> Numbers:
        """The coefficients of the model, named and ordered as in OpenCV."""
    @property
    def names(self) -> list[str]:
        """The names of all numbers: fx_px, fy_px, cx_px, cy_px, skew_px, k1, ..."""
    @property
    def values(self) -> Numbers:
        """The numbers, in the order of ``names``."""
    @property
    def sd(self) -> Numbers | None:
        """Their standard deviations; None where the file does not say them."""
    @property
    def correlations(self) -> Numbers | None:
        """Their correlations, a square; None where the file does not say them."""
    @property
    def readout_ms(self) -> float: ...
    @property
    def rms_px(self) -> float | None: ...
    @property
    def images(self) -> int | None: ...
    @property
    def date(self) -> str | None: ...
    @property
    def concerns(self) -> list[str] | None:
        """What is wrong with the photographs or the board; empty where it is good."""
    @property
    def photographs(self) -> list[dict[str, Any]] | None:
        """Of each photograph ``file``, and ``rms_px`` and ``corners``, or ``refused``."""

def calibrate(
    images: list[Path] | list[Grey],
    board: tuple[int, int] = (9, 6),
    pitch_mm: float = 20.0,
    *,
    model: str = "auto",
    white_level: int | None = None,
) -> Camera:
    """Calibrates a camera from photographs of a checkerboard, as ``plumb calibrate`` does.

    Args:
        images: files (PNG, JPEG, PGM), or a Y4M video of them; or grey samples in arrays (rows,
            columns), at most 200, which are named images[0], images[1], ...
        board: columns and rows of INNER corners.
        pitch_mm: from one inner corner to the next.
        model: "auto", or the name of a lens model.
        white_level: the brightest possible sample of arrays: 255 or 65535 unless it is given, 1023
            for 10 bits.

    Raises:
        BadInput: a photograph cannot be read, or they make no calibration.
        TypeError: an image is neither a file nor a two-dimensional array of these types.
    """

class TargetPose:
    """One target in one frame. Without a pose its numbers are None, and ``no_pose`` says why."""

    @property
    def name(self) -> str: ...
    @property
    def role(self) -> Literal["lower", "upper", "scene"]: ...
    @property
    def state(self) -> Literal["acquiring", "tracking", "coasting"]: ...
    @property
    def no_pose(self) -> str | None: ...
    @property
    def time_s(self) -> float:
        """When it was exposed: with a rolling shutter later than the frame."""
    @property
    def theta(self) -> Numbers | None:
        """theta1, theta2, theta3 (radians), x, y, z (mm) of cam_from_target: (6,)."""
    @property
    def rotation(self) -> Numbers | None:
        """The rotation of cam_from_target; its columns are the target's axes: (3, 3)."""
    @property
    def translation_mm(self) -> Numbers | None:
        """The target's origin in the camera's frame: (3,)."""
    @property
    def covariance(self) -> Numbers | None:
        """Covariance of small turns about the target's axes (radians), then of moves along the camera's
        axes (mm): (6, 6)."""
    @property
    def rms_px(self) -> float | None: ...
    @property
    def corners(self) -> int | None: ...
    @property
    def corners_total(self) -> int | None: ...

class Tracked:
    """What was found in one frame."""

    @property
    def index(self) -> int: ...
    @property
    def time_s(self) -> float: ...
    @property
    def targets(self) -> list[TargetPose]:
        """In the order of targets.toml."""
    @property
    def lower(self) -> Numbers | None:
        """The lower trunk's point, AP, ML, SI: (3,); None without a pose or a scene."""
    @property
    def upper(self) -> Numbers | None:
        """The upper trunk's point, likewise."""
    def rows(self) -> list[dict[str, Any]]:
        """The rows of ``plumb track``, one for each target, by column; None where a cell is empty."""

class Tracker:
    """Tracks printed targets from frame to frame, as the box and ``plumb track`` do.

    One thread at a time may use a tracker; other threads go on while it measures.

    Args:
        camera: a Camera, or its file.
        targets: targets.toml.
        scene: scene.toml, without which there are poses but no trunk points.
        independent: search every frame afresh, for photographs that do not follow each other. The
            frame may cut the squares around a target whose corners are all seen.
        scale_camera: the columns and rows of the frames, where the camera was calibrated at another
            size, and they are the same picture resampled.

    Raises:
        BadInput: a file cannot be used, or the frames would have another shape than the camera's.
    """

    def __new__(
        cls,
        camera: Camera | Path,
        targets: Path,
        scene: Path | None = None,
        *,
        independent: bool = False,
        scale_camera: tuple[int, int] | None = None,
    ) -> Tracker: ...
    def step(
        self,
        frame: Grey,
        time_s: float,
        *,
        white_level: int | None = None,
    ) -> Tracked:
        """Measures one frame.

        Args:
            frame: grey samples, (rows, columns), of the camera's size.
            time_s: its capture time, from 0 on; only differences matter.
            white_level: the brightest possible sample: 255 or 65535 unless it is given, 1023 for 10 bits.

        Raises:
            BadInput: the frame is of another size, or an argument is out of range.
            TypeError: the frame is no two-dimensional array of these types.
        """
    def forget(self) -> None:
        """Forgets where the targets are: the next frame is searched afresh."""
    @property
    def targets(self) -> list[str]: ...
    @property
    def warnings(self) -> list[str]: ...

class Reception:
    """A box's poses while they come: an iterator of dictionaries.

    Each is what ``plumb receive --json`` sends as a line: see FORMATS.md. ``kind`` is "stream", "frame",
    "gap", "mark" or "notice". If nothing comes within the timeout, TimeoutError is raised, and
    the iteration can go on afterwards. Where a program reads too slowly, what comes is dropped and
    counted, and said in ``said`` at the end.
    """

    def __iter__(self) -> Reception: ...
    def __next__(self) -> dict[str, Any]: ...
    def __enter__(self) -> Reception: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None: ...
    def close(self) -> None: ...
    @property
    def place(self) -> str: ...
    @property
    def said(self) -> list[str]: ...
    @property
    def warnings(self) -> list[str]: ...

def receive(
    *,
    udp: str | None = None,
    serial: str | None = None,
    baud: int = 115200,
    box: str | None = None,
    timeout_s: float = 10.0,
    past: bool = False,
) -> Reception:
    """Receives a box's poses while they come, with the keys of this computer (``plumb keys list``).

    Args:
        udp: the address and port to listen at; "0.0.0.0:4210" unless it is given.
        serial: a serial device instead.
        baud: its bits per second.
        box: which box: its name, serial number, or the first digits of its key's identity; the first
            that is heard unless it is given.
        timeout_s: how long the next object is waited for.
        past: what the box has kept of the last minute as well.

    Raises:
        BadInput: the address or the device cannot be opened, or no key is known here.
    """
