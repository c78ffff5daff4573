"""A running instance: observation, an operator's commands, and references of a planner.

Nothing here is part of the control loop, and no end of this process stops it. The shared memory of a killed observer is freed with
the instance; after the end of a planner the vehicle comes to rest and, ``reference.land-after-ms`` later, lands.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from oqtal import _native
from oqtal.errors import PeerError, UsageError
from oqtal.settings import ConfigLike, check_names, flat, sources
from oqtal.table import Table

if TYPE_CHECKING:
    import pandas as pd

#: Time without a message after which a stream has ended [s].
SILENCE_S = 2.0
#: An observation shorter than its time-out fails if it lasted longer than this without a single message [s].
MIN_SILENCE_S = 0.5
#: Longest wait between two looks at the clock [s].
SLICE_S = 0.1


class Observation(Iterator[dict[str, Any]]):
    """Messages of a topic, or events, as dictionaries with the names of ``oqtal export --format csv``.

    An observation takes one of the places for observers of its topic until it is closed: by ``with``, ``close``, its end, or
    the end of the process. A slow reader loses the oldest messages, which ``lost`` counts; it cannot delay the loop.
    """

    def __init__(self, native: _native.Observation, seconds: float, timeout: float | None, subject: str) -> None:
        self._native = native
        # The native side buffers messages until then, even if nobody reads yet.
        self._end = time.monotonic() + seconds
        self._timeout = timeout
        self._subject = subject
        self._is_closed = False
        self._is_empty = True

    @property
    def names(self) -> list[str]:
        """Names of the entries."""
        return self._native.names

    @property
    def lost(self) -> int:
        """Number of messages lost so far."""
        return self._native.lost

    def __next__(self) -> dict[str, Any]:
        asked_at = time.monotonic()
        is_over = False
        while not (is_over or self._is_closed):
            now = time.monotonic()
            row = self._native.next(min(SLICE_S, max(0.0, self._end - now)))
            if row is not None:
                self._is_empty = False
                return row
            is_over = now >= self._end
            if self._timeout is not None and time.monotonic() - asked_at > self._timeout:
                raise self._silent(self._timeout)
        if self._timeout is not None and self._is_empty and not self._is_closed and now - asked_at > MIN_SILENCE_S:
            raise self._silent(now - asked_at)
        self.close()
        raise StopIteration

    def _silent(self, seconds: float) -> PeerError:
        self.close()
        return PeerError(f"no message of {self._subject} for {seconds:.1f} s: its writer has ended, or does not publish")

    def table(self) -> Table:
        """All messages until the end of the observation; give ``seconds`` when it is opened."""
        rows: list[dict[str, Any]] = []
        try:
            rows.extend(self)
        except PeerError as error:
            if not rows:
                raise
            warnings.warn(f"{error}; the table has the messages until then", stacklevel=2)
        return Table({name: np.array([row[name] for row in rows]) for name in self.names})

    def to_pandas(self) -> pd.DataFrame:
        """As ``table``, as a data frame of pandas."""
        return self.table().to_pandas()

    def close(self) -> None:
        """Leaves the topic; an iteration under way ends."""
        self._is_closed = True
        self._native.close()

    def __enter__(self) -> Observation:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class Instance:
    """A running instance. Methods are the commands of ``oqtal ctl``: each returns the daemon's answer, or raises its refusal.

    Another law is set by ``set({"control.controller": "geometric"})``.
    """

    def __init__(self, native: _native.Connection) -> None:
        self._native = native

    @property
    def name(self) -> str:
        """Name of the instance."""
        return self._native.name

    def status(self) -> dict[str, Any]:
        """Mode, safety state, obstacles to a take-off, processes, vehicle and position, as ``oqtal ctl status --json``."""
        found: dict[str, Any] = json.loads(self._native.status())
        return found

    def arm(self) -> str:
        """Starts the motors and flies the configured trajectory; waits until the flight has begun."""
        return self._native.request("arm", [])

    def disarm(self) -> str:
        """Calls off a flight that has not begun; refused in flight."""
        return self._native.request("disarm", [])

    def land(self) -> str:
        """Descends at the present position, by request or, if it is not answered, by signal."""
        return self._native.request("land", [])

    def stop(self) -> str:
        """Motors off at once, in flight too, by every path of ``oqtal ctl stop``; raises unless the motors are known to be off."""
        return self._native.request("stop", [])

    def goto(self, x: float, y: float, z: float, yaw: float | None = None) -> str:
        """Flies to a point [m, world], with ``yaw`` [rad] if it is given, and stays there."""
        if yaw is not None and not abs(yaw) <= 2 * np.pi:
            raise UsageError(f"yaw is {yaw} rad, expected -2 pi to 2 pi; give degrees as math.radians({yaw})")
        numbers = [x, y, z] if yaw is None else [x, y, z, np.degrees(yaw)]
        return self._native.request("goto", [repr(float(number)) for number in numbers])

    def hover(self) -> str:
        """Comes to rest and stays."""
        return self._native.request("hover", [])

    def fly(self, trajectory: str) -> str:
        """Flies another trajectory from the present point, then stays."""
        return self._native.request("fly", [trajectory])

    def resume(self) -> str:
        """Gives control back to the configured law after the fallback law took over."""
        return self._native.request("resume", [])

    def set(self, settings: Mapping[str, Any]) -> str:
        """Changes settings between two ticks, all of them or none: ``{"control.oqtal.attitude-weight": 60}``."""
        return self._native.set(([], list(flat(settings, "set"))))

    def get(self, key: str) -> Any:
        """The value of a setting."""
        text = self._native.request("get", [key.replace("_", "-")])
        try:
            return json.loads(text)
        except ValueError:
            return text

    def undo(self) -> str:
        """Takes the last change of settings back."""
        return self._native.request("undo", [])

    def reference(
        self,
        position: Sequence[float],
        velocity: Sequence[float] = (0.0, 0.0, 0.0),
        acceleration: Sequence[float] = (0.0, 0.0, 0.0),
        jerk: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
        attitude: Sequence[float] | None = None,
        rate: Sequence[float] = (0.0, 0.0, 0.0),
        valid: float = 0.1,
    ) -> None:
        """Publishes a reference for this instant, valid for ``valid`` seconds; a planner sends one in each of its periods.

        docs/references.md describes references: position to jerk [m to m/s^3, world], ``yaw`` [rad], ``yaw_rate`` [rad/s].
        ``attitude``: a prescribed attitude [x, y, z, w], body to world, with its body rate ``rate`` [rad/s]. The topic has one
        writer: this process, until it ends. A reference has no answer: one that the daemon refuses shows as the state Degraded with
        the cause ``set-point refused``; ``oqtal ctl status`` and the daemon's log name the limit. Without a daemon, ``PeerError``
        within two seconds.
        """
        turned = (0.0, 0.0, 0.0, 1.0) if attitude is None else attitude
        vectors = [("position", position, 3), ("velocity", velocity, 3), ("acceleration", acceleration, 3), ("jerk", jerk, 3)]
        vectors += [("yaw and yaw_rate", [yaw, yaw_rate], 2), ("attitude", turned, 4), ("rate", rate, 3)]
        for name, vector, length in vectors:
            if len(vector) != length:
                raise UsageError(f"{name} has {len(vector)} numbers; expected {length}")
            if not np.isfinite(vector).all():
                raise UsageError(f"{name} is {vector}; expected finite numbers")
        numbers = [float(number) for _, vector, _ in vectors for number in vector]
        self._native.reference(numbers, attitude is not None, float(valid))

    def observe(self, topic: str, *, seconds: float | None = None, timeout: float | None = SILENCE_S) -> Observation:
        """Messages of a topic of docs/recordings.md from now on, for ``seconds``; after ``timeout`` without one, ``PeerError``."""
        duration = np.inf if seconds is None else float(seconds)
        if not duration > 0.0:
            raise UsageError(f"seconds is {seconds}; expected a number above 0")
        return Observation(self._native.observe(topic, duration), duration, timeout, topic)

    def poses(self, *, seconds: float | None = None, timeout: float | None = SILENCE_S) -> Observation:
        """Poses as measured by the cameras."""
        return self.observe("pose", seconds=seconds, timeout=timeout)

    def telemetry(self, *, seconds: float | None = None, timeout: float | None = SILENCE_S) -> Observation:
        """State, decisions and counters of the daemon, one message in each tick."""
        return self.observe("telemetry", seconds=seconds, timeout=timeout)

    def events(self, *, seconds: float | None = None) -> Observation:
        """Changes of mode and state, requests of operators, processes that come and go: ``t_s`` [s] from now on, and ``event``."""
        return self.observe("events", seconds=seconds, timeout=None)

    def __repr__(self) -> str:
        return f"<Instance {self.name}>"


@check_names
def connect(instance: str | None = None, *, root: str | None = None, config: ConfigLike = None) -> Instance:
    """Connects to a running instance, by default that of the configuration.

    Raises ``PeerError`` if no daemon answers, and ``VersionError`` if its messages are of another version.
    In a forked process it raises ``UsageError``: start processes by the method ``spawn``.
    """
    named = sources(config, instance=("instance.name", instance), root=("instance.root", root))
    return Instance(_native.Connection(named))
