"""Flights: flown in this process, or read from recordings and telemetry."""

from __future__ import annotations

import copy
import csv
import json
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from oqtal import _native
from oqtal.errors import DataError, LawError, SystemFailure, UsageError
from oqtal.python_law import LawAdapter
from oqtal.settings import ConfigLike, check_names, integer, sources, texts, warn, write_text
from oqtal.table import Table

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl
    from matplotlib.figure import Figure

#: Maximum nesting of flights, by laws that call `fly`: each level uses the stack of the thread.
MOST_NESTED = 8
_nested = threading.local()
#: Columns of words; all others are numbers.
WORDS = ("mode", "state", "cause", "phase")


class Flight:
    """A flight: ``flight["true_x_m"]`` is an array with one number for each tick of the controller.

    The columns have the names of docs/data.md, ``summary`` the entries of ``summary.json``.
    """

    def __init__(
        self,
        *,
        native: _native.Flight | None = None,
        columns: Table | None = None,
        summary: Mapping[str, Any] | None = None,
        repeat: Callable[[str], _native.Flight] | None = None,
        config: str | None = None,
        answer_s: Iterable[float] = (),
        limited: int = 0,
    ) -> None:
        #: Computing times of a law in Python, one for each question [s]. The flight waits for them; a daemon does not.
        self.answer_s: np.ndarray[Any, Any] = np.array(list(answer_s), dtype=float)
        #: Number of commands of a law in Python that were limited to the range of the vehicle.
        self.limited = limited
        self._native = native
        self._columns = columns
        self._summary = dict(summary) if summary is not None else None
        self._repeat = repeat
        self._config = config

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Flight:
        """Reads a recording (``.mcap``), the telemetry of a flight (``.csv``), or the directory of a flight."""
        file = Path(path)
        if file.is_dir():
            recorded = file / "flight.mcap"
            file = recorded if recorded.exists() else file / "telemetry.csv"
        if file.suffix == ".csv":
            return cls._read_csv(file)

        def write(to: str) -> _native.Flight:
            try:
                shutil.copyfile(file, to)
            except OSError as error:
                raise SystemFailure(f"{file}: {error.strerror}; the recording that was read is gone") from error
            return _native.read(to)

        return cls(native=_native.read(str(file)), repeat=write)

    @classmethod
    def _read_csv(cls, file: Path) -> Flight:
        try:
            with file.open(newline="") as lines:
                head, *rows = list(csv.reader(lines)) or [[]]
        except (OSError, ValueError, csv.Error) as error:
            raise DataError(f"{file}: {error}; give telemetry.csv or a recording") from error
        if "t_s" not in head:
            raise DataError(f"{file} has no column t_s: it is not the telemetry of a flight")
        for number, row in enumerate(rows, 2):
            if len(row) != len(head):
                count = f"{len(row)} cells instead of {len(head)}, as of a line that was cut off"
                raise DataError(f"{file}:{number}: {count}; read the recording, or delete the line")
        try:
            cells = zip(*rows, strict=True) if rows else [()] * len(head)
            columns = {name: _column(name, values) for name, values in zip(head, cells, strict=True)}
        except (ValueError, OverflowError) as error:
            raise DataError(f"{file}: {error}") from error
        summary = file.with_name("summary.json")
        try:
            found = json.loads(summary.read_text()) if summary.exists() else None
        except (OSError, ValueError) as error:
            raise DataError(f"{summary}: {error}; delete it, or read the recording") from error
        return cls(columns=Table(columns), summary=found)

    @property
    def columns(self) -> Table:
        """The ticks as columns."""
        if self._columns is None:
            assert self._native is not None
            self._columns = Table(self._native.columns())
        return self._columns

    @property
    def summary(self) -> dict[str, Any]:
        """The figures of the flight, ``summary.json``."""
        if self._summary is None:
            if self._native is None:
                raise DataError("the telemetry has no summary.json beside it; read the recording")
            self._summary = json.loads(self._native.summary())
        return self._summary

    @property
    def config(self) -> str:
        """The effective configuration as TOML."""
        return self._whole("the configuration").config() if self._config is None else self._config

    @property
    def cut_off(self) -> str:
        """Reason why a recording ends early; empty for a complete one."""
        return self._native.cut_off if self._native else ""

    @property
    def scored(self) -> Table:
        """The ticks over which errors are computed."""
        return self.columns.where(self.columns["scored"] == 1)

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __getitem__(self, name: str) -> np.ndarray[Any, Any]:
        return self.columns[name]

    def vector(self, name: str) -> np.ndarray[Any, Any]:
        """Columns that form a vector, one row for each tick: ``"true_{}_m"``, ``"true_v{}_m_s"``, ``"true_rate_{}_rad_s"``, or
        ``"true_q{}"`` for a quaternion with the scalar last."""
        if "{}" not in name:
            raise UsageError(f'{name!r} is one column; a vector has braces for its axis, as in "true_{{}}_m"')
        names = [name.format(axis) for axis in "xyzw"]
        if names[3] not in self.columns:
            names.pop()
        return np.column_stack([self.columns[each] for each in names])

    def position_error(self) -> np.ndarray[Any, Any]:
        """Distance of the true position from the reference at each tick [m]; NaN where the truth is not known."""
        squares = sum((self[f"true_{axis}_m"] - self[f"ref_{axis}_m"]) ** 2 for axis in "xyz")
        return np.asarray(np.sqrt(squares))

    def to_pandas(self) -> pd.DataFrame:
        """The ticks as a data frame of pandas."""
        return self.columns.to_pandas()

    def to_polars(self) -> pl.DataFrame:
        """The ticks as a data frame of Polars."""
        return self.columns.to_polars()

    def plot(self) -> Figure:
        """Draws the path from above, height, position error and tilt with matplotlib; returns the figure."""
        from oqtal.plots import flight

        return flight(self)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Writes the report of the flight, one HTML page, and returns its path."""
        self._whole("a report").report(os.fspath(path))
        return Path(path)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the flight: a recording (``.mcap``), the ticks (``.csv``) or the figures (``.json``).

        A file of that name is replaced. A flight of this process is flown again for its recording: it repeats bit for bit.
        """
        file = Path(path)
        if file.suffix == ".csv":
            self._whole("telemetry").write_csv(str(file))
        elif file.suffix == ".json":
            write_text(file, json.dumps(self.summary, indent=2))
        elif file.suffix == ".mcap":
            self._record(file)
        else:
            raise UsageError(f"{file}: the suffix is .mcap, .csv or .json")
        return file

    def _record(self, file: Path) -> None:
        self._whole("a recording")
        if self._repeat is None:
            raise UsageError("this flight cannot be flown again; give record=PATH when it is flown")
        try:
            directory = tempfile.TemporaryDirectory(dir=file.parent)
        except OSError as error:
            raise SystemFailure(f"{file}: {error}; give another path") from error
        with directory:
            new = Path(directory.name) / file.name
            again = self._repeat(str(new))
            if json.loads(again.summary())["trajectory_hash"] != self.summary["trajectory_hash"]:
                raise DataError(f"{file}: the flight is another one now: its recording or a waypoint file has changed")
            try:
                new.replace(file)
            except OSError as error:
                raise SystemFailure(f"{file}: {error.strerror}; give another path") from error

    def _whole(self, purpose: str) -> _native.Flight:
        if self._native is None:
            raise DataError(f"the ticks alone, of a CSV file or a pickle, do not suffice for {purpose}; read the recording")
        return self._native

    def __copy__(self) -> Flight:
        return Flight(
            native=self._native,
            columns=self._columns,
            summary=self._summary,
            repeat=self._repeat,
            config=self._config,
            answer_s=self.answer_s,
            limited=self.limited,
        )

    def __deepcopy__(self, memo: Any) -> Flight:
        copied = copy.copy(self)
        copied._columns, copied._summary = copy.deepcopy((self._columns, self._summary), memo)
        return copied

    def __reduce__(self) -> tuple[Any, ...]:
        """A pickle has columns, summary and configuration, for example from a worker process; it cannot be saved as a recording."""
        config = self._native.config() if self._native else self._config
        summary = self._summary if self._native is None else self.summary
        return _unpickled, (self.columns, summary, config, self.answer_s, self.limited)

    def __repr__(self) -> str:
        if self._summary is None and self._native is None:
            return f"<Flight of {self.columns.rows} ticks, without summary.json>"
        shown = self.summary
        error, handovers = shown["position_error_m"], shown["handovers"]
        figure = f"mean position error {1e3 * error['mean']:.1f} mm" if error else "no tick is scored"
        if handovers and handovers["fallback_ticks"]:
            figure += f", {handovers['count']} hand-overs: the fallback law flew {handovers['fallback_ticks']} ticks"
        if self.limited:
            figure += f", {self.limited} commands limited to the range of the vehicle"
        outcome = shown["outcome"]
        if shown.get("shortfall"):
            outcome += f" ({shown['shortfall']})"
        return f"<Flight {shown['controller']}, {shown['trajectory']}: {outcome}, {figure}>"


def _unpickled(
    columns: Table, summary: dict[str, Any] | None, config: str | None, answer_s: Iterable[float], limited: int
) -> Flight:
    return Flight(columns=columns, summary=summary, config=config, answer_s=answer_s, limited=limited)


def _column(name: str, values: Sequence[str]) -> np.ndarray[Any, Any]:
    if name in WORDS:
        return np.array(values, dtype=str)
    if values and all(value.isdigit() for value in values):
        return np.array(values, dtype=np.int64)
    return np.array([value or "nan" for value in values], dtype=float)


@check_names
def fly(
    config: ConfigLike = None,
    *,
    controller: str | None = None,
    trajectory: str | None = None,
    duration: float | None = None,
    seed: int | None = None,
    vehicle: str | None = None,
    plant: Mapping[str, Any] | None = None,
    disturb: str | Sequence[str] | None = None,
    faults: str | Sequence[str] | None = None,
    settings: Mapping[str, Any] | None = None,
    record: str | os.PathLike[str] | None = None,
    law: Any = None,
) -> Flight:
    """Flies in virtual time in this process, as ``oqtal fly --clock in-process`` does.

    ``config``: a file, several files, or keys with values. ``controller``: one of ``oqtal.laws()``. ``duration`` of the trajectory
    [s]. ``vehicle``: the name of a preset. ``plant`` and ``settings``: keys of ``[plant]``, and any keys; nested dictionaries are
    sections, and ``_`` stands for ``-``. ``disturb`` and ``faults``: as ``--disturb`` and ``--fault``. ``record``: a recording, a
    new file ``.mcap``, is written while flying. ``law``: a law in Python, as in ``help(oqtal.python_law)``, which flies from the
    end of take-off to the landing, in place of ``controller``; a failure of the law ends the flight with ``LawError``.
    """
    if law is None and controller == "external":
        raise UsageError("give law=, a law in Python, in place of controller='external'")
    if law is not None and controller not in (None, "external"):
        raise UsageError("give law or controller, not both; the setting control.fallback names the law that flies if law fails")
    if isinstance(vehicle, Mapping):
        raise UsageError('vehicle is the name of a preset; parameters are config, as in fly({"vehicle": {"mass_kg": 0.6}})')
    call = sources(
        config,
        settings,
        plant,
        controller=("control.controller", controller if law is None else "external"),
        trajectory=("trajectory.kind", trajectory),
        duration=("trajectory.duration-s", duration),
        seed=("clock.seed", None if seed is None else integer("seed", seed)),
        vehicle=("vehicle.preset", vehicle),
        disturb=("plant.disturb", texts(disturb)),
        faults=("fault.inject", texts(faults)),
    )
    file = None if record is None else os.fspath(record)
    if file and not file.endswith(".mcap"):
        raise UsageError(f"record is {file}; the suffix of a recording is .mcap")
    adapter = None if law is None else LawAdapter(law)
    warn(call)
    nested = getattr(_nested, "flights", 0)
    if nested >= MOST_NESTED:
        raise UsageError(f"oqtal.fly is nested {nested} times: the law flies itself; fly another law inside it")
    _nested.flights = nested + 1
    try:
        native = _native.fly(call, file, adapter)
    except LawError as error:
        if adapter and error.flight is not None:
            summary = json.loads(error.flight.summary()) | {"shortfall": str(error)}
            error.flight = Flight(native=error.flight, summary=summary, answer_s=adapter.answer_s, limited=adapter.limited)
        raise
    finally:
        _nested.flights = nested
    if adapter is None:
        return Flight(native=native, repeat=native.fly_again)
    return Flight(native=native, repeat=native.fly_again, answer_s=adapter.answer_s, limited=adapter.limited)
