"""An independent parser of the frames that a host sends to an AscTec Hummingbird.

Written from the description of the serial interface (AscTec, Hummingbird with AutoPilot User's Manual, pp. 24-26), without code of
oqtal: command `>*>di` and 12 bytes, poll `>*>p` and 2, emergency stop `>*>me`. Little endian.

usage: asctec_reader.py LINK FRAMES, or asctec_reader.py -
Creates a pseudo-terminal with the symbolic link LINK, prints "ready", reads FRAMES command frames, and prints their statistics as JSON.
It sends no reply.
With a LINK of - it reads its standard input to the end, and also prints the fields of every command.
"""

import json
import os
import pty
import select
import struct
import sys
import time

POLLS = 0x0001 | 0x0002 | 0x0004 | 0x0008 | 0x0010 | 0x0080 | 0x0100 | 0x0200 | 0x0800


def command(frame):
    """Returns the fields of a command frame, or None if the frame is invalid."""
    pitch, roll, yaw, thrust, ctrl, check = struct.unpack("<hhhhhH", frame[5:])
    if (pitch + roll + yaw + thrust + ctrl + 0xAAAA) % 0x10000 != check:
        return None
    sticks = all(-2047 <= stick <= 2047 for stick in (pitch, roll, yaw))
    return (pitch, roll, yaw, thrust, ctrl) if sticks and 0 <= thrust <= 4095 and 0 <= ctrl <= 15 else None


def take(buffer, seen):
    """Removes one frame from the buffer; returns False if the frame is not complete yet."""
    for head, length in ((b">*>di", 17), (b">*>p", 6), (b">*>me", 5)):
        if buffer[: len(head)] == head[: len(buffer)]:
            if len(buffer) < length:
                return False
            frame, buffer[:] = bytes(buffer[:length]), buffer[length:]
            judge(head, frame, seen)
            return True
    seen["strange_bytes"] += 1
    del buffer[0]
    return True


def judge(head, frame, seen):
    if head == b">*>di":
        fields = command(frame)
        seen["invalid"] += fields is None
        seen["zero_setpoints"] += fields is not None and fields[:4] == (0, 0, 0, 0)
        seen["fields"].append(fields)
        seen["commands"] += 1
        seen["times"].append(time.monotonic())
    elif head == b">*>p":
        bits = struct.unpack("<H", frame[4:])[0]
        seen["invalid"] += bits == 0 or bits & ~POLLS != 0
        seen["polls"] += 1
    else:
        seen["stops"] += 1


def main():
    seen = {"commands": 0, "zero_setpoints": 0, "polls": 0, "stops": 0, "invalid": 0, "strange_bytes": 0, "times": [], "fields": []}
    if sys.argv[1] == "-":
        buffer = bytearray(sys.stdin.buffer.read())
        while buffer and take(buffer, seen):
            pass
        del seen["times"]
        print(json.dumps(seen))
        return
    link, wanted = sys.argv[1], int(sys.argv[2])
    master, slave = pty.openpty()
    os.symlink(os.ttyname(slave), link)
    print("ready", flush=True)
    buffer = bytearray()
    while seen["commands"] < wanted:
        if not select.select([master], [], [], 30.0)[0]:
            sys.exit("no bytes for 30 s")
        buffer += os.read(master, 4096)
        while buffer and take(buffer, seen):
            pass
    times = seen.pop("times")
    del seen["fields"]
    gaps = sorted(later - earlier for earlier, later in zip(times, times[1:]))
    seen["seconds"] = times[-1] - times[0]
    seen["median_gap_ms"] = gaps[len(gaps) // 2] * 1e3
    print(json.dumps(seen))


main()
