"""Laws in Python: they fly, repeat bit for bit, and fail with clear exceptions."""

from __future__ import annotations

import itertools
import json
import os
import re
import socket
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import ROOT

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


@pytest.mark.parametrize("question", [b"OQTALST1" + bytes(512), b"OQTALST1" + bytes(528), b"OQTALST2" + bytes(520), b"?"])
def test_a_question_of_another_version_is_an_error(tmp_path, question):
    path = str(tmp_path / "law")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(path)
        listener.listen()
        with ThreadPoolExecutor() as pool:
            served = pool.submit(oqtal.serve, plain, path)
            daemon, _ = listener.accept()
            with daemon:
                daemon.send(question)
                with pytest.raises(oqtal.PeerError, match="another version"):
                    served.result(timeout=60)


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
        (returning(([1.0, 2.0], 3.0)), ["rate", "(2,)", "3 numbers"]),
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
    assert flight.limited > 0


def test_a_flight_that_the_law_did_not_fly_says_so():
    # An attitude is missing: no answer is flown, and no hand-over counted.
    law = returning(([0.0, 0, 0], 5.0))
    flight = oqtal.fly(law=law, trajectory="hover", duration=2, settings={"vehicle.interface": "attitude"})
    assert flight.summary["handovers"]["count"] == 0
    assert f"the fallback law flew {flight.summary['handovers']['fallback_ticks']} ticks" in repr(flight)


def test_a_law_that_flies_itself_is_refused():
    def itself(state, reference, dt):
        return oqtal.fly(law=itself, trajectory="hover", duration=1)

    with pytest.raises(oqtal.LawError, match="nested 8 times"):
        oqtal.fly(law=itself, trajectory="hover", duration=1)


def test_an_exception_without_a_text_is_told():
    class Mute(Exception):
        def __str__(self):
            raise ValueError("no text")

    def law(state, reference, dt):
        raise Mute

    with pytest.raises(oqtal.LawError, match="Mute"):
        oqtal.fly(law=law)


def test_a_law_that_hangs_is_interrupted():
    import _thread
    import threading

    def hanging(state, reference, dt):
        while True:
            time.sleep(0.001)

    threading.Timer(0.5, _thread.interrupt_main).start()
    with pytest.raises(KeyboardInterrupt):
        oqtal.fly(law=hanging)


def test_a_flight_ends_soon_after_its_law_raised():
    calls = []

    def failing(state, reference, dt):
        calls.append(state.time)
        if len(calls) == 100:
            raise ZeroDivisionError
        return plain(state, reference, dt)

    with pytest.raises(oqtal.LawError):
        oqtal.fly(law=failing, trajectory="hover", duration=100)
    assert len(calls) == 100


def test_a_law_sees_time_and_whether_it_flies():
    seen = []

    def watching(state, reference, dt):
        seen.append((state.time, state.flown, dt, state.period))
        return plain(state, reference, dt) if len(seen) != 50 else ([0, 0, 0], state.greatest_thrust)

    flight = oqtal.fly(law=watching, trajectory="hover", duration=5)
    times, flown, periods, same = (np.array(column) for column in zip(*seen, strict=True))
    assert np.diff(times) == pytest.approx(periods[1:], abs=1e-6) and (periods == same).all()
    assert flown.any() and not flown[0]
    assert flight.summary["outcome"] == "landed"


def test_a_law_is_given_acceleration_and_jerk_of_the_trajectory():
    seen = []

    def watching(state, reference, dt):
        seen.append([state.time, *reference.velocity, *reference.acceleration, *reference.jerk])
        return plain(state, reference, dt)

    flight = oqtal.fly(law=watching, trajectory="lemniscate", seed=3)
    time_s, derivatives = np.array(seen)[:, 0], np.split(np.array(seen)[:, 1:], 3, axis=1)
    # The middle of the trajectory: take-off and landing have derivatives that jump.
    middle = slice(len(seen) // 3, 2 * len(seen) // 3)
    for lower, upper in itertools.pairwise(derivatives):
        slopes = np.gradient(lower, time_s, axis=0)[middle]
        # The instants of effect jitter against those of the ticks, so that the slopes are not exact.
        assert np.abs(upper[middle] - slopes).mean() < 0.02 * np.abs(upper[middle]).max()
    assert flight.summary["outcome"] == "landed"


def test_a_reset_that_fails_raises():
    class Failing(Pd):
        def reset(self) -> None:
            raise ZeroDivisionError("by hand")

    with pytest.raises(oqtal.LawError, match="reset .*by hand"):
        oqtal.fly(law=Failing)


@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.int64, object])
def test_numbers_of_any_type_are_taken(dtype):
    command = np.array([0, 0, 0, 5]).astype(dtype)
    assert oqtal.fly(law=returning(command), trajectory="hover", duration=3).summary["controller"] == "external"


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_law_may_fork():
    children = []

    def forking(state, reference, dt):
        if len(children) < 3:
            children.append(os.fork())
            if children[-1] == 0:
                os._exit(0)
            os.waitpid(children[-1], 0)
        return plain(state, reference, dt)

    calm = oqtal.fly(law=plain, trajectory="hover", duration=3, seed=3)
    forked = oqtal.fly(law=forking, trajectory="hover", duration=3, seed=3)
    assert len(children) == 3 and forked.summary["trajectory_hash"] == calm.summary["trajectory_hash"]


def test_a_law_may_close_the_output():
    code = """
    import os, sys, oqtal

    def closing(state, reference, dt):
        for stream in (0, 1):
            try:
                os.close(stream)
            except OSError:
                pass
        return [0, 0, 0], state.mass * state.gravity

    flight = oqtal.fly(law=closing, trajectory="hover", duration=3)
    sys.stderr.write(flight.summary["controller"])
    os._exit(0)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True, timeout=120)
    assert done.stderr == "external" and not done.stdout


def learned_policy():
    """The policy of examples/learning.ipynb, by the program of the notebook."""
    notebook = json.loads((ROOT / "examples/learning.ipynb").read_text())
    sources = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    source = next(source for source in sources if "class Policy" in source)
    names = {"np": np}
    exec(source[source.index("class Policy") :], names)
    return names["Policy"](ROOT / "examples/hover_policy.npz")


def test_a_learned_policy_hovers_behind_the_trusted_law():
    assert (ROOT / "examples/hover_policy.npz").stat().st_size < 50_000
    for seed in (3, 4):
        flight = oqtal.fly(law=learned_policy(), trajectory="hover", seed=seed)
        assert flight.summary["outcome"] == "landed"
        assert flight.summary["position_error_m"]["mean"] < 0.05
        # It flies nearly all of the trajectory itself.
        assert flight.summary["handovers"]["fallback_ticks"] < 0.1 * (flight["scored"] == 1).sum()


def test_a_law_that_fails_leaves_its_flight_and_the_instant():
    asked = 0

    def law(state, reference, dt):
        nonlocal asked
        asked += 1
        return (state.fallback_rate * (np.nan if asked > 300 else 1), state.fallback_thrust)

    with pytest.raises(oqtal.LawError, match=r"rate of the law.*finite.*\(5\.\d\d s after the first question\)") as raised:
        oqtal.fly(law=law, trajectory="hover")
    assert 300 < raised.value.flight.columns.rows < 1000
    assert raised.value.flight.summary["shortfall"] == str(raised.value)


def test_the_computing_times_of_a_law_and_the_hand_overs_are_shown():
    flight = oqtal.fly(law=lambda state, reference, dt: (state.fallback_rate, 0.1), trajectory="hover", duration=10)
    assert flight.answer_s.min() > 0 and len(flight.answer_s) >= 60
    assert re.search(r"hand-overs: the fallback law flew \d+ ticks", repr(flight))


def test_states_and_references_show_their_fields():
    shown = []

    def law(state, reference, dt):
        shown.append(f"{state} {reference}")
        return (state.fallback_rate, np.array([state.fallback_thrust]))

    with pytest.raises(oqtal.LawError, match=r"thrust of the law's command has the shape \(1,\); expected a number"):
        oqtal.fly(law=law)
    assert re.search(r"State\(.*position=\[.*mass=0\.5.*\) Reference\(position=.*attitude=None", shown[0])
