#!/usr/bin/env python3
"""Flies a circle of references through `oqtal gateway run`, with Python's standard library.

The vehicle must hover at [0, 0, 1] m. From another machine, through `oqtal gateway run --udp 0.0.0.0:8610 --key gateway.key`:

    python3 stream_references.py --udp HOST:8610 --key gateway.key
"""

import argparse
import collections
import contextlib
import hmac
import json
import math
import os
import socket
import sys
import tempfile
import time

RADIUS_M = 0.5
PERIOD_S = 8.0
RAMP_S = 2.0
STATUS_PERIOD_S = 0.2


def angle(t):
    """Angle [rad] and angular speed [rad/s] of a circle that begins at rest."""
    full = 2 * math.pi / PERIOD_S
    if t >= RAMP_S:
        return full * (t - RAMP_S / 2), full
    x = t / RAMP_S
    return full * RAMP_S * x**3 * (1 - x / 2), full * x * x * (3 - 2 * x)


def reference(t, start, valid_ms):
    """The reference at t [s] after the start at the point `start` [m, world]."""
    a, rate = angle(t)
    x, y, z = start
    return {
        "position_m": [x + RADIUS_M * (math.cos(a) - 1), y + RADIUS_M * math.sin(a), z],
        "velocity_m_s": [-RADIUS_M * rate * math.sin(a), RADIUS_M * rate * math.cos(a), 0],
        "acceleration_m_s2": [-RADIUS_M * rate**2 * math.cos(a), -RADIUS_M * rate**2 * math.sin(a), 0],
        "jerk_m_s3": [RADIUS_M * rate**3 * math.sin(a), -RADIUS_M * rate**3 * math.cos(a), 0],
        "valid_ms": valid_ms,
    }


def gateway_socket():
    """The socket of the gateway of the instance `default`, in the directories in which oqtal looks for instances."""
    roots = ["/run/oqtal", os.environ.get("XDG_RUNTIME_DIR", "/run") + "/oqtal", f"/tmp/oqtal-{os.getuid()}"]
    paths = [f"{root}/default/gateway.sock" for root in roots]
    return next(filter(os.path.exists, paths), paths[0])


class Local:
    """The gateway's socket on this machine. Replies come to a socket with a path of its own."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.directory = tempfile.TemporaryDirectory()
        try:
            self.socket.bind(f"{self.directory.name}/replies.sock")
            self.socket.connect(path)
        except OSError as error:
            raise SystemExit(f"{path}: {error}; start `oqtal gateway run`, or name the socket that it prints with --socket")

    def send(self, message):
        self.socket.send(json.dumps(message).encode())

    def reply(self):
        """A reply that has come; None if there is none."""
        try:
            return json.loads(self.socket.recv(65536, socket.MSG_DONTWAIT))
        except BlockingIOError:
            return None


def read_key(path):
    """The key in the file `path`, 64 hexadecimal digits."""
    try:
        with open(path) as file:
            key = bytes.fromhex(file.read().strip())
    except (OSError, ValueError) as error:
        raise SystemExit(f"{path}: {error}; give the file of the key, 64 hexadecimal digits")
    if len(key) != 32:
        raise SystemExit(f"{path}: {len(key)} bytes; a key has 32, as 64 hexadecimal digits")
    return key


class Remote:
    """A gateway on the network: each datagram has a code of the key, the gateway's session, and a number that counts once."""

    def __init__(self, address, key):
        host, _, port = address.rpartition(":")
        if not port.isdigit():
            raise SystemExit(f"--udp {address}: expected HOST:PORT")
        self.key = key
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.session = "none"
        self.sequence = self.offset_ns = 0
        # Numbers of datagrams without a reply: a reply repeats one of them, so one that was recorded before does not count.
        self.unanswered = collections.deque(maxlen=1024)
        try:
            self.socket.connect((host, int(port)))
            self.socket.settimeout(2.0)
            # Refused, since the session is another; the reply tells the present one.
            self.socket.send(self.signed({"version": 1}))
            if self.confirmed(self.socket.recv(65536)) is None:
                raise SystemExit(f"{address}: the reply is not from a gateway with the key")
        except socket.timeout:
            raise SystemExit(f"{address}: no reply; the gateway has another key, or none listens there")
        except (OSError, OverflowError) as error:
            raise SystemExit(f"{address}: {error}; start `oqtal gateway run --udp {address} --key FILE` there")
        self.socket.setblocking(False)

    def code(self, text):
        return hmac.new(self.key, text, "sha256").hexdigest().encode()

    def signed(self, message):
        """The datagram with `message` and the next sequence number: the clock, or the number after the last one."""
        self.sequence = max(self.sequence + 1, time.time_ns() + self.offset_ns)
        self.unanswered.append(self.sequence)
        text = f"program {self.session} {self.sequence}\n{json.dumps(message)}".encode()
        return self.code(text) + b" " + text

    def confirmed(self, datagram):
        """The reply in `datagram`; None if it is not one of the gateway to a datagram of this program."""
        code, _, text = datagram.partition(b" ")
        if not hmac.compare_digest(code, self.code(text)):
            return None
        line, _, content = text.decode().partition("\n")
        author, *words = line.split(" ")
        if author != "gateway" or int(words[1]) not in self.unanswered:
            return None
        self.unanswered.remove(int(words[1]))
        reply = json.loads(content)
        if words[0] != self.session or "continue_after" in reply:
            # The gateway has started again, or the clock differs from another sender's. Datagrams on the way are refused as well.
            self.session = words[0]
            self.unanswered.clear()
        if "continue_after" in reply:
            self.sequence = reply["continue_after"]
            self.offset_ns = self.sequence + 1 - time.time_ns()
        return reply

    def send(self, message):
        # Refused is the datagram before; the gateway may be starting again.
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            self.socket.send(self.signed(message))

    def reply(self):
        """A reply that has come; None if there is none."""
        while True:
            try:
                reply = self.confirmed(self.socket.recv(65536))
            except BlockingIOError:
                return None
            except ConnectionRefusedError:
                return {"answer": "refused", "text": "no gateway listens there"}
            if reply:
                return reply


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--socket", default=gateway_socket())
    parser.add_argument("--udp", metavar="HOST:PORT")
    parser.add_argument("--key", metavar="FILE")
    parser.add_argument("--rate-hz", type=float, default=60.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    if given.udp and not given.key:
        parser.error("--udp needs --key FILE")
    gateway = Remote(given.udp, read_key(given.key)) if given.udp else Local(given.socket)
    try:
        if not fly_circle(gateway, given):
            raise SystemExit("the daemon followed none of the references: `oqtal ctl status` shows whether the vehicle hovers")
    except OSError as error:
        raise SystemExit(f"the gateway does not receive any more: {error}")
    except KeyboardInterrupt:
        raise SystemExit(130)


def fly_circle(gateway, given):
    """Sends references to `gateway` at the rate and for the time of the arguments, and prints each new refusal.

    True if the daemon has followed them, and the gateway did not refuse them to the end.
    """
    begun = due = time.clock_gettime(time.CLOCK_BOOTTIME)
    asked_at, told, followed, refused = begun, None, False, False
    while due - begun < given.seconds:
        message = reference(due - begun, (0.0, 0.0, 1.0), 2000 / given.rate_hz)
        if not given.udp:
            # The clock of this machine; without it the instant of reception counts.
            message["time_ns"] = int(due * 1e9)
        gateway.send({"version": 1, "reference": message})
        # The gateway replies to a reference that it refuses; those that the daemon refuses are in its status.
        if due >= asked_at:
            gateway.send({"version": 1, "request": "status"})
            asked_at += STATUS_PERIOD_S
        while reply := gateway.reply():
            refusal = refusal_in(reply)
            if reply["answer"] == "refused":
                refused = True
            else:
                # If these are refused, those that the daemon follows are another program's.
                followed = not refused and (followed or "references of a planner" in reply["text"])
                refused = False
            if refusal and refusal != told:
                print(f"refused: {refusal}", file=sys.stderr)
                told = refusal
        due += 1 / given.rate_hz
        time.sleep(max(0.0, due - time.clock_gettime(time.CLOCK_BOOTTIME)))
    return followed


def refusal_in(reply):
    """The refusal of a request or a reference in `reply`; None without one."""
    text = reply["text"]
    _, found, reason = text.partition("set-point refused: ")
    return (reason.splitlines() or [text])[0] if found or reply["answer"] == "refused" else None


if __name__ == "__main__":
    main()
