"""What `plumb simulate` and `plumb track` write, for the scripts beside this one."""

import csv

import numpy as np


def read_poses(path):
    """(frame, target) -> (rotation, position in mm), where there is a pose."""
    poses = {}
    for row in csv.DictReader(path.open()):
        if not row["x_mm"]:
            continue
        t1, t2, t3 = (float(row[f"theta{i}_rad"]) for i in (1, 2, 3))
        (s1, s2, s3), (c1, c2, c3) = np.sin([t1, t2, t3]), np.cos([t1, t2, t3])
        about_z = np.array([[c1, -s1, 0], [s1, c1, 0], [0, 0, 1]])
        about_y = np.array([[c2, 0, s2], [0, 1, 0], [-s2, 0, c2]])
        about_x = np.array([[1, 0, 0], [0, c3, -s3], [0, s3, c3]])
        position_mm = np.array([float(row[f"{axis}_mm"]) for axis in "xyz"])
        poses[int(row["frame"]), row["target"]] = about_z @ about_y @ about_x, position_mm
    return poses


def read_deviations(path):
    """(frame, target) -> the stated standard deviations of the position in mm."""
    rows = csv.DictReader(path.open())
    return {
        (int(row["frame"]), row["target"]): [float(row[f"sd_{axis}_mm"]) for axis in "xyz"]
        for row in rows
        if row["x_mm"]
    }
