"""Arguments: what is accepted, and errors that name the argument and the remedy."""

from __future__ import annotations

import copy
import json
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import oqtal
from oqtal import _native, paper

#: A short flight.
HOVER = {"trajectory": "hover", "duration": 2}


def test_integers_of_numpy_are_seeds():
    flown = [oqtal.fly(seed=seed, **HOVER).summary["trajectory_hash"] for seed in (3, np.int64(3), np.uint8(3))]
    assert len(set(flown)) == 1
    rows = oqtal.campaign(["pid"], seeds=np.arange(2))
    assert list(rows["seed"]) == [0, 1]


def test_what_begins_after_the_end_of_a_flight_is_warned_of_at_the_line_of_the_call():
    calls = {
        "mass@60=0.05kg": lambda load: oqtal.fly(disturb=load, **HOVER),
        "pose:off@60+1": lambda fault: oqtal.campaign(["pid"], trajectory="hover", runs=1, settings={"fault.inject": [fault]}),
    }
    for text, call in calls.items():
        with pytest.warns(UserWarning, match=rf"`{re.escape(text)}` begins 60 s after arming") as told:
            call(text)
        assert [warning.filename for warning in told] == [__file__]
        assert str(told[0].message).endswith("a longer flight with trajectory.duration-s")


def test_gains_of_another_vehicle_and_replaced_gains_are_warned_of(capfd):
    heavy = {"vehicle": {"mass_kg": 0.6}, "control": {"pid": {"gain": 3.0}}}
    with pytest.warns(UserWarning, match="gains") as issued:
        oqtal.robustness(["pid"], heavy, runs=1)
    texts = [str(warning.message) for warning in issued]
    assert any("found for the shipped vehicle" in text for text in texts), texts
    assert any("overrides your settings of control.pid.gain" in text for text in texts), texts
    assert {warning.filename for warning in issued} == {__file__}
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("call", "arguments", "words"),
    [
        (oqtal.fly, {"seed": np.random.default_rng(1)}, ["seed is Generator", "integer", "rng.integers"]),
        (oqtal.fly, {"seed": 2.5}, ["seed is 2.5", "integer"]),
        (oqtal.fly, {"seed": -1}, ["seed is -1", "at least 0"]),
        (oqtal.fly, {"contoller": "pid"}, ["contoller", "did you mean `controller`?"]),
        (oqtal.fly, {"mass_kg": 0.9}, ["mass_kg", "it has config"]),
        (oqtal.fly, {"settings": [("vehicle.mass-kg", 0.6)]}, ["settings is", "dictionary"]),
        (oqtal.fly, {"config": 3}, ["config is 3", "file"]),
        (oqtal.fly, {"disturb": 3}, ["3", "text"]),
        (oqtal.fly, {"trajectory": "hover", "settings": {"trajectory.kind": "circle"}}, ["trajectory.kind", "settings", "once"]),
        (oqtal.fly, {"law": print, "settings": {"control.controller": "pid"}}, ["control.controller", "once"]),
        (oqtal.fly, {"settings": {"clock.kind": "real"}}, ["virtual time", "oqtal fly"]),
        (oqtal.fly, {"settings": {"vehicle.mass-kg": None}}, ["vehicle.mass-kg", "NoneType"]),
        (oqtal.campaign, {"seeds": 3}, ["seeds is 3", "range(200, 225)"]),
        (oqtal.campaign, {"seeds": [1.5]}, ["1.5", "integer"]),
        (oqtal.campaign, {"runs": 0}, ["runs is 0", "at least 1"]),
        (oqtal.campaign, {"threads": -1}, ["threads is -1"]),
        (oqtal.campaign, {"settings": {"control.controller": "pid"}}, ["control.controller", "laws="]),
        (oqtal.campaign, {"settings": {"clock": {"seed": 3}}}, ["clock.seed", "seeds="]),
        (oqtal.sweep, {"axes": {"plant.rate-lag-ms": 50}}, ["plant.rate-lag-ms is 50", "[50, 80]"]),
        (oqtal.sweep, {"axes": {"plant.rate_lag_ms": [50]}, "plant": {"rate-lag-ms": 60}}, ["plant.rate-lag-ms", "axes"]),
        (oqtal.sweep, {"axes": {"clock.seed": [1, 2]}}, ["clock.seed", "seeds="]),
        (oqtal.sweep, {"axes": {"plant": {"rate_lag_ms": [50]}, "plant.rate-lag-ms": [80]}}, ["plant.rate-lag-ms", "twice"]),
        (oqtal.robustness, {"settings": {"clock.seed": 3}}, ["clock.seed", "seed="]),
        (oqtal.identify, {"mass": -1}, ["mass is -1", "above 0"]),
        (oqtal.identify, {"mass": float("nan")}, ["mass is nan", "above 0"]),
        (oqtal.identify, {"mass": 1.0, "max_thrust": 20.0}, ["mass or max_thrust"]),
        (oqtal.identify, {"settings": {"trajectory.kind": "hover"}}, ["trajectory.kind", "excitation"]),
        (oqtal.identify, {"flights": [3]}, ["[3]", "oqtal.Flight"]),
        (oqtal.tune, {"target": "pid", "seeds": range(1, 9, 2)}, ["[1, 3, 5, 7]", "consecutive"]),
        (oqtal.tune, {"target": "pid", "budget": 0}, ["budget is 0", "at least 1"]),
        (oqtal.tune, {"target": "pid", "settings": {"control.controller": "lqr"}}, ["control.controller", "target"]),
        (oqtal.connect, {"rot": "/tmp"}, ["rot", "did you mean `root`?"]),
        (paper.error_model, {"jacobian": "none", "eps": [0, 0, 0], "omega_e": [0, 0, 0]}, ["'none'", "printed-45"]),
        (paper.oqtal_gain, {"rate_authority": [2, 2, 2], "atitude_weight": 3}, ["atitude-weight", "attitude-weight"]),
    ],
)
def test_wrong_arguments_are_named(call, arguments, words):
    with pytest.raises(oqtal.UsageError) as raised:
        call(**arguments)
    assert all(word in str(raised.value) for word in words), raised.value


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"vehicle.mass-kg": float("nan")}, ["mass-kg` is NaN"]),
        ({"vehicle.mass-kg": "heavy"}, ["mass-kg", "heavy", "expected a number"]),
        ({"vehicle.mass-kg": [1.0]}, ["mass-kg", "list", "expected a number"]),
        ({"trajectory.kind": 3}, ["trajectory.kind", "expected one of `hover`"]),
        ({"vehicle.rate-authority-rad-s": [1.0, 2.0]}, ["rate-authority-rad-s", "list of 2", "list of 3"]),
    ],
)
def test_errors_of_the_configuration_name_no_type_of_rust(settings, words):
    with pytest.raises(oqtal.ConfigError) as raised:
        oqtal.fly(settings=settings)
    text = str(raised.value)
    assert all(word in text for word in words), text
    assert not any(name in text for name in ("f64", "u64", "variant", "sequence")), text


def test_arguments_of_an_identification_are_not_ignored(square):
    with pytest.raises(oqtal.UsageError, match="seed, plant: only without flights"):
        oqtal.identify(square, seed=3, plant={"mass_kg": 0.6})


def test_a_path_without_corners_has_landed():
    rows = oqtal.campaign(["pid"], runs=1, trajectory="circle")
    assert rows["landed"].all() and np.isnan(rows["overshoot_mm"]).all()


def test_frames_have_types_of_numbers_and_texts():
    pandas = pytest.importorskip("pandas")
    rows = oqtal.campaign(["pid"], runs=1).to_pandas()
    assert rows["seed"].dtype == np.int64 and rows["landed"].dtype == bool and rows["hover_rms_mm"].dtype == np.float64
    assert pandas.api.types.is_string_dtype(rows["controller"])


def test_a_misspelt_column_is_named(square):
    with pytest.raises(KeyError, match="did you mean `true_x_m`"):
        square["true_x"]


def test_values_that_contain_themselves_are_refused():
    endless: list[object] = []
    endless.append(endless)
    with pytest.raises(oqtal.UsageError, match="nested too deeply"):
        oqtal.fly(settings={"fault.inject": endless})


def test_flights_are_copied_and_pickled(square, tmp_path: Path):
    for copied in (copy.copy(square), copy.deepcopy(square), pickle.loads(pickle.dumps(square))):
        assert copied.summary == square.summary and copied.config == square.config
        np.testing.assert_array_equal(copied["true_x_m"], square["true_x_m"])
    deep = copy.deepcopy(square)
    deep["true_x_m"][0] = 7.0
    assert square["true_x_m"][0] != 7.0
    assert deep.save(tmp_path / "deep.mcap").exists()
    with pytest.raises(oqtal.DataError, match="pickle"):
        pickle.loads(pickle.dumps(square)).save(tmp_path / "pickled.mcap")


def test_a_flight_is_saved_as_it_was_flown(tmp_path: Path):
    # Neither a file that has changed since, nor a variable, alters the recording.
    file = tmp_path / "vehicle.toml"
    file.write_text("[vehicle]\nmass-kg = 0.55\n")
    flown = oqtal.fly(file, plant={"rate_lag_ms": 65.0}, seed=5, **HOVER)
    file.write_text("[vehicle]\nmass-kg = 0.7\n")
    read = oqtal.Flight.read(flown.save(tmp_path / "flight.mcap"))
    assert read.config == flown.config and "mass-kg = 0.55" in read.config
    assert read.summary["trajectory_hash"] == flown.summary["trajectory_hash"]


@pytest.mark.skipif(not hasattr(_native, "panic"), reason="a release build has no function that panics")
@pytest.mark.parametrize("in_study", [False, True])
def test_panics_are_exceptions(in_study, capfd):
    with pytest.raises(oqtal.InternalError, match="by hand; please report") as raised:
        _native.panic(in_study)
    assert "task.rs" in str(raised.value)
    assert capfd.readouterr() == ("", "")


def test_optional_packages_are_not_imported_with_the_package():
    code = "import sys, json, oqtal; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    optional = {"pandas", "polars", "matplotlib", "gymnasium", "scipy", "distributed"}
    assert not optional & set(json.loads(done.stdout))


def test_a_flight_is_drawn_without_a_display(tmp_path: Path):
    pytest.importorskip("matplotlib")
    code = "import oqtal; oqtal.fly(trajectory='hover', duration=2).plot().savefig('flight.png')"
    displays = ("DISPLAY", "MPLBACKEND", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in displays}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path, env=environment)
    assert (tmp_path / "flight.png").stat().st_size > 1000


def test_laws_in_python_are_no_names_of_studies():
    def law(state, reference, dt):
        return None

    with pytest.raises(oqtal.UsageError, match=r"laws: .*law.* is not a name; .*oqtal.fly\(law="):
        oqtal.campaign([law])
    with pytest.raises(oqtal.UsageError, match="target is .*expected the name of a law"):
        oqtal.tune(law)
    with pytest.raises(oqtal.UsageError, match="runs or seeds"):
        oqtal.campaign(["pid"], runs=2, seeds=[5])
    with pytest.raises(oqtal.UsageError, match="name of a preset"):
        oqtal.fly(vehicle={"mass_kg": 0.6})
    with pytest.raises(oqtal.UsageError, match=r"suffix of a recording is .mcap"):
        oqtal.fly(record="flight.txt")
