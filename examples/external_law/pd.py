"""PD of the position and P of the attitude, for vehicles commanded by body rates. Python's standard library alone.

    python3 pd.py /run/oqtal/default/law
"""

import math
import socket
import struct
import sys
import time

STATE = struct.Struct("<8s6Q59d")
ANSWER = struct.Struct("<8sQ11d")
LENGTHS = {"period_s": 1, "position": 3, "velocity": 3, "attitude": 4, "rate": 3, "thrust": 1, "acceleration_bias": 3,
           "demand_bias": 3, "reference_position": 3, "reference_velocity": 3, "reference_yaw": 1, "reference_attitude": 4,
           "reference_rate": 3, "fallback_rate": 3, "fallback_torque": 3, "fallback_attitude": 4, "fallback_thrust": 1,
           "mass": 1, "gravity": 1, "greatest_thrust": 1, "greatest_rate": 3, "greatest_torque": 1, "reference_acceleration": 3,
           "reference_jerk": 3}


def fields(packet):
    """The numbers of a question by name: a float, or a tuple of them."""
    magic, sequence, flight, flown, now, acts_at, answer_by, *numbers = STATE.unpack(packet)
    if magic != b"OQTALST1":
        raise struct.error(f"a question that begins with {magic!r}")
    state = {"sequence": sequence, "flight": flight, "flown": flown}
    for name, length in LENGTHS.items():
        state[name] = numbers[0] if length == 1 else tuple(numbers[:length])
        del numbers[:length]
    return state


def limited(value, limit):
    return max(-limit, min(limit, value))


def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def command(s):
    """Rates [rad/s, body axes] and thrust [N]."""
    off = [r - p for r, p in zip(s["reference_position"], s["position"])]
    slip = [r - v for r, v in zip(s["reference_velocity"], s["velocity"])]
    x, y, z = (4.0 * p + 3.2 * v for p, v in zip(off, slip))
    share = min(1.0, 2.6 / max(math.hypot(x, y), 1e-9))
    wanted = (share * x, share * y, limited(z, 4.0) + s["gravity"])
    force = [s["mass"] * (a - bias) for a, bias in zip(wanted, s["acceleration_bias"])]
    qx, qy, qz, qw = s["attitude"]
    axis = (-qx, -qy, -qz)
    once = [2.0 * t for t in cross(axis, force)]
    up = [f + qw * t + u for f, t, u in zip(force, once, cross(axis, once))]
    norm = math.hypot(*up)
    yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
    turn = (-up[1] / norm, up[0] / norm, math.remainder(s["reference_yaw"] - yaw, math.tau))
    rates = (8.0 * t - bias for t, bias in zip(turn, s["demand_bias"]))
    rate = [limited(r, most) for r, most in zip(rates, s["greatest_rate"])]
    return rate, max(0.0, min(s["greatest_thrust"], up[2]))


def main(path):
    durations = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as daemon:
        daemon.connect(path)
        while packet := daemon.recv(4096):
            began = time.perf_counter_ns()
            state = fields(packet)
            rate, thrust = command(state)
            daemon.send(ANSWER.pack(b"OQTALEX1", state["sequence"], *rate, 0, 0, 0, 0, 0, 0, 0, thrust))
            durations.append((time.perf_counter_ns() - began) / 1000)
    if not durations:
        sys.exit(f"{path}: closed before the first question: end another law at this socket, or start the daemon again")
    durations.sort()
    p50, p99 = (durations[int(share * (len(durations) - 1))] for share in (0.5, 0.99))
    print(f"{len(durations)} answers, computed in {p50:.0f} us (p50), {p99:.0f} us (p99)")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("give the socket on which the daemon expects a law: python3 pd.py /run/oqtal/default/law")
    try:
        main(sys.argv[1])
    except (OSError, struct.error) as error:
        sys.exit(f"{sys.argv[1]}: {error}; give the socket `law` of an instance whose daemon of this version runs")
    except KeyboardInterrupt:
        sys.exit(130)
