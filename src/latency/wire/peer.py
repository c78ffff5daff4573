"""A law in Python, for comparison: poses of QTM by qtm-rt, attitudes for a vehicle by pymavlink.

Arguments: port of the QTM server, UDP port of the vehicle, duration [s].
"""

import asyncio
import math
import os
import sys
import time

os.environ["MAVLINK20"] = "1"

import qtm_rt
from pymavlink import mavutil

MASK_RATES = 0b111


class Law:
    """PD of the position, by which the vehicle tilts."""

    def __init__(self, vehicle):
        self.vehicle = vehicle
        self.last = None
        self.began = time.monotonic()

    def __call__(self, packet):
        now = time.monotonic()
        _, bodies = packet.get_6d()
        position, _ = bodies[0]
        place = [part / 1000 for part in (position.x, position.y, position.z)]
        speed = [0.0] * 3
        if self.last is not None:
            before, then = self.last
            speed = [(a - b) / max(now - then, 1e-3) for a, b in zip(place, before)]
        self.last = place, now
        wanted = [1.5 * (r - p) - 2.0 * v for r, p, v in zip((0, 0, 1), place, speed)]
        roll, pitch = (max(-0.3, min(0.3, part / 9.81)) for part in (-wanted[1], wanted[0]))
        thrust = max(0.0, min(1.0, 0.5 * (1 + wanted[2] / 9.81)))
        cr, sr, cp, sp = (f(angle / 2) for angle in (roll, pitch) for f in (math.cos, math.sin))
        attitude = [cr * cp, sr * cp, cr * sp, -sr * sp]
        since_ms = int((now - self.began) * 1000)
        self.vehicle.mav.set_attitude_target_send(since_ms, 1, 1, MASK_RATES, attitude, 0, 0, 0, thrust)


async def main(port, vehicle, seconds):
    law = Law(mavutil.mavlink_connection(f"udpout:127.0.0.1:{vehicle}", source_system=255))
    cameras = await qtm_rt.connect("127.0.0.1", port=port)
    if cameras is None:
        sys.exit("no QTM server answers")
    await cameras.stream_frames(components=["6d"], on_packet=law)
    await asyncio.sleep(seconds)


asyncio.run(main(*(int(word) for word in sys.argv[1:])))
