"""Studies on all processors: campaigns, sweeps, robustness, identification, tuning."""

from __future__ import annotations

import itertools
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from oqtal import _native
from oqtal.errors import UsageError
from oqtal.flight import Flight
from oqtal.settings import (
    ConfigLike,
    Setting,
    Sources,
    check_names,
    flat,
    integer,
    positive,
    sources,
    warn,
    warn_of_study,
    write_text,
)
from oqtal.table import Table

if TYPE_CHECKING:
    from distributed import Client

#: Called with the name of a task, the steps done, and all steps. ``True`` draws a bar, also in a notebook.
Progress: TypeAlias = "bool | Callable[[str, int, int], None]"
#: Seed of the flights, and settings.
Condition: TypeAlias = tuple[int, list[Setting]]
#: A flight, or the path of its recording.
FlightLike: TypeAlias = "Flight | str | os.PathLike[str]"

#: Number of seeds of a campaign.
RUNS = 25
#: First of the seeds by which laws are compared; none is used for tuning.
FIRST_SEED = 200
#: Keys that a study of laws sets in each flight.
SET_BY_LAWS = {"control.controller": "name the laws in laws=", "clock.seed": "give seeds="}
#: Tasks for each worker of a cluster: few enough for little overhead, enough for an even load.
TASKS_PER_WORKER = 4


def laws() -> list[str]:
    """Names of the laws."""
    return _native.laws()


@check_names
def campaign(
    laws: Sequence[str] | None = None,
    config: ConfigLike = None,
    *,
    runs: int | None = None,
    seeds: Iterable[int] | None = None,
    gains: str | os.PathLike[str] = "configured",
    trajectory: str | None = None,
    plant: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Progress = False,
    threads: int = 0,
    client: Client | None = None,
) -> Table:
    """Flies laws on the same seeds, as ``oqtal campaign``: one row for each law and seed, with the columns of ``campaign.csv``.

    ``runs``: number of seeds from 200 on, 25 by default, in place of ``seeds``.

    Four flights for each row: trajectory, hover, chirp, doublet. On the square the command flies two more, a disturbed hover and a
    circle.

    ``gains``: ``"configured"``; ``"tuned"``, ``"spread"`` or ``"shipped"`` of deploy/tuned; or a folder of ``oqtal tune all``.

    ``client``: a client of dask.distributed, whose workers fly; on machines of one kind the rows are the same, bit for bit.
    """
    call = sources(config, settings, plant, set_by=SET_BY_LAWS, trajectory=("trajectory.kind", trajectory))
    if runs is not None and seeds is not None:
        raise UsageError("give runs or seeds: runs are the seeds from 200 on")
    count = integer("runs", RUNS if runs is None else runs, 1)
    chosen = _seeds(range(FIRST_SEED, FIRST_SEED + count) if seeds is None else seeds)
    conditions: list[Condition] = [(seed, []) for seed in chosen]
    return _fly(call, laws, gains, conditions, progress, threads, client)


@check_names
def sweep(
    axes: Mapping[str, Iterable[Any]],
    laws: Sequence[str] | None = None,
    config: ConfigLike = None,
    *,
    seeds: Iterable[int] = range(FIRST_SEED, FIRST_SEED + 5),
    gains: str | os.PathLike[str] = "configured",
    trajectory: str | None = None,
    plant: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Progress = False,
    threads: int = 0,
    client: Client | None = None,
) -> Table:
    """Flies every combination of values: one row for each law, combination and seed.

    ``axes``: keys with their values, ``{"plant.rate-lag-ms": [50, 80]}`` or nested, ``{"plant": {"rate_lag_ms": [50, 80]}}``.
    ``gains``, ``client``: as for ``campaign``.
    """
    values: dict[str, list[Any]] = {}
    for _, key, given in flat(axes, "axes"):
        if isinstance(given, str) or not isinstance(given, Iterable):
            raise UsageError(f"axes: {key} is {given!r}; expected several values, as in [50, 80]")
        if key in values:
            raise UsageError(f"axes: {key} is given twice; give it once")
        values[key] = list(given)
    set_by = SET_BY_LAWS | dict.fromkeys(values, "its values are those of axes")
    call = sources(config, settings, plant, set_by=set_by, trajectory=("trajectory.kind", trajectory))
    for key in SET_BY_LAWS.keys() & values:
        raise UsageError(f"axes: {key} is set by this call; {SET_BY_LAWS[key]}")
    combinations = list(itertools.product(*values.values()))
    chosen = _seeds(seeds)
    flown = [(combination, seed) for combination in combinations for seed in chosen]
    if not flown:
        raise UsageError("nothing to fly; give each key at least one value, and at least one seed")
    conditions: list[Condition] = [
        (seed, [("sweep", key, value) for key, value in zip(values, combination, strict=True)]) for combination, seed in flown
    ]
    table = _fly(call, laws, gains, conditions, progress, threads, client)
    count = table.rows // len(conditions)
    swept = {key: np.tile(_cells([combination[index] for combination, _ in flown]), count) for index, key in enumerate(values)}
    return Table({**swept, **table})


@check_names
def robustness(
    laws: Sequence[str] | None = None,
    config: ConfigLike = None,
    *,
    runs: int = 100,
    seed: int = 1,
    spread: str | os.PathLike[str] = "vehicle",
    wide: bool = False,
    gains: str | os.PathLike[str] = "tuned",
    plant: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Progress = False,
    threads: int = 0,
    client: Client | None = None,
) -> Table:
    """Flies laws on plants drawn at random, as ``oqtal robustness`` with one set of gains: one row for each law and draw,
    with the drawn values.

    ``spread``: ``"vehicle"``, ``"everything"`` or a file (docs/robustness.md); ``wide``: with every range twice as wide.
    ``gains``, ``client``: as for ``campaign``; ``oqtal robustness`` flies the tuned, the spread and the shipped gains.
    """
    call = sources(config, settings, plant, set_by={**SET_BY_LAWS, "clock.seed": "seed= draws the flights' seeds"})
    conditions = _native.draws(call, os.fspath(spread), (integer("runs", runs, 1), integer("seed", seed, 1)), wide)
    table = _fly(call, laws, gains, conditions, progress, threads, client)
    count = table.rows // len(conditions)
    drawn: dict[str, Any] = {"draw": np.tile(np.arange(len(conditions)), count)}
    for _, key, first in conditions[0][1]:
        values = [dict((name, value) for _, name, value in drawn_of)[key] for _, drawn_of in conditions]
        if isinstance(first, list):
            columns = {f"{key}.{index}": of_axis for index, of_axis in enumerate(zip(*values, strict=True))}
        else:
            columns = {key: tuple(values)}
        drawn.update({name: np.tile(of_key, count) for name, of_key in columns.items()})
    return Table({**drawn, **table})


class Identification:
    """Parameters of a vehicle found from its flights."""

    def __init__(self, document: Mapping[str, Any], toml: str, remarks: Sequence[str] = ()) -> None:
        #: All results, as ``identification.json`` of ``oqtal identify``.
        self.document = document
        #: The vehicle as a configuration.
        self.toml = toml
        #: What the flights did not show, whether residuals are white, and what the cameras did.
        self.remarks = list(remarks)

    @property
    def table(self) -> Table:
        """The parameters: value, half the width of the 95 % interval, value of the configuration.

        A parameter that the flights did not determine has the value NaN, and an entry in ``missing``, the motion that they lack,
        or in ``unfit``, the assumption that may not hold; ``save`` leaves it out.
        """
        findings = self.document["findings"]
        text = ("name", "key", "unit", "missing", "unfit")
        columns: dict[str, Any] = {name: [finding[name] or "" for finding in findings] for name in text}
        for name in ("half_width", "before"):
            columns[name] = [np.nan if finding[name] is None else finding[name] for finding in findings]
        shown = [not (finding["missing"] or finding["unfit"] or finding["value"] is None) for finding in findings]
        columns["value"] = [finding["value"] if is_shown else np.nan for finding, is_shown in zip(findings, shown, strict=True)]
        order = ("name", "value", "half_width", "before", "unit", "key", "missing", "unfit")
        return Table({name: columns[name] for name in order})

    def save(self, path: str | Path) -> Path:
        """Writes the configuration of the vehicle, for ``config=`` and ``--config``."""
        return write_text(path, self.toml)

    def __repr__(self) -> str:
        return "\n".join([repr(self.table), *self.remarks])


@check_names
def identify(
    flights: FlightLike | Sequence[FlightLike] | None = None,
    config: ConfigLike = None,
    *,
    mass: float | None = None,
    max_thrust: float | None = None,
    seed: int | None = None,
    plant: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Identification:
    """Identifies a vehicle from ``flights`` with the trajectory ``excitation``, or their recordings; without flights, from one
    that is flown now, with a larger assumed mass if the first attempt does not lift off.

    ``mass`` as weighed [kg], or ``max_thrust`` as measured [N]: flights determine only their ratio.
    """
    if mass is not None and max_thrust is not None:
        raise UsageError("give mass or max_thrust: flights determine their ratio, and one of them gives the other")
    if flights is None:
        set_by = {"trajectory.kind": "it flies `excitation`", "trajectory.duration-s": "it flies `excitation` to its end"}
        named = ("clock.seed", None if seed is None else integer("seed", seed))
        call = sources(config, settings, plant, set_by=set_by, seed=named)
        warn(call)
        flown = [_native.fly_excitation(call)]
    else:
        given_too = {"config": config, "seed": seed, "plant": plant, "settings": settings}
        if ignored := [name for name, value in given_too.items() if value is not None]:
            raise UsageError(f"{', '.join(ignored)}: only without flights, which have a configuration of their own")
        listed = [flights] if isinstance(flights, (Flight, str, os.PathLike)) else list(flights)
        given = [Flight.read(each) if isinstance(each, (str, os.PathLike)) else each for each in listed]
        if not all(isinstance(flight, Flight) for flight in given):
            raise UsageError(f"flights are {given!r}; expected oqtal.Flight, as from Flight.read")
        flown = [flight._whole("an identification") for flight in given]
    document, toml, remarks = _native.identify(flown, positive("mass", mass), positive("max_thrust", max_thrust))
    for cut in [flight.cut_off for flight in flown if flight.cut_off]:
        warnings.warn(f"a recording is cut off: {cut}", stacklevel=3)
    found = Identification(json.loads(document), toml, remarks)
    undetermined = (found.table["missing"] != "") | (found.table["unfit"] != "")
    if names := ", ".join(found.table.where(undetermined)["name"]):
        warnings.warn(f"not determined by the flights, and not written: {names}; see remarks", stacklevel=3)
    return found


class Tuned:
    """Gains found by a search."""

    def __init__(self, values: Mapping[str, float], on_a_bound: Sequence[str], objective: float, start: float, toml: str) -> None:
        #: Values of the keys.
        self.values = dict(values)
        #: Keys whose values are on a bound of the range that was searched: a better value may lie beyond.
        self.on_a_bound = list(on_a_bound)
        #: Objective at these gains; lower is better, and 1 for the law ``oqtal`` as configured.
        self.objective = objective
        #: Objective at the configured gains.
        self.start = start
        #: The gains as a configuration, without the vehicle.
        self.toml = toml

    def save(self, path: str | Path) -> Path:
        """Writes the gains, for ``config=`` and ``--config``, after the file of the vehicle."""
        return write_text(path, self.toml)

    def __repr__(self) -> str:
        bounds = f"; on a bound of the search: {', '.join(self.on_a_bound)}" if self.on_a_bound else ""
        return f"<Tuned: objective {self.objective:.4f}, {self.start:.4f} at the configured gains{bounds}>"


@check_names
def tune(
    target: str,
    config: ConfigLike = None,
    *,
    budget: int = 300,
    seed: int = 1,
    seeds: Iterable[int] = range(101, 107),
    spread: str | os.PathLike[str] | None = None,
    optimiser: str = "cma-es",
    plant: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Progress = False,
    threads: int = 0,
) -> Tuned:
    """Tunes the gains of a built-in law on simulated flights, as ``oqtal tune``; ``target="outer"`` tunes the position loops.

    ``seeds``: consecutive seeds of the flights. ``spread``: as for ``robustness``; without it, plants near the configured one.
    """
    if not isinstance(target, str):
        raise UsageError(f"target is {target!r}; expected the name of a law, or outer")
    call = sources(config, settings, plant, set_by={"control.controller": "it is target", "clock.seed": "give seeds="})
    law = [("target", "control.controller", target)] if target in _native.laws() else []
    warn((call[0], [*call[1], *law]))
    chosen = _seeds(seeds)
    flights = (chosen[0], chosen[-1] + 1) if chosen else (0, 0)
    if chosen != list(range(*flights)):
        raise UsageError(f"seeds are {chosen}; expected consecutive ones, as in range(101, 107)")
    report = _progress(progress)
    search = (integer("budget", budget, 1), integer("seed", seed), optimiser)
    drawn = None if spread is None else os.fspath(spread)
    try:
        found = _native.tune(call, target, search, flights, drawn, report, integer("threads", threads, 0, 1024))
    finally:
        warn_of_study(4)
    values, on_a_bound, objective, start, toml = found
    return Tuned(dict(values), on_a_bound, objective, start, toml)


def _fly(
    call: Sources,
    laws: Sequence[str] | None,
    gains: str | os.PathLike[str],
    conditions: list[Condition],
    progress: Progress,
    threads: int,
    client: Client | None,
) -> Table:
    threads, gains = integer("threads", threads, 0, 1024), os.fspath(gains)
    names = _native.laws() if laws is None else [laws] if isinstance(laws, str) else list(laws)
    if unnamed := next((law for law in names if not isinstance(law, str)), None):
        raise UsageError(f"laws: {unnamed!r} is not a name; fly a law in Python by oqtal.fly(law=..., seed=...) for each seed")
    if not conditions:
        raise UsageError("nothing to fly; give at least one seed")
    if client is None:
        try:
            return Table(_native.study(call, names, gains, conditions, _progress(progress), threads))
        finally:
            warn_of_study()
    if progress is not False or threads:
        raise UsageError("progress and threads are those of this machine; leave them out, and look at the client's dashboard")
    # Files, gains and environment are those of this machine.
    try:
        chosen = _native.resolved(call, names, gains)
    finally:
        warn_of_study()
    count = max(1, TASKS_PER_WORKER * len(client.scheduler_info()["workers"]) // len(chosen))
    length = -(-len(conditions) // count)
    parts = [conditions[start : start + length] for start in range(0, len(conditions), length)]
    tasks = [(name, settings, part) for name, settings in chosen for part in parts]
    # The tasks of a lost worker are flown again by another one: dask repeats them.
    futures = [
        client.submit(_native.study, (None, settings), [name], "configured", part, None, 1, pure=False)
        for name, settings, part in tasks
    ]
    rows = client.gather(futures)
    return Table({name: np.concatenate([np.asarray(part[name]) for part in rows]) for name in rows[0]})


def _cells(values: list[Any]) -> np.ndarray[Any, Any]:
    """One cell for each value, a list or a vector included."""
    if all(np.ndim(value) == 0 for value in values):
        return np.array(values)
    cells = np.empty(len(values), dtype=object)
    cells[:] = [list(value) for value in values]
    return cells


def _seeds(seeds: Iterable[int]) -> list[int]:
    try:
        return [integer("a seed", seed) for seed in seeds]
    except TypeError:
        raise UsageError(f"seeds is {seeds!r}; expected several, as in range(200, 225)") from None


def _progress(progress: Progress) -> Callable[[str, int, int], None] | None:
    """The receiver of progress: the given one, a bar, or none."""
    return _bar if progress is True else progress or None


def _bar(name: str, done: int, all_steps: int) -> None:
    """Draws a bar in one line of the terminal or of a notebook's output."""
    filled = 30 * done // max(all_steps, 1)
    end = "\n" if done >= all_steps else ""
    sys.stderr.write(f"\r{name:24} {'█' * filled}{'·' * (30 - filled)} {done}/{all_steps}{end}")
    sys.stderr.flush()
