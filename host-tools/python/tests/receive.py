"""Prints what comes from a box, an object in each line, until there are enough frames."""

import json
import socket
import sys

import plumbline

address, enough = sys.argv[1], int(sys.argv[2])

# Where nobody sends, there is a time limit, and it says what to do.
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
    free.bind(("127.0.0.1", 0))
    silent = f"127.0.0.1:{free.getsockname()[1]}"
with plumbline.receive(udp=silent, timeout_s=0.3) as reception:
    for _ in range(2):
        try:
            next(reception)
        except TimeoutError as error:
            assert silent in str(error) and ";" in str(error), error
        else:
            raise AssertionError("something came from nobody")

with plumbline.receive(udp=address, box="ward 3", timeout_s=60) as reception:
    assert address in reception.place
    try:
        plumbline.receive(udp=address)
    except plumbline.BadInput as error:
        assert address in error.place and error.remedy, error
    else:
        raise AssertionError("two receive at one address")
    frames = 0
    for said in reception:
        print(json.dumps(said), flush=True)
        frames += said["kind"] == "frame"
        if frames == enough:
            break
assert any("published" in line for line in reception.said), reception.said
# It is over.
assert list(reception) == []
reception.close()
