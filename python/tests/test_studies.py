"""Studies: the same rows as those of the program, on any number of threads and workers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oqtal

LAWS = ["pid", "oqtal-dt"]


@pytest.fixture(scope="module")
def rows() -> oqtal.Table:
    return oqtal.campaign(LAWS, runs=3)


def assert_equal(found: oqtal.Table, expected: oqtal.Table) -> None:
    assert list(found) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, name)


def test_a_campaign_has_the_rows_of_the_program(rows, run, tmp_path: Path):
    run("campaign", "--laws", ",".join(LAWS), "--runs", 3, "--out", "campaign")
    head, *lines = (tmp_path / "campaign/campaign.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines]
    for index, name in enumerate(head.split(",")):
        expected = [row[index] for row in cells]
        found = rows[name]
        if found.dtype.kind in "fi":
            np.testing.assert_array_equal(found, [float(cell or "nan") for cell in expected], name)
        else:
            assert list(found) == expected


def test_rows_do_not_depend_on_threads(rows):
    told = []
    again = oqtal.campaign(LAWS, seeds=range(200, 203), threads=1, progress=lambda *step: told.append(step))
    assert_equal(again, rows)
    assert told[-1] == ("flights", 24, 24)


def test_progress_that_raises_ends_the_study():
    def refuse(*_):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        oqtal.campaign(["mpc"], runs=100_000, progress=refuse)


def test_a_sweep_varies_keys(rows):
    lags = [50.0, 80.0]
    swept = oqtal.sweep({"plant.rate-lag-ms": lags}, LAWS, seeds=range(200, 203))
    assert swept.rows == len(lags) * len(LAWS) * 3
    nominal = swept.where(swept["plant.rate-lag-ms"] == 50.0)
    np.testing.assert_array_equal(nominal["hover_rms_mm"], rows["hover_rms_mm"])
    slow = swept.where(swept["plant.rate-lag-ms"] == 80.0)
    assert (slow["chirp4_rms_deg"] != nominal["chirp4_rms_deg"]).all()
    short = {"seeds": [200], "trajectory": "hover", "settings": {"trajectory.duration-s": 2}}
    vectors = oqtal.sweep({"vehicle.rate-authority-rad-s": [[2, 2, 2], [3, 2, 2]]}, ["pid"], **short)
    assert list(vectors["vehicle.rate-authority-rad-s"]) == [[2, 2, 2], [3, 2, 2]]
    with pytest.raises(oqtal.ConfigError, match="plant.nothing"):
        oqtal.sweep({"plant": {"nothing": [1.0]}}, LAWS)
    with pytest.raises(oqtal.UsageError, match="position.tilt-limit-deg is 15"):
        oqtal.sweep({"position": {"tilt_limit_deg": 15}}, LAWS)


def test_robustness_flies_the_draws_of_the_program(run, tmp_path: Path):
    import json

    found = oqtal.robustness(["oqtal-dt"], runs=3)
    printed = run("robustness", "--laws", "oqtal-dt", "--runs", 3, "--out", tmp_path / "robustness", "--json")
    draws = json.loads(printed)["draws"]
    assert [draw["seed"] for draw in draws] == list(found["seed"])
    expected = [draw["laws"]["oqtal-dt, tuned"]["hover_rms_mm"] for draw in draws]
    np.testing.assert_array_equal(found["hover_rms_mm"], expected)
    np.testing.assert_array_equal(found["plant.mass-kg"], [draw["drawn"]["plant.mass-kg"] for draw in draws])


def test_a_vehicle_is_identified_and_flown(tmp_path: Path):
    true = {"rate_lag_ms": 70.0}
    found = oqtal.identify(plant=true, mass=0.5, seed=3)
    lag = found.table.where(found.table["key"] == "vehicle.rate-lag-ms")
    assert abs(lag["value"][0] - 70.0) < 5 * lag["half_width"][0]
    file = found.save(tmp_path / "vehicle.toml")
    assert oqtal.fly(file, controller="oqtal-dt", plant=true).summary["outcome"] == "landed"
    recorded = oqtal.fly(trajectory="excitation", settings={"trajectory.settle-s": 1.0}, plant=true, seed=3)
    again = oqtal.identify(recorded, mass=0.5)
    assert list(again.table["name"]) == list(found.table["name"])
    with pytest.raises(oqtal.UsageError, match="flights"):
        oqtal.identify([])
    with pytest.raises(oqtal.UsageError, match="given twice"):
        oqtal.identify([recorded, recorded])


def test_gains_are_tuned(tmp_path: Path):
    found = oqtal.tune("pid", budget=8, seeds=range(101, 103), plant={"rate_lag_ms": 55.0})
    assert " --seeds 101-102 --set plant.rate-lag-ms=55.0: objective" in found.toml.splitlines()[0]
    assert found.objective <= found.start and found.values
    assert oqtal.fly(found.save(tmp_path / "tuned.toml")).summary["controller"] == "pid"
    with pytest.raises(oqtal.UsageError, match="nobody"):
        oqtal.tune("nobody")


def test_a_gain_on_a_bound_of_the_search_is_named():
    # The configured gain is on the bound, and one point finds no better ones.
    gain = {"position": {"horizontal_position": {"ki": 0.001}}}
    found = oqtal.tune("pid", budget=1, seeds=range(101, 102), settings=gain)
    assert found.objective == found.start and found.on_a_bound == ["position.horizontal-position.ki"]
    assert "on a bound of the search: position.horizontal-position.ki" in repr(found)


def test_names_of_laws_are_checked():
    assert "oqtal-dt" in oqtal.laws()
    with pytest.raises(oqtal.UsageError, match="nobody"):
        oqtal.campaign(["nobody"])


def test_complete_settings_keep_their_order():
    given = [
        ("OQTAL_VEHICLE__MASS_KG", "vehicle.mass-kg", 0.6),
        ("config", "vehicle.mass-kg", 0.5),
        ("config", "vehicle.max-thrust-n", 20.0),
    ]
    [(_, settings)] = oqtal._native.resolved((None, given), ["pid"], "configured")
    assert settings[: len(given)] == given


def test_workers_of_a_cluster_fly_the_same_rows(rows, monkeypatch, tmp_path: Path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert_equal(oqtal.campaign(LAWS, runs=3, client=client), rows)
        # Files and variables are those of the caller, whose directory the workers do not share.
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("OQTAL_PLANT__MASS_KG", "0.6")
        Path("my.toml").write_text("[vehicle]\nmass-kg = 0.55\n")
        oqtal.tune("pid", budget=2, seeds=[101]).save("pid.toml")
        files: dict[str, Any] = {"config": "my.toml", "gains": Path(), "seeds": [3]}
        assert_equal(oqtal.campaign(["pid"], **files, client=client), oqtal.campaign(["pid"], **files))
        with pytest.raises(oqtal.UsageError, match="dashboard"):
            oqtal.campaign(LAWS, runs=1, client=client, progress=True)


def test_tables_are_shown(rows):
    assert "hover_rms_mm" in repr(rows) and "<table>" in rows._repr_html_()
    with pytest.raises(KeyError, match="nothing"):
        rows["nothing"]
