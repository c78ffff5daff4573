"""Fixtures of all tests."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

import oqtal

# A shell ignores SIGINT in what it runs in the background, and tests send it to themselves and to their children.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[2]


def programs(page: str) -> list[str]:
    """The blocks of Python of a document."""
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="session")
def square() -> oqtal.Flight:
    """A flight along the square."""
    return oqtal.fly(seed=7)


@pytest.fixture(scope="session")
def program() -> str:
    """The program, if it is built: `OQTAL`, or the one of the development build."""
    path = os.environ.get("OQTAL", str(ROOT / "target/debug/oqtal"))
    if not Path(path).exists():
        pytest.skip(f"{path} is not built; name the program with OQTAL")
    return path


@pytest.fixture
def run(program: str, tmp_path: Path):
    """Runs the program in a directory of the test."""

    def run(*words: object) -> str:
        done = subprocess.run([program, *map(str, words)], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
