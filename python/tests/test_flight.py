"""Flights: the same as those of the program, with columns, figures, files and errors."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import oqtal
from oqtal.flight import WORDS


def test_a_flight_equals_that_of_the_program(run, square, tmp_path: Path):
    run("fly", "--clock", "in-process", "--seed", 7, "--out", "flown")
    summary = json.loads((tmp_path / "flown/summary.json").read_text())
    for entry in ("speed_factor", "revision"):
        summary.pop(entry)
    ours = {name: value for name, value in square.summary.items() if name in summary}
    assert ours == summary
    flown = oqtal.Flight.read(tmp_path / "flown/telemetry.csv")
    assert list(flown.columns) == list(square.columns)
    for name, values in square.columns.items():
        np.testing.assert_array_equal(values, flown[name], name)
    square.save(tmp_path / "ours.csv")
    assert (tmp_path / "ours.csv").read_bytes() == (tmp_path / "flown/telemetry.csv").read_bytes()


def test_figures_follow_from_the_columns(square):
    scored = square.columns["scored"] == 1
    mean = square.position_error()[scored].mean()
    assert square.summary["outcome"] == "landed"
    assert mean == pytest.approx(square.summary["position_error_m"]["mean"], abs=1e-12)
    assert square.vector("true_{}_m").shape == (len(scored), 3)
    assert np.linalg.norm(square.vector("true_q{}"), axis=1) == pytest.approx(1.0)
    assert square["tick"].dtype == np.int64 and set(square["phase"]) >= {"take-off", "landing"}


def test_a_vector_has_braces_for_its_axis(square):
    assert square.vector("true_{}_m").shape == (len(square["t_s"]), 3)
    with pytest.raises(oqtal.UsageError, match="braces"):
        square.vector("true_x_m")


def test_a_crash_is_shown_with_its_reason():
    crashed = oqtal.fly(trajectory="hover", plant={"mass_kg": 0.9})
    assert crashed.summary["outcome"] != "landed" and crashed.summary["shortfall"] in repr(crashed)


def test_arguments_are_settings(square):
    flown = oqtal.fly(
        {"vehicle": {"mass-kg": 0.55}, "control.controller": "pid"},
        trajectory="hover",
        duration=3,
        plant={"rate_lag_ms": 60.0},
        settings={"mocap": {"preset": "ideal"}},
        disturb="force@4+1=0.05,0,0N",
        faults=["pose:off@5+0.05"],
    )
    lines = [line.split(" = ") for line in flown.config.splitlines() if " = " in line]
    assert ["mass-kg", "0.55"] in lines and ["rate-lag-ms", "60.0"] in lines
    assert flown.summary["controller"] == "pid"
    assert [fault["from_s"] for fault in flown.summary["faults"]] == [5.0]
    assert [load["from_s"] for load in flown.summary["disturbances"]] == [4.0]
    other = oqtal.fly(seed=8)
    assert other.summary["trajectory_hash"] != square.summary["trajectory_hash"]


@pytest.mark.parametrize(
    ("arguments", "exception", "words"),
    [
        ({"controller": "nobody"}, oqtal.ConfigError, ["controller", "nobody", "oqtal-dt"]),
        ({"settings": {"vehicle.mas-kg": 1}}, oqtal.ConfigError, ["vehicle.mas-kg", "mass-kg"]),
        ({"settings": {"vehicle.mass-kg": -1}}, oqtal.ConfigError, ["mass-kg", "-1"]),
        ({"settings": {"vehicle.mass-kg": object()}}, oqtal.UsageError, ["mass-kg", "object"]),
        ({"settings": {3: 1}}, oqtal.UsageError, ["3"]),
        ({"config": "nothing.toml"}, oqtal.ConfigError, ["nothing.toml"]),
        ({"faults": "pose:gone@1"}, oqtal.ConfigError, ["pose:gone@1"]),
        ({"trajectory": "waypoints"}, oqtal.ConfigError, ["waypoints"]),
    ],
)
def test_errors_name_object_and_remedy(arguments, exception, words):
    with pytest.raises(exception) as raised:
        oqtal.fly(**arguments)
    assert isinstance(raised.value, oqtal.OqtalError)
    assert all(word in str(raised.value) for word in words), raised.value


def test_recordings_are_of_the_same_flight(square, run, tmp_path: Path):
    path = square.save(tmp_path / "square.mcap")
    again = oqtal.Flight.read(path)
    assert again.summary["trajectory_hash"] == square.summary["trajectory_hash"]
    assert not again.cut_off
    np.testing.assert_array_equal(again["true_x_m"], square["true_x_m"])
    again.save(tmp_path / "copy.mcap")
    assert (tmp_path / "copy.mcap").read_bytes() == path.read_bytes()
    page = again.report(tmp_path / "report.html").read_text()
    assert page.startswith("<!DOCTYPE html>") and "oqtal" in page
    assert json.loads(run("report", path, "--json"))["trajectory_hash"] == again.summary["trajectory_hash"]
    recorded = oqtal.fly(seed=7, record=tmp_path / "while-flying.mcap")
    assert recorded.summary["trajectory_hash"] == square.summary["trajectory_hash"]


def test_files_that_are_no_flights_are_refused(tmp_path: Path, square):
    (tmp_path / "text.mcap").write_text("no recording")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    for path in ("text.mcap", "other.csv", "nothing.mcap", "nothing.csv"):
        with pytest.raises(oqtal.DataError, match=path):
            oqtal.Flight.read(tmp_path / path)
    with pytest.raises(oqtal.UsageError, match="suffix"):
        square.save(tmp_path / "flight.xls")
    with pytest.raises(oqtal.SystemFailure, match="nowhere"):
        square.save(tmp_path / "nowhere/flight.mcap")
    with pytest.raises(oqtal.SystemFailure, match="nowhere"):
        square.save(tmp_path / "nowhere/summary.json")
    telemetry = square.save(tmp_path / "telemetry.csv")
    (tmp_path / "cut.csv").write_text(telemetry.read_text()[:-9])
    with pytest.raises(oqtal.DataError, match=r"cut.csv:\d+: \d+ cells instead of \d+"):
        oqtal.Flight.read(tmp_path / "cut.csv")
    ticks = oqtal.Flight.read(tmp_path)
    with pytest.raises(oqtal.DataError, match="recording"):
        ticks.report(tmp_path / "report.html")


def test_a_recording_that_was_replaced_is_not_saved_as_the_one_that_was_read(tmp_path: Path, square):
    first = square.save(tmp_path / "flight.mcap")
    read = oqtal.Flight.read(first)
    oqtal.fly(trajectory="hover", duration=1).save(first)
    with pytest.raises(oqtal.DataError, match="another one now"):
        read.save(tmp_path / "copy.mcap")
    first.unlink()
    with pytest.raises(oqtal.SystemFailure, match=r"flight.mcap.* is gone"):
        read.save(tmp_path / "copy.mcap")


def test_a_cut_off_recording_is_read_as_far_as_it_goes(tmp_path: Path, square):
    whole = square.save(tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    cut = oqtal.Flight.read(tmp_path / "cut.mcap")
    assert cut.cut_off and 0 < len(cut["t_s"]) < len(square["t_s"])


def test_pandas_and_polars_have_the_columns(square, tmp_path: Path):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    ticks = square.to_pandas()
    square.save(tmp_path / "ticks.csv")
    read = pandas.read_csv(tmp_path / "ticks.csv")
    for name in ticks.columns:
        values = read[name].fillna("") if name in WORDS else read[name]
        np.testing.assert_array_equal(ticks[name].to_numpy(), values.to_numpy(), name)
    assert isinstance(square.to_polars(), polars.DataFrame) and square.to_polars().columns == list(ticks.columns)


def test_a_flight_is_drawn(square):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    assert len(square.plot().axes) == 4


def test_flights_run_beside_other_threads():
    beats = []

    def beat():
        while not over.wait(0.002):
            beats.append(time.monotonic())

    over, thread = threading.Event(), None
    thread = threading.Thread(target=beat)
    thread.start()
    for seed in range(3):
        oqtal.fly(seed=seed)
    over.set()
    thread.join()
    assert len(beats) > 10


CALLS = {
    "fly": "[oqtal.fly(trajectory='hover', duration=100) for _ in range(10**6)]",
    "campaign": "oqtal.campaign(['oqtal', 'mpc'], runs=100000)",
    # A flight of a week, and plants whose drawing takes minutes: neither is waited for.
    "flight": "oqtal.campaign(['pid'], 'long.toml')",
    "drawing": "oqtal.robustness(config=['long.toml'] * 2000, runs=10000)",
    "tune": "oqtal.tune('mpc', budget=100000)",
}


@pytest.mark.parametrize("call", CALLS)
def test_ctrl_c_ends_every_call(call, tmp_path: Path):
    (tmp_path / "long.toml").write_text(
        "trajectory.kind = 'hover'\ntrajectory.hover.duration-s = 604800.0\nplant.battery.capacity-ah = 1000.0\n"
    )
    command = [sys.executable, "-c", f"import oqtal\nprint('begun', flush=True)\n{CALLS[call]}"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.5)
    os.kill(process.pid, signal.SIGINT)
    try:
        _, told = process.communicate(timeout=60)
    finally:
        process.kill()
    assert "KeyboardInterrupt" in told and process.returncode != 0


def test_the_library_prints_nothing(capfd):
    oqtal.fly(seed=1)
    oqtal.campaign(["pid"], runs=1)
    with pytest.raises(oqtal.ConfigError):
        oqtal.fly(controller="nobody")
    assert capfd.readouterr() == ("", "")


def test_studies_fly_after_a_fork():
    # A fork leaves the threads of a pool behind.
    code = (
        "import os, oqtal\n"
        "oqtal.campaign(['pid'], runs=2)\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    os._exit(0 if oqtal.campaign(['pid'], runs=2).rows == 2 else 1)\n"
        "raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True, timeout=120)


def test_dictionary_of_the_columns(square):
    with (Path(__file__).parents[2] / "observe/src/csv/columns.md").open() as lines:
        cells = [row[1] for row in csv.reader(lines, delimiter="|") if len(row) > 2]
    names = [name.strip("`") for cell in cells[2:] for name in cell.split()]
    assert names == list(square.columns)


def test_exports_for_matlab_have_the_columns(square, run, tmp_path: Path):
    matlab = pytest.importorskip("scipy.io")
    square.save(tmp_path / "square.mcap")
    for form in ("csv", "mat"):
        run("export", "square.mcap", "--format", form)
    ticks = matlab.loadmat(tmp_path / "square-mat/ticks.mat")
    for name, values in square.columns.items():
        found = ticks[name]
        if name in WORDS:
            assert [word.rstrip() for word in found] == list(values)
        else:
            np.testing.assert_array_equal(found[:, 0], values, name)
    for table in (tmp_path / "square-csv").glob("*.csv"):
        with table.open(newline="") as lines:
            names, *rows = csv.reader(lines)
        found = matlab.loadmat(tmp_path / "square-mat" / f"{table.stem}.mat")
        for name, cells in zip(names, zip(*rows, strict=True), strict=True):
            assert name.isidentifier() and len(name) < 64
            values = found[name]
            if values.dtype.kind == "U":
                assert [text.rstrip() for text in values] == list(cells)
            elif values.dtype.kind == "f":
                np.testing.assert_array_equal(values[:, 0], [float(cell or "nan") for cell in cells], name)
            else:
                assert values.dtype == (np.int64 if name.endswith("_ns") else np.uint64)
                assert list(map(str, values[:, 0])) == list(cells), name


def test_a_short_flight_and_bare_telemetry_are_shown(square, tmp_path):
    assert "no tick is scored" in repr(oqtal.fly(trajectory="hover", duration=5))
    file = square.save(tmp_path / "ticks.csv")
    assert "without summary.json" in repr(oqtal.Flight.read(file))
    for _ in range(2):
        recording = square.save(tmp_path / "flight.mcap")
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".csv"] == ["flight.mcap"]
    assert repr(oqtal.Flight.read(recording)) == repr(square)
    assert "further columns" in repr(square.columns)


def test_a_flight_that_lands_early_says_why():
    flight = oqtal.fly(trajectory="hover", plant={"battery.capacity-ah": 0.05})
    assert "landed (" in repr(flight) and "battery low)" in repr(flight)


def test_a_vehicle_is_identified_from_the_path_of_a_recording(tmp_path):
    recording = oqtal.fly(trajectory="circle", duration=12).save(tmp_path / "circle.mcap")
    table = oqtal.identify(recording, mass=0.5).table
    (yaw,) = np.flatnonzero(table["name"] == "full stick, yaw")
    assert table["missing"][yaw] == "a swing of the heading"
