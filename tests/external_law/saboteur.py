"""The example law, which fails from a random instant of the flight on: saboteur.py PD_DIRECTORY SOCKET FAILURE SEED"""

import importlib.util
import math
import random
import socket
import sys
import time


def failed(failure, pd, state, since_s, draw):
    """Sequence, rates and thrust of the answers to a question, `since_s` [s] after the failure."""
    rate, thrust = pd.command(state)
    sequence, most = state["sequence"], state["greatest_rate"]
    size, direction = draw
    limited = lambda rates: [pd.limited(r, limit) for r, limit in zip(rates, most)]
    match failure:
        case "raises":
            raise RuntimeError("the law fails")
        case "sleeps" if since_s % 3 < 0.02:
            time.sleep(1)
        case "not-a-number":
            thrust = math.nan
        case "wrong-sign":
            rate = limited(-(1 + size) * r for r in rate)
        case "full-stick":
            rate = [math.copysign(limit, d) for d, limit in zip(direction, most)]
        case "diverging-gain":
            rate = limited(r * math.exp(since_s * (0.3 + 2 * size)) for r in rate)
        case "constant-bias":
            rate = limited(r + size * d * limit for r, d, limit in zip(rate, direction, most))
        case "last-question":
            sequence -= 1
        case "answers-twice":
            return [(sequence, rate, thrust)] * 2
    return [(sequence, rate, thrust)]


def main(directory, path, failure, seed):
    spec = importlib.util.spec_from_file_location("pd", f"{directory}/pd.py")
    pd = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(pd)
    draws = random.Random(seed)
    from_s, size = draws.uniform(2.5, 8), draws.uniform(0.1, 1)
    direction = [draws.uniform(-1, 1) for _ in range(3)]
    answered = 0
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as daemon:
        daemon.connect(path)
        while packet := daemon.recv(4096):
            state = pd.fields(packet)
            since_s = answered * state["period_s"] - from_s
            kind = failure if since_s >= 0 else "none"
            for sequence, rate, thrust in failed(kind, pd, state, since_s, (size, direction)):
                daemon.send(pd.ANSWER.pack(b"OQTALEX1", sequence, *rate, 0, 0, 0, 0, 0, 0, 0, thrust))
            answered += 1


main(*sys.argv[1:])
