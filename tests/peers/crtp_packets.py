"""Packets encoded by cflib, one JSON object per line: kind, fields in SI units and axes x forward, y left, z up, bytes.

Run by wire/tests/peers.rs, with a Python interpreter that has requirements.txt installed.
"""

import json
import math
import random
import warnings

from cflib.crazyflie.commander import Commander
from cflib.crazyflie.localization import Localization
from cflib.crazyflie.log import Log, LogConfig, LogTocElement, LogVariable
from cflib.crazyflie.mem import Memory
from cflib.crazyflie.param import Param, ParamTocElement, _ParamUpdater
from cflib.crazyflie.platformservice import PlatformService
from cflib.crazyflie.supervisor import Supervisor
from cflib.crazyflie.toc import Toc, TocFetcher
from cflib.crtp.crtpstack import CRTPPacket, CRTPPort
from cflib.utils.callbacks import Caller
from cflib.utils.encoding import compress_quaternion, decompress_quaternion

warnings.simplefilter("ignore")


class Host:
    """Takes the place of the Crazyflie object: keeps the packets that a service sends."""

    def __init__(self, protocol):
        self.link, self.packets, self.log = self, [], self
        self.log_blocks = []
        self.disconnected = self.connection_requested = Caller()
        self.toc = Toc()
        self.platform = self
        self.protocol = protocol

    def get_protocol_version(self):
        return self.protocol

    def send_packet(self, packet, expected_reply=(), resend=False, timeout=0.2):
        self.packets.append(packet)

    def add_port_callback(self, port, callback):
        pass

    def add_header_callback(self, callback, port, channel):
        pass


def show(kind, fields, host):
    packet = host.packets.pop()
    print(json.dumps({"kind": kind, "fields": fields, "bytes": (bytes([packet.header]) + bytes(packet.data)).hex()}))


def setpoints(draw):
    host = Host(7)
    commander = Commander(host)
    for _ in range(200):
        # Numbers that a float of 32 bits holds, so that degrees are the same on both sides.
        roll, pitch, yaw = (draw.randrange(-2000, 2000) / 8 or 1.0 for _ in range(3))
        thrust = draw.randrange(60001)
        commander.send_setpoint(roll, pitch, yaw, thrust)
        show("setpoint", [math.radians(roll), math.radians(pitch), -math.radians(yaw), thrust], host)
    commander.send_setpoint(0, 0, 0, 0)
    show("setpoint", [0.0, 0.0, 0.0, 0], host)
    commander.send_stop_setpoint()
    show("stop", [], host)
    for millis in (0, 1, 500, 2**32 - 1):
        commander.send_notify_setpoint_stop(millis)
        show("end_of_setpoints", [millis], host)


def quaternion(draw):
    components = [draw.gauss(0, 1) for _ in range(4)]
    norm = math.sqrt(sum(c * c for c in components))
    return [c / norm for c in components]


def poses(draw):
    host = Host(7)
    localization = Localization(host)
    for _ in range(200):
        position, attitude = [draw.uniform(-5, 5) for _ in range(3)], quaternion(draw)
        localization.send_extpose(position, attitude)
        show("pose", position + attitude, host)
    for _ in range(500):
        attitude = quaternion(draw)
        compressed = int(compress_quaternion(attitude))
        read = [float(c) for c in decompress_quaternion(compressed)]
        print(json.dumps({"kind": "quaternion", "fields": attitude + read, "bytes": f"{compressed:08x}"}))


def services():
    host = Host(12)
    supervisor, legacy = Supervisor(host), Supervisor(Host(7))
    for name, speaker in (("supervisor", supervisor), ("legacy_supervisor", legacy)):
        for code, send in enumerate([
            lambda: speaker.send_arming_request(False),
            lambda: speaker.send_arming_request(True),
            speaker.send_crash_recovery_request,
            speaker.send_emergency_stop,
            speaker.send_emergency_stop_watchdog,
        ]):
            send()
            show(name, [code], speaker._cf)
    supervisor._bitfield_received.wait = lambda timeout: True
    supervisor.read_bitfield()
    show("supervision", [], host)
    platform = PlatformService(host)
    platform.fetch_platform_informations(None)
    show("source", [], host)
    platform._crt_service_callback(CRTPPacket(0xFD, b"Bitcraze Crazyflie".ljust(30, b"\0")))
    show("protocol_version", [], host)
    host.packets.append(CRTPPacket(0xFF))
    show("null", [], host)
    Memory(host).refresh(None)
    show("memory_count", [], host)


def tables(draw):
    host = Host(7)
    for table, port in enumerate((CRTPPort.PARAM, CRTPPort.LOGGING)):
        fetcher = TocFetcher(host, LogTocElement, port, Toc(), None, None)
        fetcher.start()
        show("table_info", [table], host)
        for element in [0, 1, 255, 256, 65535] + [draw.randrange(65536) for _ in range(20)]:
            fetcher._request_toc_element(element)
            show("table_element", [table, element], host)


def parameters():
    host = Host(7)
    param = Param(host)
    param._useV2 = True
    param._initialized.set()
    updater = _ParamUpdater(host, True, None)
    param.param_updater = updater
    updater.request_param_setvalue = host.send_packet
    values = {0x08: 200, 0x09: 60000, 0x0A: 2**32 - 1, 0x00: -3, 0x01: -300, 0x02: -70000, 0x06: 0.25}
    for identity in (0, 1, 255, 256, 65535):
        updater.request_param_update(identity)
        host.send_packet(updater.request_queue.get())
        show("read_parameter", [identity], host)
        for code, value in values.items():
            param.toc = Toc()
            param.toc.add_element(ParamTocElement(identity, bytes([code]) + b"group\0name\0"))
            param.set_value("group.name", value)
            show("write_parameter", [identity, code, value], host)


class Element:
    def __init__(self, ident, group, name):
        self.ident, self.group, self.name = ident, group, name


def log_blocks(draw):
    names = list(LogTocElement.types)
    names.remove(8)
    for count in range(1, 10):
        host = Host(7)
        config = LogConfig("block", 10 * draw.randrange(1, 255))
        config.id, config.cf, config.useV2 = draw.randrange(255), host, True
        fields = [config.id]
        for place in range(count):
            kind, ident = draw.choice(names), draw.randrange(60000)
            host.toc.add_element(Element(ident, "group", f"name{place}"))
            config.variables.append(LogVariable(f"group.name{place}", LogTocElement.types[kind][0]))
            config.variables[-1].stored_as = kind
            fields += [kind, ident]
        config.create()
        show("create_block", fields, host)
        config.added = True
        config.start()
        show("start_block", [config.id, config.period], host)
    host = Host(7)
    Log(host).reset()
    show("reset_logging", [], host)


if __name__ == "__main__":
    draw = random.Random(7)
    setpoints(draw)
    poses(draw)
    services()
    tables(draw)
    parameters()
    log_blocks(draw)
