"""What another reader finds in an export, as JSON: read.py READER PATH."""

import json
import math
import sys


def rows(columns):
    """One list per row; NaN, which JSON does not have, becomes null."""
    return [
        [None if value is None or math.isnan(value) else float(value) for value in row]
        for row in zip(*columns)
    ]


def csv(path):
    # As any table is read: nothing is said about types.
    import pyarrow.csv

    table = pyarrow.csv.read_csv(path)
    return {
        "names": table.column_names,
        "types": [str(it) for it in table.schema.types],
        "rows": rows(column.to_pylist() for column in table.columns),
    }


def parquet(path):
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    return {
        "names": table.column_names,
        "types": [str(it) for it in table.schema.types],
        "axes": (table.schema.metadata or {})[b"axes"].decode(),
        "orientations": (table.schema.metadata or {})[b"orientations"].decode(),
        "rows": rows(column.to_pylist() for column in table.columns),
    }


def trc(path):
    from trc import TRCData

    data = TRCData()
    data.load(path)
    names = data["Markers"]
    found = [
        [time] + [value for name in names for value in data[name][at]]
        for at, time in enumerate(data["Time"])
    ]
    header = {key: data[key] for key in ("DataRate", "NumFrames", "NumMarkers", "Units")}
    return header | {"names": names, "rows": rows(zip(*found))}


def ezc3d(path):
    import ezc3d

    data = ezc3d.c3d(path)
    point, own, event = (data["parameters"][group] for group in ("POINT", "PLUMBLINE", "EVENT"))
    found, residuals = data["data"]["points"], data["data"]["meta_points"]["residuals"]
    value = lambda group, name: list(group[name]["value"])
    return {
        "names": value(point, "LABELS"),
        "descriptions": value(point, "DESCRIPTIONS"),
        "rate": value(point, "RATE")[0],
        "units": value(point, "UNITS"),
        "frames": value(point, "FRAMES")[0],
        "zero": value(own, "T_ZERO")[0],
        "axes": value(own, "AXES")[0],
        # Context, label, minutes and seconds.
        "events": [
            [context, label, float(minutes), float(seconds)]
            for context, label, minutes, seconds in zip(
                value(event, "CONTEXTS"), value(event, "LABELS"), *event["TIMES"]["value"]
            )
        ],
        "residuals": residuals[0].T.tolist(),
        "rows": rows(found[axis, at] for at in range(found.shape[1]) for axis in range(3)),
    }


def c3d(path):
    import c3d

    with open(path, "rb") as file:
        reader = c3d.Reader(file)
        frames = [points for _, points, _ in reader.read_frames()]
        names = [label.strip() for label in reader.point_labels]
    columns = [
        [float(frame[at, axis]) if frame[at, 3] >= 0 else math.nan for frame in frames]
        for at in range(len(names))
        for axis in range(3)
    ]
    residuals = [[float(it) for it in frame[:, 3]] for frame in frames]
    rate = reader.point_rate
    return {"names": names, "rate": rate, "residuals": residuals, "rows": rows(columns)}


def bids(path):
    import os
    import subprocess

    validator = os.path.join(os.path.dirname(sys.executable), "bids-validator-deno")
    # No network: the validator has its rules with it.
    nowhere = "http://127.0.0.1:9"
    environment = os.environ | {"DENO_NO_UPDATE_CHECK": "1", "HTTPS_PROXY": nowhere}
    call = [validator, path, "--json"]
    done = subprocess.run(call, capture_output=True, text=True, env=environment)
    issues = json.loads(done.stdout)["issues"]["issues"]
    return {"code": done.returncode, "issues": [[it["severity"], it["code"], it.get("location")] for it in issues]}


reader, path = sys.argv[1:]
print(json.dumps(globals()[reader](path), default=lambda number: number.item()))
