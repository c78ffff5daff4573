"""MAVLink 2 as pymavlink reads and writes it.

Standard input: one packet in hexadecimal digits per line, of which those that begin with `signed ` must carry a valid signature.
For each, prints a JSON object with the name of the message, sender and fields. Then prints packets that pymavlink encoded, as a vehicle and
as a ground station, with `"bytes"` in place of a sender.

Run by wire/tests/mavlink_peer.rs, with a Python interpreter that has requirements.txt installed.
"""

import json
import math
import sys

from pymavlink.dialects.v20 import ardupilotmega as dialect

KEY = bytes([0x0F] * 32)


def plain(value):
    """A value that JSON can say."""
    if isinstance(value, (list, tuple)):
        return [plain(element) for element in value]
    if isinstance(value, bytes):
        return value.rstrip(b"\0").decode("ascii")
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def show(message, **more):
    fields = {name: plain(getattr(message, name)) for name in message.get_fieldnames()}
    print(json.dumps({"name": message.get_type(), "fields": fields, **more}))


def read():
    for line in sys.stdin:
        words = line.split()
        parser = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        if words[0] == "signed":
            parser.signing.secret_key = KEY
            parser.signing.allow_unsigned_callback = lambda *_: False
        messages = parser.parse_buffer(bytes.fromhex(words[-1]))
        assert messages and len(messages) == 1, line
        message = messages[0]
        assert message.get_type() != "BAD_DATA", line
        if words[0] == "signed":
            assert message.get_signed(), line
        show(message, sender=[message.get_srcSystem(), message.get_srcComponent()])


def write():
    vehicle = dialect.MAVLink(None, srcSystem=7, srcComponent=1)
    station = dialect.MAVLink(None, srcSystem=255, srcComponent=190)

    def send(peer, message):
        show(message, bytes=message.pack(peer).hex())

    quad, ardupilot, px4 = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_PX4
    send(vehicle, dialect.MAVLink_heartbeat_message(quad, ardupilot, 0x81, 20, 4, 3))
    send(vehicle, dialect.MAVLink_heartbeat_message(quad, px4, 0x1D, 0x60000, 3, 3))
    send(vehicle, dialect.MAVLink_sys_status_message(0x2F, 0x2F, 0x2F, 300, 11100, -1, 50, 0, 0, 0, 0, 0, 0))
    send(vehicle, dialect.MAVLink_sys_status_message(0x2F, 0x2F, 0x2F, 300, 65535, -1, -1, 0, 0, 0, 0, 0, 0))
    send(vehicle, dialect.MAVLink_timesync_message(0, 123456789))
    send(vehicle, dialect.MAVLink_timesync_message(5, 6))
    half = math.sqrt(0.5)
    send(vehicle, dialect.MAVLink_attitude_quaternion_message(1000, half, 0.0, 0.0, half, 0.1, 0.2, 0.3))
    send(vehicle, dialect.MAVLink_local_position_ned_message(1000, 1.0, 2.0, -3.0, 0.5, 0.25, -0.125))
    send(vehicle, dialect.MAVLink_estimator_status_message(1, 383, 0, 0, 0, 0, 0, 0, 0, 0))
    send(vehicle, dialect.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, 0.1, 0.1))
    send(vehicle, dialect.MAVLink_statustext_message(2, b"PreArm: Gyros inconsistent"))
    send(vehicle, dialect.MAVLink_statustext_message(6, b"EKF3 IMU0 is using external nav data"))
    send(vehicle, dialect.MAVLink_command_ack_message(400, 4))
    send(vehicle, dialect.MAVLink_command_ack_message(176, 0))
    send(vehicle, dialect.MAVLink_param_value_message(b"GUID_OPTIONS", 8.0, 6, 1200, 65535))
    send(vehicle, dialect.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
    send(station, dialect.MAVLink_command_long_message(7, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    send(station, dialect.MAVLink_command_long_message(7, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0))
    send(station, dialect.MAVLink_command_long_message(7, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0))
    send(station, dialect.MAVLink_command_long_message(7, 1, 511, 2, 31, 50000, 0, 0, 0, 0, 0))
    send(station, dialect.MAVLink_param_request_read_message(7, 1, b"EK3_SRC1_POSXY", -1))
    send(station, dialect.MAVLink_param_set_message(7, 1, b"EK3_SRC1_POSXY", 6.0, 2))
    send(
        station,
        dialect.MAVLink_set_attitude_target_message(1000, 7, 1, 128, [1, 0, 0, 0], 0.1, 0.2, 0.3, 0.5),
    )


read()
write()
