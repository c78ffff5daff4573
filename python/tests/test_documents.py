"""The programs of docs/python.md and the notebooks of examples/ are executed as they are written."""

from __future__ import annotations

import contextlib
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, programs

import oqtal

#: Smaller numbers for studies of the document, which show how long a study may be.
SMALLER = {"runs=1000": "runs=2", "runs=100": "runs=2", "runs=25": "runs=2", "budget=300": "budget=4"}
#: Notebooks but the one that trains a policy, which needs PyTorch and minutes.
NOTEBOOKS = sorted(path.name for path in (ROOT / "examples").glob("*.ipynb") if path.name != "learning.ipynb")
#: Relative difference of two numbers that are printed alike on machines with other mathematical functions.
TOLERANCE = 0.02
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """An empty working directory, and figures without a display."""
    matplotlib = pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    yield pyplot
    pyplot.close("all")


def test_every_program_of_the_document_runs(figures, monkeypatch):
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("gymnasium")
    blocks, names = programs("docs/python.md"), {"__name__": "document"}
    assert len(blocks) >= 6
    text = "".join(blocks)
    assert all(large in text for large in SMALLER)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        for block in blocks:
            if "oqtal.connect" in block:
                continue  # in test_instance.py, which has an instance
            for large, small in SMALLER.items():
                block = block.replace(large, small)
            block = block.replace("tcp://scheduler:8786", cluster.scheduler_address)
            exec(compile(block, "docs/python.md", "exec"), names)
    assert isinstance(names["flight"], oqtal.Flight)


def test_every_block_of_the_page_about_pandas_runs_on_the_flights_of_the_page(figures, run, monkeypatch, tmp_path):
    monkeypatch.setenv("OQTAL_ROOT", str(tmp_path / "run"))
    commands = re.findall(r"^oqtal (.*)$", (ROOT / "docs/pandas.md").read_text(), re.MULTILINE)
    assert len(commands) == 3
    for command in [*commands, "campaign --runs 1 --laws pid"]:
        run(*command.split())
    assert len(programs("docs/pandas.md")) == 3
    for block in programs("docs/pandas.md"):
        exec(compile(block, "docs/pandas.md", "exec"), {})


def numbers_and_words(text: str) -> tuple[list[float], list[str]]:
    return [float(number) for number in NUMBER.findall(text)], NUMBER.sub("#", text).split()


def printed(outputs: list[dict[str, Any]]) -> str:
    """Text that the outputs of a cell show."""
    return "".join("".join(output["text"]) for output in outputs if output.get("name") == "stdout")


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks_print_what_they_show(name, figures):
    cells = json.loads((ROOT / "examples" / name).read_text())["cells"]
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate((cell for cell in cells if cell["cell_type"] == "code"), 1):
        told = io.StringIO()
        with contextlib.redirect_stdout(told):
            exec(compile("".join(cell["source"]), f"{name}, program {number}", "exec"), names)
        found, shown = numbers_and_words(told.getvalue()), numbers_and_words(printed(cell["outputs"]))
        assert found[1] == shown[1], f"program {number} prints\n{told.getvalue()}"
        assert found[0] == pytest.approx(shown[0], rel=TOLERANCE, abs=0.011), f"program {number} prints\n{told.getvalue()}"
        assert not any(output["output_type"] == "error" for output in cell["outputs"])
    drawn = sum("image/png" in output.get("data", {}) for cell in cells for output in cell.get("outputs", []))
    assert len(figures.get_fignums()) == drawn > 0


@pytest.mark.parametrize("name", [*NOTEBOOKS, "learning.ipynb"])
def test_notebooks_are_small_and_executed_in_order(name):
    text = (ROOT / "examples" / name).read_text()
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert len(text) < 150_000
