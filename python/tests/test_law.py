"""Laws in Python: they fly, repeat bit for bit, and fail with clear exceptions."""

from __future__ import annotations

import json
import subprocess
import time

import numpy as np
import pytest

import oqtal


class Pd:
    """PD of the position and P of the attitude."""

    def __init__(self) -> None:
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def step(self, state, reference, dt):
        wanted = 4.0 * (reference.position - state.position) + 3.2 * (reference.velocity - state.velocity)
        wanted[:2] *= min(1.0, 2.6 / max(np.hypot(*wanted[:2]), 1e-9))
        wanted[2] = np.clip(wanted[2], -4.0, 4.0) + state.gravity
        force = state.to_body(state.mass * (wanted - state.acceleration_bias))
        yaw = np.remainder(reference.yaw - state.yaw + np.pi, 2 * np.pi) - np.pi
        turn = np.array([-force[1], force[0], 0.0]) / np.linalg.norm(force) + [0.0, 0.0, yaw]
        return 8.0 * turn - state.demand_bias, force[2]


def plain(state, reference, dt):
    return Pd().step(state, reference, dt)


@pytest.fixture(scope="module")
def flown() -> oqtal.Flight:
    return oqtal.fly(law=Pd, seed=3)


def test_a_law_in_python_flies(flown):
    assert flown.summary["outcome"] == "landed"
    assert flown.summary["controller"] == "external"
    assert flown.summary["position_error_m"]["mean"] < 0.5


def test_a_law_is_a_class_an_object_or_a_function(flown):
    law = Pd()
    again = [oqtal.fly(law=law, seed=3), oqtal.fly(law=plain, seed=3), oqtal.fly(law=plain, seed=4)]
    hashes = [flight.summary["trajectory_hash"] for flight in again]
    assert hashes[0] == hashes[1] == flown.summary["trajectory_hash"]
    assert hashes[2] != hashes[0]
    assert law.resets == 1


def test_its_recording_has_the_same_flight(flown, tmp_path):
    recorded = oqtal.Flight.read(flown.save(tmp_path / "flight.mcap"))
    assert recorded.summary["trajectory_hash"] == flown.summary["trajectory_hash"]


def test_it_flies_alike_as_a_process_beside_a_daemon(program, tmp_path):
    words = ["fly", "--controller", "external", "--trajectory", "hover", "--duration", "6", "--seed", "3"]
    words += ["--clock", "lockstep", "--root", tmp_path / "run", "--out", tmp_path / "flight"]
    process = subprocess.Popen([program, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    socket = tmp_path / "run" / "default" / "law"
    while not socket.exists():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.01)
    assert oqtal.serve(Pd, str(socket)) > 300
    assert process.wait(timeout=60) == 0, process.stderr.read()
    summary = json.loads((tmp_path / "flight" / "summary.json").read_text())
    alone = oqtal.fly(law=Pd, seed=3, trajectory="hover", duration=6)
    assert summary["trajectory_hash"] == alone.summary["trajectory_hash"]


def returning(value):
    return lambda state, reference, dt: value


def raising(state, reference, dt):
    raise ZeroDivisionError("by hand")


def mutating(state, reference, dt):
    state.position[0] = 1.0
    return [0, 0, 0], 5.0


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (raising, ["ZeroDivisionError", "by hand"]),
        (mutating, ["ValueError", "read-only"]),
        (returning(None), ["None", "rates"]),
        (returning([1.0, 2.0, 3.0]), ["rates, thrust"]),
        (returning(([1.0, 2.0], 3.0)), ["rate", "(2,)", "(3,)"]),
        (returning((np.zeros((3, 1)), 3.0)), ["rate", "(3, 1)"]),
        (returning(([0.0, np.nan, 0.0], 3.0)), ["rate", "nan", "finite"]),
        (returning(([0.0, 0.0, 0.0], np.inf)), ["thrust", "inf", "finite"]),
        (returning((["a", "b", "c"], 3.0)), ["rate", "'a'", "3 numbers"]),
        (returning((np.array([1j, 0, 0]), 3.0)), ["rate"]),
        (returning(oqtal.Command([0, 0, 0], "much")), ["thrust", "much"]),
        (3, ["3", "step"]),
    ],
)
def test_a_law_that_fails_raises(law, words):
    with pytest.raises(oqtal.LawError) as raised:
        oqtal.fly(law=law, trajectory="hover")
    assert all(word in str(raised.value) for word in words), raised.value


def test_its_own_exception_is_the_cause():
    with pytest.raises(oqtal.LawError) as raised:
        oqtal.fly(law=raising)
    assert isinstance(raised.value.__cause__, ZeroDivisionError)


def test_numbers_out_of_range_are_limited():
    flight = oqtal.fly(law=returning(([100.0, 0, 0], 5.0)), trajectory="hover")
    assert flight.summary["outcome"] in ("landed", "stopped", "crashed")


def test_a_law_that_hangs_is_interrupted():
    import _thread
    import threading

    def hanging(state, reference, dt):
        while True:
            time.sleep(0.001)

    threading.Timer(0.5, _thread.interrupt_main).start()
    with pytest.raises(KeyboardInterrupt):
        oqtal.fly(law=hanging)
