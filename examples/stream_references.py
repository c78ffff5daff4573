#!/usr/bin/env python3
"""Flies a circle of references through `oqtal gateway run`, with Python's standard library.

Usage: stream_references.py [SOCKET] [RATE_HZ] [SECONDS]
The vehicle must hover at [0, 0, 1] m.
"""

import json
import math
import os
import socket
import sys
import time

RADIUS_M = 0.5
PERIOD_S = 8.0
RAMP_S = 2.0


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
        "valid_ms": valid_ms,
    }


def main():
    arguments = sys.argv[1:]
    default = f"/tmp/oqtal-{os.getuid()}/default/gateway.sock"
    path = arguments[0] if arguments else default
    rate_hz = float(arguments[1]) if len(arguments) > 1 else 60.0
    seconds = float(arguments[2]) if len(arguments) > 2 else 20.0
    gateway = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    gateway.connect(path)
    began = time.clock_gettime(time.CLOCK_BOOTTIME)
    due = began
    while due - began < seconds:
        message = reference(due - began, (0.0, 0.0, 1.0), 2000 / rate_hz)
        message["time_ns"] = int(due * 1e9)
        gateway.send(json.dumps({"version": 1, "reference": message}).encode())
        due += 1 / rate_hz
        time.sleep(max(0.0, due - time.clock_gettime(time.CLOCK_BOOTTIME)))


if __name__ == "__main__":
    main()
