"""How a standing person sways: trials, figures, statistics, calibration, tracking, live poses.

Every number is equal to that of the program ``plumb``, to the last bit: both use the same library.

Lengths are millimetres, angles radians, times seconds. Positions of the trunk are along the body's
axes, in this order: AP (forward), ML (to the person's right), SI (up); this is a left-handed frame.
A pose is that of a printed target in the camera's frame, x right, y down, z forward; its rotation is
``Rz(theta1) @ Ry(theta2) @ Rx(theta3)``. What was not measured is NaN in an array and ``None`` elsewhere.

>>> import plumbline
>>> trial = plumbline.open_trial("trials/p01-control")
>>> trial.lower.position_mm          # (frames, 3): AP, ML, SI
>>> trial.figures().to_pandas()      # as `plumb figures`
"""

# Without it the arrays could not be made.
import numpy as _numpy  # noqa: F401

from ._cohort import Cohort, open_cohort
from ._errors import BadInput
from ._figures import figures, study, study_of_table
from ._plumbline import (
    Camera,
    Exported,
    Reception,
    TargetPose,
    Tracked,
    Tracker,
    Trunk,
    __version__,
    calibrate,
    receive,
)
from ._tables import Table
from ._trial import Trial, open_trial

__all__ = [
    "BadInput",
    "Camera",
    "Cohort",
    "Exported",
    "Reception",
    "Table",
    "TargetPose",
    "Tracked",
    "Tracker",
    "Trial",
    "Trunk",
    "__version__",
    "calibrate",
    "figures",
    "open_cohort",
    "open_trial",
    "receive",
    "study",
    "study_of_table",
]
