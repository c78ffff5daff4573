"""A running instance: commands, references and observation of a flight in real time."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import programs

import oqtal

#: Longest wait for an event [s]; a test that waits longer has failed.
TIMEOUT = 60.0
SERVICES = ("plant-sim", "mocap-emu", "daemon")


def wait_for(condition: Callable[[], bool], what: str) -> None:
    give_up = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < give_up, what
        time.sleep(0.05)


def connected(place: dict[str, str]) -> oqtal.Instance:
    """The instance once its daemon answers."""
    give_up = time.monotonic() + TIMEOUT
    while True:
        try:
            return oqtal.connect(**place)
        except oqtal.PeerError:
            assert time.monotonic() < give_up
            time.sleep(0.1)


def arm(instance: oqtal.Instance) -> None:
    """Arms as soon as the daemon has had enough poses for it."""

    def begins() -> bool:
        with contextlib.suppress(oqtal.FlightError):
            return "the flight has begun" in instance.arm()
        return False

    wait_for(begins, "arming is refused")


@contextlib.contextmanager
def running(program: str, directory: Path, *settings: str) -> Iterator[dict[str, str]]:
    """Name and root of an instance whose processes run in real time until the end of the block."""
    place = {"instance": f"python-{os.getpid()}", "root": str(directory / "run")}
    words = ["--instance", place["instance"], "--root", place["root"]]
    for setting in ("trajectory.kind=hover", "trajectory.duration-s=600", *settings):
        words += ["--set", setting]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    processes = [subprocess.Popen([program, service, "run", *words], **quiet) for service in SERVICES]
    try:
        connected(place)
        yield place
        assert [process.poll() for process in processes] == [None] * 3
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(timeout=TIMEOUT)


@pytest.fixture(scope="module")
def place(program: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    with running(program, tmp_path_factory.mktemp("instance")) as place:
        yield place


@pytest.fixture
def instance(place: dict[str, str]) -> oqtal.Instance:
    return connected(place)


@pytest.fixture
def flying(instance: oqtal.Instance) -> oqtal.Instance:
    """The instance in flight, after its take-off."""

    def hovers() -> bool:
        with contextlib.suppress(oqtal.FlightError):
            return "hover" in instance.hover()
        return False

    if instance.status()["mode"] != "flying":
        arm(instance)
    wait_for(hovers, "no take-off")
    return instance


def child(code: str, place: dict[str, str]) -> subprocess.Popen[str]:
    code = f"import oqtal, os\ninstance = oqtal.connect(**{place!r})\n{textwrap.dedent(code)}"
    return subprocess.Popen([sys.executable, "-W", "ignore", "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_an_instance_without_a_daemon_is_refused(tmp_path: Path):
    with pytest.raises(oqtal.PeerError, match=r"no daemon answers on instance `nobody`.*oqtal daemon run"):
        oqtal.connect("nobody", root=str(tmp_path))
    assert not list(tmp_path.iterdir())
    with pytest.raises(oqtal.UsageError, match="a-z, 0-9"):
        oqtal.connect("No Name", root=str(tmp_path))


def test_status_and_settings(instance):
    status = instance.status()
    assert status["mode"] == "disarmed" and {process["name"] for process in status["processes"]} >= set(SERVICES)
    before = instance.get("position.tilt-limit-deg")
    assert isinstance(before, float)
    instance.set({"position": {"tilt_limit_deg": before - 1}})
    assert instance.get("position.tilt-limit-deg") == before - 1
    instance.undo()
    assert instance.get("position.tilt-limit-deg") == before
    with pytest.raises(oqtal.FlightError, match=r"set refused.*tilt-limit-deg"):
        instance.set({"position.tilt-limit-deg": -1})
    with pytest.raises(oqtal.FlightError, match="nothing"):
        instance.get("nothing.at-all")
    with pytest.raises(oqtal.FlightError, match="goto refused"):
        instance.goto(0, 0, 1)
    with pytest.raises(oqtal.UsageError, match=r"yaw is 90 rad.*math\.radians\(90\)"):
        instance.goto(0, 0, 1, yaw=90)


def test_topics_are_iterators_and_frames(instance):
    pandas = pytest.importorskip("pandas")
    poses = instance.poses(seconds=1.0).to_pandas()
    assert isinstance(poses, pandas.DataFrame) and len(poses) > 20
    # Messages wait for a reader that comes after the end.
    late = instance.poses(seconds=0.5)
    time.sleep(1.0)
    assert 10 < len(list(late)) < 40
    assert set(poses["tracked"]) == {1} and poses["captured_at_ns"].is_monotonic_increasing
    assert poses[["position_m_x", "position_m_y", "position_m_z"]].abs().max().max() < 0.1
    with instance.telemetry() as ticks:
        numbers = [next(ticks)["tick"] for _ in range(20)]
    assert (np.diff(numbers) == 1).all() and ticks.lost == 0
    with pytest.raises(oqtal.UsageError, match="telemetry"):
        instance.observe("nothing")
    with pytest.raises(oqtal.PeerError, match="no message of reference for 0.3 s"):
        list(instance.observe("reference", timeout=0.3))
    with pytest.raises(oqtal.PeerError, match="no message of reference"):
        instance.observe("reference", seconds=0.8).table()
    closed = instance.events()
    threading.Timer(0.2, closed.close).start()
    assert all("event" in row for row in closed)


def test_a_flight_is_commanded(flying):
    events = flying.events()
    assert "goto" in flying.goto(0.3, -0.2, 1.2, yaw=0.5)
    ticks = flying.telemetry(seconds=TIMEOUT)
    wanted = [0.3, -0.2, 1.2]
    assert any(np.linalg.norm([tick[f"position_m_{axis}"] for axis in "xyz"] - np.array(wanted)) < 0.1 for tick in ticks)
    ticks.close()
    assert "land" in flying.land()
    wait_for(lambda: flying.status()["mode"] == "disarmed", "no landing")
    texts = []
    for event in events:
        texts.append(event["event"])
        if "motors off" in texts[-1]:
            break
    assert any("goto 0.30 -0.20 1.20 29° (Python" in text for text in texts), texts
    assert any("land" in text for text in texts)
    assert "motors commanded off" in flying.disarm()


def test_the_program_of_the_document_commands_an_instance(flying, place, monkeypatch):
    pytest.importorskip("pandas")
    (program,) = (block for block in programs("docs/python.md") if "oqtal.connect" in block)
    monkeypatch.setenv("OQTAL_INSTANCE__NAME", place["instance"])
    monkeypatch.setenv("OQTAL_INSTANCE__ROOT", place["root"])
    names: dict = {"oqtal": oqtal}
    exec(compile(program, "docs/python.md", "exec"), names)
    assert len(names["poses"]) > 60
    wait_for(lambda: flying.status()["mode"] == "disarmed", "no landing")


def test_references_are_flown_and_a_killed_process_hinders_nobody(flying, place):
    streaming = """
        for count, tick in enumerate(instance.telemetry()):
            instance.reference([0.4, 0.0, 1.0], valid=0.5)
            if count == 30:
                print("streams", flush=True)
    """
    process = child(streaming, place)
    assert process.stdout.readline() == "streams\n", process.stderr.read()
    with pytest.raises(oqtal.PeerError, match="`reference` .* is held by"):
        flying.reference([0.0, 0.0, 1.0])
    process.kill()
    process.wait(timeout=TIMEOUT)
    flying.reference([0.2, 0.0, 1.0], valid=0.5)
    observations = [flying.telemetry() for _ in range(4)]
    assert all(next(observation)["mode"] == next(observations[0])["mode"] for observation in observations)
    with pytest.raises(oqtal.PeerError, match=r"`telemetry` has 4 observers"):
        flying.telemetry()
    for observation in observations:
        observation.close()
    assert flying.status()["mode"] == "flying"
    with pytest.raises(oqtal.UsageError, match="position has 2 numbers"):
        flying.reference([0.0, 1.0])
    with pytest.raises(oqtal.UsageError, match="yaw and yaw_rate .* finite"):
        flying.reference([0.0, 0.0, 1.0], yaw=float("nan"))


def test_a_planner_learns_that_the_daemon_is_silent(program, tmp_path):
    with running(program, tmp_path) as place:
        instance = connected(place)
        instance.reference([0.0, 0.0, 1.0])
        daemon = next(process["heard"]["pid"] for process in instance.status()["processes"] if process["name"] == "daemon")
        os.kill(daemon, signal.SIGSTOP)

        def stream():
            for _ in range(int(TIMEOUT / 0.02)):
                instance.reference([0.0, 0.0, 1.0])
                time.sleep(0.02)

        try:
            with pytest.raises(oqtal.PeerError, match="the daemon is silent"):
                stream()
        finally:
            os.kill(daemon, signal.SIGCONT)


def test_a_stop_reaches_the_vehicle_in_flight(flying):
    assert "stopped: motors off" in flying.stop()
    status = flying.status()
    assert status["mode"] == "disarmed" and status["state"] == "Stop"
    # Waits until the vehicle has fallen and is at rest.
    assert "the flight has begun" in flying.arm()
    flying.land()
    wait_for(lambda: flying.status()["mode"] == "disarmed", "no landing")


def test_ctrl_c_ends_observation_and_arming(instance, place):
    process = child("print('observes', flush=True)\nlist(instance.events())", place)
    assert process.stdout.readline() == "observes\n"
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=TIMEOUT)
    assert "KeyboardInterrupt" in told and process.returncode != 0
    assert instance.status()["mode"] == "disarmed"


def test_a_forked_process_is_refused(instance, place):
    code = """
        if os.fork() == 0:
            for call in (instance.status, lambda: oqtal.connect(instance.name), instance.telemetry):
                try:
                    call()
                    os._exit(2)
                except oqtal.UsageError as error:
                    assert "spawn" in str(error)
            os._exit(0)
        raise SystemExit(os.waitstatus_to_exitcode(os.wait()[1]))
    """
    process = child(code, place)
    _, told = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, told
    assert instance.status()["mode"] == "disarmed"


def test_nothing_is_printed(instance, capfd):
    instance.status()
    list(instance.poses(seconds=0.1))
    with pytest.raises(oqtal.FlightError):
        instance.goto(0, 0, 1)
    assert capfd.readouterr() == ("", "")


#: Actions of laws that have flown for a while, and what their process then says; empty for one that goes on.
SABOTAGE = {
    "raises": ("raise ZeroDivisionError", "LawError: the law raised ZeroDivisionError"),
    "hangs": ("while True: pass", ""),
    "returns another shape": ("return [0, 0], 5.0", "LawError: rate of the law's command has the shape (2,)"),
    "returns another type": ("return 'rates', 'thrust'", "LawError: rate of the law's command is 'rates'"),
    "returns no number": ("return [0, 0, float('nan')], 5.0", "LawError: rate of the law's command is [ 0.  0. nan]"),
    "writes its inputs": ("state.position[:] = 0", "LawError: the law raised ValueError"),
    "closes every file but stderr": ("os.closerange(0, 2); os.closerange(3, 64)", "Bad file descriptor"),
    "exits": ("sys.exit('bye')", "bye"),
    "overturns the vehicle": ("return [9, 0, 0], 20.0", ""),
}

LAW = """
import os, sys, oqtal
flown = 0

def law(state, reference, dt):
    global flown
    flown += state.flown
    if flown > 20:
        {deed}
    return state.fallback_rate, state.fallback_thrust

oqtal.serve(law, {path!r})
"""


def test_laws_that_fail_in_flight_hand_over_to_the_trusted_law(program, tmp_path):
    # A machine with other work must not make a good law late.
    patient = ("external.budget-us=8000", "external.return-answers=10")
    with running(program, tmp_path, "control.controller=external", *patient) as place:
        instance, path = connected(place), str(tmp_path / "run" / place["instance"] / "law")
        arm(instance)
        wait_for(lambda: instance.status()["mode"] == "flying", "no take-off")
        for name, (deed, words) in SABOTAGE.items():
            program = [sys.executable, "-W", "ignore", "-c", LAW.format(deed=deed, path=path)]
            with instance.telemetry(seconds=TIMEOUT) as ticks:
                law = subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
                has_flown, taken_over = False, False
                for tick in ticks:
                    has_flown |= tick["fallback"] == 0
                    taken_over = has_flown and tick["fallback"] != 0
                    if taken_over:
                        break
            if not words:
                law.kill()
            _, told = law.communicate(timeout=TIMEOUT)
            assert taken_over and words in told, f"a law that {name}: {told}"
        assert instance.status()["mode"] == "flying"
        instance.land()
        wait_for(lambda: instance.status()["mode"] == "disarmed", "no landing")
