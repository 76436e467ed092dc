"""Prints the poses of a Plumbline box as CSV, in order, without a gap; see src/tell/seal/LINK.md.
Cryptography (Noise), numbers (postcard), the session, the poses. Python 3.11 and `cryptography`."""
import hmac, os, socket, struct, sys, time, zlib
from contextlib import closing, suppress
from hashlib import sha256
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

VERSION, SCHEMA_HASH = 4, 0xD7043A3D  # of the link, and of the messages that this file decodes
ANNOUNCEMENT, GREETING, ANSWER, OPENING, ACCEPTANCE, CHANNEL, STREAM = range(1, 8)  # kinds
POSE, COMMAND, REPLY, PING, RESEND, LEAVE, PONG, GONE, NOT_FOUND = 0, 4, 5, 0, 11, 14, 0, 3, 2
GREETING_BYTES, CALLER_BYTES, EPOCH_PACKETS = 227, 38, 1 << 18
ANSWER_S, PING_S, RESEND_S, SILENCE_S = 0.5, 0.4, 0.1, 3.0
ROLES = ("upper", "lower", "scene")
HEAD = "sequence,capture_time_ns,role,x_mm,y_mm,z_mm,theta1,theta2,theta3,sd_x_mm,sd_y_mm,sd_z_mm"

def keyed(key, data):
    return hmac.digest(key, data, "sha256")

def hkdf(chain, secret):
    """Noise's HKDF; where two outputs are needed, they are the first two of the three."""
    key = keyed(chain, secret)
    first = keyed(key, b"\x01")
    second = keyed(key, first + b"\x02")
    return first, second, keyed(key, second + b"\x03")

class Noise:
    """The initiator of Noise_NNpsk0_25519_ChaChaPoly_SHA256 (noiseprotocol.org, revision 34)."""

    def __init__(self, prologue, psk, private=None):
        self.private = private or X25519PrivateKey.generate()  # a new one for each handshake
        name = sha256(b"Noise_NNpsk0_25519_ChaChaPoly_SHA256").digest()
        self.chain, psk_hash, _ = hkdf(name, psk)
        self.hash = sha256(sha256(name + prologue).digest() + psk_hash).digest()

    def write(self, payload):
        """Message 1: -> psk, e. No key seals more than one message, hence nonces of zeros."""
        public = self.private.public_key().public_bytes_raw()
        self.chain, key, _ = hkdf(self.chain, public)
        transcript = sha256(self.hash + public).digest()
        sealed = ChaCha20Poly1305(key).encrypt(bytes(12), payload, transcript)
        self.hash = sha256(transcript + sealed).digest()
        return public + sealed

    def read(self, message):
        """Message 2: <- e, ee. A forged one changes nothing, because the true one may follow."""
        public, sealed = message[:32], message[32:]
        shared = self.private.exchange(X25519PublicKey.from_public_bytes(public))
        chain, key, _ = hkdf(hkdf(self.chain, public)[0], shared)
        transcript = sha256(self.hash + public).digest()
        payload = ChaCha20Poly1305(key).decrypt(bytes(12), sealed, transcript)
        return payload, *hkdf(chain, b"")[:2]  # the keys to send with, to receive with

def seal(key, counter, header, body):
    return header + ChaCha20Poly1305(key).encrypt(struct.pack("<4xQ", counter), body, header)

def unseal(key, counter, packet, at):
    return ChaCha20Poly1305(key).decrypt(struct.pack("<4xQ", counter), packet[at:], packet[:at])

def following(stream_key):
    return keyed(stream_key, b"plumbline stream\0")

def varint(value):
    """Seven bits per byte, the lowest first; the top bit says that more follow."""
    return bytes([value]) if value < 0x80 else bytes([value & 0x7F | 0x80]) + varint(value >> 7)

def read_varint(data, begin):
    """The number at `begin`, and where the next field begins; only its shortest form is valid."""
    end = next((at for at in range(begin, len(data)) if data[at] < 0x80), begin + 9) + 1
    value = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(data[begin:end]))
    if varint(value) != data[begin:end] or value >= 2**64:
        raise ValueError("not a number in its shortest form")
    return value, end

class Session:
    """One session with the box, from the Greeting on; TimeoutError where the box is silent."""

    def __init__(self, sock, box, key, token=None, private=None, process=None):
        self.sock, self.box, self.sent, self.taken = sock, box, 0, set()
        token, ours = token or os.urandom(8), bytes([VERSION, VERSION])
        greeting = (bytes([VERSION, GREETING]) + token).ljust(GREETING_BYTES, b"\0")
        answer = self.ask(greeting, ANSWER, lambda it: it[2:10] == token and authentic(key, it))
        cookie, key_id, start, schema, theirs = struct.unpack_from("<16s8s4s4s2s", answer, 10)
        if not theirs[0] <= VERSION <= theirs[1] or schema != SCHEMA_HASH.to_bytes(4, "little"):
            raise SystemExit("The box's program and this one are of different releases.")
        terms = key_id + ours + theirs + start
        noise = Noise(b"plumbline link" + bytes([VERSION]) + schema + terms + cookie, key, private)
        process, name = process or int.from_bytes(os.urandom(4), "little"), b"receiver.py"
        caller = (varint(process) + varint(len(name)) + name).ljust(CALLER_BYTES, b"\0")
        opening = bytes([VERSION, OPENING]) + cookie + terms + noise.write(caller)
        accepted, self.to_box, self.to_host = self.ask(
            opening, ACCEPTANCE, lambda it: noise.read(it[2:]))
        self.id, self.next, self.epoch, self.stream_key = struct.unpack("<2sQQ32s", accepted)
        self.seen, self.held = self.next, {}  # where the box is; what waits for what is missing

    def ask(self, packet, kind, accept):
        """Sends a packet, waits for its answer; what is not accepted somebody else has sent."""
        self.sock.sendto(packet, self.box)
        for answer, sender in packets(self.sock, time.monotonic() + ANSWER_S):
            with suppress(InvalidTag, ValueError, struct.error):
                if sender == self.box and answer[1] == kind and (accepted := accept(answer)):
                    return accepted
        raise TimeoutError

    def command(self, *action):
        header = bytes([VERSION, CHANNEL]) + self.id + varint(self.sent)
        body = bytes([COMMAND, 0]) + b"".join(map(varint, action)) + b"\0"  # numbered 0, not forced
        self.sock.sendto(seal(self.to_box, self.sent, header, body), self.box)
        self.sent += 1  # no nonce twice

    def close(self):
        for _ in range(3):  # it frees our place; nothing answers it, and one may be lost
            self.command(LEAVE)

    def take(self, packet):
        """Takes a genuine packet that has not come before; whether it was one."""
        if packet[1] == CHANNEL and packet[2:4] == self.id:
            counter, at = read_varint(packet, 4)
            if counter not in self.taken:
                self.reply(unseal(self.to_host, counter, packet, at))
                self.taken.add(counter)
                return True
        elif packet[1] == STREAM:
            counter, at = read_varint(packet, 2)
            # One key ahead at most: whoever forges a counter shall not make us compute for hours.
            steps = counter // EPOCH_PACKETS - self.epoch
            if counter >= self.next and counter not in self.held and steps in (0, 1):
                key = following(self.stream_key) if steps else self.stream_key
                self.held[counter] = unseal(key, counter, packet, at)
                self.seen = max(self.seen, counter + 1)
                return True
        return False

    def reply(self, body):
        """A reply to our number 0 says how far the box is, or what it no longer has."""
        if body[:2] == bytes([REPLY, 0]) and body[2] in (PONG, GONE):
            numbers, at = [], 3
            while at < len(body):
                number, at = read_varint(body, at)
                numbers.append(number)
            if body[2] == PONG:
                self.seen = max(self.seen, numbers[3])
            else:
                gone = range(self.next, min(numbers[0], self.seen))
                self.held |= {counter: b"" for counter in gone if counter not in self.held}

    def in_order(self):
        """What the box says to all, as far as nothing before it is missing."""
        while self.next in self.held:
            yield self.held.pop(self.next)
            self.next += 1
            if self.next // EPOCH_PACKETS > self.epoch:
                self.epoch, self.stream_key = self.epoch + 1, following(self.stream_key)

    def messages(self, until):
        """What the box says to all, in order, until then or its silence."""
        heard, ping_at, resend_at = time.monotonic(), 0, 0
        while (now := time.monotonic()) < min(until, heard + SILENCE_S):
            if now >= ping_at:  # the first one proves to the box that we have the keys
                self.command(PING, time.monotonic_ns())
                ping_at = now + PING_S
            if now >= resend_at and self.next < self.seen:
                missing = (it for it in range(64) if self.next + it not in self.held)
                mask = sum(1 << it for it in missing if self.next + it < self.seen)
                self.command(RESEND, self.next, mask)
                resend_at = now + RESEND_S
            for packet, sender in packets(self.sock, min(until, now + RESEND_S)):
                with suppress(InvalidTag, ValueError):
                    if sender == self.box and self.take(packet):
                        heard = time.monotonic()
                        yield from self.in_order()

def authentic(key, answer):
    """The answer, if somebody made it who has the key: a MAC comes before the CRC-32, its last."""
    right = keyed(key, b"plumbline answer\0" + answer[:-20])[:16]
    return answer if hmac.compare_digest(answer[-20:-4], right) else None

def packets(sock, until):
    """The packets of our version, and the first ones of any, until then; each with its sender."""
    while (left := until - time.monotonic()) > 0:
        sock.settimeout(min(left, 60))
        with suppress(TimeoutError, ConnectionResetError):  # the latter only under Windows
            packet, sender = sock.recvfrom(2048)
            if len(packet) > 4 and (packet[0] == VERSION or packet[1] in (ANNOUNCEMENT, ANSWER)):
                yield packet, sender

def find(sock, key_id, until):
    """Waits for the Announcement of the box with our key; returns the box's address."""
    for packet, sender in packets(sock, until):
        if packet[1] == ANNOUNCEMENT and packet[2:10] == key_id:
            return sender
    raise SystemExit(f"No box with the key {key_id.hex()} has announced itself.")

def rows(body):
    """The rows of a Pose message: one per target, without numbers where it has no pose."""
    sequence, capture_time_ns, count, at = *struct.unpack_from("<IQ5xB", body, 1), 19
    for _ in range(count):
        role, _state, failed = body[at : at + 3]
        numbers = [""] * 9
        if failed:  # the reason follows; NOT_FOUND has one of its own
            at += 5 if body[at + 3] == NOT_FOUND else 4
        else:  # delay, angles, position, its SDs, SDs of turns, correlations, residual, corners
            it = struct.unpack_from("<I3f3f3H3H15bHB", body, at + 3)
            numbers = [*it[4:7], *it[1:4], *(steps / 10_000 for steps in it[7:10])]
            at += 61
        yield ",".join(map(str, [sequence, capture_time_ns, ROLES[role], *numbers]))

def main():
    file, port, frames, seconds = sys.argv[1], *map(int, sys.argv[2:])
    _, digits, checksum = (text := open(file).read().strip().upper()).split(":")
    if zlib.crc32(text[:-9].encode()) != int(checksum, 16):
        raise SystemExit(f"{file} does not hold a Plumbline key, or it is damaged.")
    key, until = bytes.fromhex(digits), time.monotonic() + seconds
    (sock := socket.socket(type=socket.SOCK_DGRAM)).bind(("", port))
    print(HEAD)
    while time.monotonic() < until:
        box = find(sock, keyed(key, b"plumbline key id")[:8], until)
        with suppress(TimeoutError), closing(Session(sock, box, key)) as session:  # or again
            for body in session.messages(until):
                if body[:1] == bytes([POSE]):
                    print(*rows(body), sep="\n", flush=True)
                    if (frames := frames - 1) == 0:
                        return

if __name__ == "__main__":
    main() if len(sys.argv) == 5 else sys.exit("receiver.py KEY_FILE UDP_PORT FRAMES SECONDS")
