"""Checks that receiver.py makes and opens the packets of vectors.json, without a network."""
import json, struct, sys
from contextlib import suppress
from pathlib import Path
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
import receiver

vectors = json.loads(Path(sys.argv[1]).read_text())
it = {name: bytes.fromhex(value) for name, value in vectors.items()}
answers = [it["answer"], it["acceptance"]]
sent = []


class Network:
    """A socket whose peer has said everything already."""

    def sendto(self, packet, _):
        sent.append(packet)

    def settimeout(self, _):
        pass

    def recvfrom(self, _):
        return answers.pop(0), "box"


session = receiver.Session(
    Network(), "box", it["key"], token=it["token"],
    private=X25519PrivateKey.from_private_bytes(it["host_ephemeral"]),
    process=int.from_bytes(it["process"], "little"))
session.command(receiver.PING, 5_000_000_000)
assert sent == [it["greeting"], it["opening"], it["ping"]], "what is sent is another"
assert (session.next, session.epoch) == (2, 0)
assert session.take(it["pong"]) and not session.take(it["pong"]), "a reply counts once"
for name in ("second_pose", "first_pose"):
    damaged = it[name][:-1] + bytes([it[name][-1] ^ 1])
    with suppress(InvalidTag):
        raise SystemExit(f"{name} is taken though it is damaged: {session.take(damaged)}")
    assert session.take(it[name]) and not session.take(it[name]), f"{name} counts once"
messages = list(session.in_order())
assert messages == [it["first_pose_message"], it["second_pose_message"]], "the messages are others"
assert struct.unpack_from("<I", messages[0], 1) == (2,), "the third pose"
session.close()
assert sent[3] == it["leave"], "the goodbye is another"
print("the vectors are right")
