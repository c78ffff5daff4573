"""Frames encoded by digi-xbee, one JSON object per line: kind, fields in the order of the wire, payload, plain and escaped bytes.

Run by wire/tests/peers.rs, with a Python interpreter that has requirements.txt installed.
"""

import json
import random

from digi.xbee.models.address import XBee16BitAddress, XBee64BitAddress
from digi.xbee.models.status import DiscoveryStatus, ModemStatus, TransmitStatus
from digi.xbee.packets.common import ModemStatusPacket, ReceivePacket, TransmitPacket, TransmitStatusPacket
from digi.xbee.packets.raw import RX16Packet, RX64Packet, TX16Packet, TXStatusPacket

SPECIAL = bytes([0x7E, 0x7D, 0x11, 0x13])
GREATEST = 100


def show(packet, fields, payload=b""):
    print(json.dumps({
        "kind": packet.get_frame_type().code,
        "fields": fields,
        "payload": payload.hex(),
        "plain": packet.output().hex(),
        "escaped": packet.output(escaped=True).hex(),
    }))


def payloads(draw):
    """Yields every single byte, every length, and payloads of bytes that must be escaped."""
    yield from (bytes([byte]) for byte in range(256))
    yield from (draw.randbytes(length) for length in range(GREATEST + 1))
    for special in SPECIAL:
        yield bytes([special]) * GREATEST
    for _ in range(100):
        yield bytes(draw.choice(SPECIAL + draw.randbytes(2)) for _ in range(draw.randrange(GREATEST + 1)))


def address(draw, length):
    return bytes(draw.choice(SPECIAL + draw.randbytes(4)) for _ in range(length))


def carriers(draw):
    for payload in payloads(draw):
        long, short = address(draw, 8), address(draw, 2)
        number, first, second = (draw.choice(SPECIAL + draw.randbytes(4)) for _ in range(3))
        far, near = int.from_bytes(long, "big"), int.from_bytes(short, "big")
        long, short = XBee64BitAddress(bytearray(long)), XBee16BitAddress(bytearray(short))
        data = bytearray(payload)
        show(TransmitPacket(number, long, short, first, second, data), [number, far, near, first, second], payload)
        show(TX16Packet(number, short, first, data), [number, near, first], payload)
        show(ReceivePacket(long, short, first, data), [far, near, first], payload)
        show(RX64Packet(long, first, second, data), [far, first, second], payload)
        show(RX16Packet(short, first, second, data), [near, first, second], payload)


def reports(draw):
    for status in TransmitStatus:
        number = draw.randrange(256)
        show(TXStatusPacket(number, status), [number, status.code])
        for discovery in DiscoveryStatus:
            short, retries = address(draw, 2), draw.randrange(256)
            packet = TransmitStatusPacket(number, XBee16BitAddress(bytearray(short)), retries, status, discovery)
            near = int.from_bytes(short, "big")
            show(packet, [number, near, retries, status.code, discovery.code])
    for status in ModemStatus:
        show(ModemStatusPacket(status), [status.code])


if __name__ == "__main__":
    draw = random.Random(7)
    carriers(draw)
    reports(draw)
