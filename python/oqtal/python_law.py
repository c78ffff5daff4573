"""Laws written in Python: in a flight of this process, or as a process beside a daemon.

A law is a callable ``law(state, reference, dt)``, or an object with a method ``step(state, reference, dt)`` and, where it has an
integral or a filter, ``reset()``, which is called at the start of a flight. It returns a ``Command``, the pair ``(rate, thrust)``,
or four numbers: body rates [rad/s] and thrust [N]. State and reference are those at the instant at which the command takes effect.
Rates, torque and thrust are limited to the range of the vehicle; ``Flight.limited`` counts such commands.
"""

from __future__ import annotations

import socket
import struct
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from oqtal.errors import LawError, PeerError

Vector = NDArray[np.float64]
Law = TypeVar("Law")

#: Numbers of a question after its counters and instants, in order, with their lengths: ``oqtal.State.v1`` in docs/your-own-law.md.
LENGTHS = {
    "period": 1, "position": 3, "velocity": 3, "attitude": 4, "rate": 3, "thrust": 1, "acceleration_bias": 3, "demand_bias": 3,
    "reference_position": 3, "reference_velocity": 3, "reference_yaw": 1, "reference_attitude": 4, "reference_rate": 3,
    "fallback_rate": 3, "fallback_torque": 3, "fallback_attitude": 4, "fallback_thrust": 1,
    "mass": 1, "gravity": 1, "greatest_thrust": 1, "greatest_rate": 3, "greatest_torque": 1,
    "reference_acceleration": 3, "reference_jerk": 3,
}  # fmt: skip
#: Counters and instants before them.
COUNTERS = struct.Struct("<8s6Q")
#: Beginning of a question, and its length [bytes].
QUESTION = b"OQTALST1"
QUESTION_LENGTH = COUNTERS.size + 8 * sum(LENGTHS.values())
#: Beginning of an answer, and its counter.
ANSWER = struct.Struct("<8sQ")


def _shown(value: object) -> str:
    """A state or a reference with its fields, for debugging."""
    fields = (
        f"{name}={np.round(field, 4) if isinstance(field, (float, np.ndarray)) else field}" for name, field in vars(value).items()
    )
    return f"{type(value).__name__}({', '.join(fields)})"


def _fields(numbers: Vector) -> Iterator[tuple[str, Any]]:
    start = 0
    for name, length in LENGTHS.items():
        yield name, float(numbers[start]) if length == 1 else numbers[start : start + length]
        start += length


class State:
    """The vehicle at the instant at which the command takes effect. Vectors are arrays of NumPy, and cannot be written.

    ``position`` [m, world], ``velocity`` [m/s, world].
    ``attitude``: a quaternion from body to world with the scalar last; ``rate`` [rad/s, body]; ``yaw`` [rad].
    ``thrust`` along body z [N].
    ``acceleration_bias``: estimated acceleration by other causes than thrust, weight and drag [m/s^2, world].
    ``demand_bias``: estimated error of the command [rad/s, body; of a vehicle commanded by torque rad/s^2].
    ``fallback_rate`` [rad/s, body], ``fallback_thrust`` [N]: command of the built-in law that flies if this one fails.
    ``mass`` [kg], ``gravity`` [m/s^2], ``greatest_thrust`` [N], ``greatest_rate`` [rad/s]: the model of the vehicle.
    ``time``: instant of the tick [s], of which only differences have a meaning; ``period`` of the loop [s].
    ``flown``: whether the last command of the law was flown; while it is not, an integral should stop.

    For a vehicle commanded by torque or attitude also ``greatest_torque`` [N m], ``fallback_torque`` [N m, body] and
    ``fallback_attitude``.
    """

    position: Vector
    velocity: Vector
    attitude: Vector
    rate: Vector
    thrust: float
    acceleration_bias: Vector
    demand_bias: Vector
    fallback_rate: Vector
    fallback_thrust: float
    fallback_torque: Vector
    fallback_attitude: Vector
    mass: float
    gravity: float
    greatest_thrust: float
    greatest_rate: Vector
    greatest_torque: float
    time: float
    period: float
    flown: bool

    def __init__(self, numbers: Vector, flown: bool, time: float) -> None:
        self.__dict__.update(_fields(numbers), flown=flown, time=time)

    __repr__ = _shown

    def to_body(self, vector: Any) -> Vector:
        """Components in body axes of a vector in world axes."""
        axis, scalar = -self.attitude[:3], self.attitude[3]
        once = 2.0 * np.cross(axis, vector)
        return np.asarray(vector + scalar * once + np.cross(axis, once))

    @property
    def yaw(self) -> float:
        """Yaw [rad]."""
        x, y, z, w = self.attitude
        return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


class Reference:
    """The reference at the instant at which the command takes effect.

    ``position`` [m, world], ``velocity`` [m/s, world; zero where the position jumps], ``yaw`` [rad].
    ``acceleration`` [m/s^2, world], ``jerk`` [m/s^3, world]: those of the trajectory, or of a planner whose references continue one
    another; the jerk is zero on the way of a ``goto``.
    ``attitude``, ``rate`` [rad/s, body]: prescribed in place of the horizontal position; ``None`` if none is.
    """

    def __init__(self, state: Any) -> None:
        self.position: Vector = state.reference_position
        self.velocity: Vector = state.reference_velocity
        self.acceleration: Vector = state.reference_acceleration
        self.jerk: Vector = state.reference_jerk
        self.yaw: float = state.reference_yaw
        self.attitude: Vector | None = None if np.isnan(state.reference_attitude[0]) else state.reference_attitude
        self.rate: Vector | None = None if self.attitude is None else state.reference_rate

    __repr__ = _shown


@dataclass
class Command:
    """Command of a law: body rates ``rate`` [rad/s], ``thrust`` along body z [N].

    ``torque`` [N m, body] for a vehicle commanded by torque; ``attitude``, body to world with the scalar last, for one that holds
    attitudes: without it the fallback law flies.
    """

    rate: Any
    thrust: float
    torque: Any = None
    attitude: Any = (0.0, 0.0, 0.0, 0.0)


def _numbers(value: Any, length: int, name: str) -> Vector:
    wanted, shape = (f"{length} numbers", (length,)) if length > 1 else ("a number", ())
    try:
        if np.iscomplexobj(value):
            raise TypeError
        found = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise LawError(f"{name} of the law's command is {value!r}; expected {wanted}") from error
    if found.shape != shape:
        raise LawError(f"{name} of the law's command has the shape {found.shape}; expected {wanted}")
    if not np.isfinite(found).all():
        raise LawError(f"{name} of the law's command is {found}; expected finite numbers")
    return found


def _command(value: Any) -> Command:
    if isinstance(value, Command):
        return value
    try:
        parts = list(value)
    except TypeError:
        parts = []
    if len(parts) == 2:
        return Command(parts[0], parts[1])
    if len(parts) == 4:
        return Command(parts[:3], parts[3])
    raise LawError(f"the law returned {value!r}; expected (rates, thrust), four numbers, or an oqtal.Command")


class LawAdapter:
    """Adapter between a flight and a law: converts questions and answers to arrays."""

    def __init__(self, law: Any) -> None:
        law = law() if isinstance(law, type) else law
        step = getattr(law, "step", law)
        if not callable(step):
            raise LawError(f"{law!r} is not a law: expected a function (state, reference, dt), or an object with the method step")
        self._step: Callable[[State, Reference, float], Any] = step
        self._reset: Callable[[], object] | None = getattr(law, "reset", None)
        #: Computing times of the newest commands [s].
        self.answer_s: deque[float] = deque(maxlen=2**16)
        #: Number of commands that were limited to the range of the vehicle.
        self.limited = 0
        #: Instant of the first question of the flight [s].
        self._first: float | None = None

    def reset(self) -> None:
        """A flight begins."""
        self._first = None
        if self._reset is not None:
            try:
                self._reset()
            except Exception as error:
                raise LawError(f"reset of the law raised {type(error).__name__}: {error}") from error

    def answer(self, numbers: Vector, flown: bool, time_s: float) -> Vector:
        """The command for a question: rates, torque, attitude, thrust."""
        if self._first is None:
            self._first = time_s
        began = time.perf_counter()
        try:
            return self._answer(numbers, flown, time_s)
        except Exception as error:
            # `str(error)` may itself raise; `traceback` handles that.
            text = "".join(traceback.format_exception_only(error)).strip()
            message = str(error) if isinstance(error, LawError) else f"the law raised {text}"
            cause = error.__cause__ if isinstance(error, LawError) else error
            raise LawError(f"{message} ({time_s - self._first:.2f} s after the first question)") from cause
        finally:
            self.answer_s.append(time.perf_counter() - began)

    def _answer(self, numbers: Vector, flown: bool, time_s: float) -> Vector:
        numbers.flags.writeable = False
        state = State(numbers, flown, time_s)
        command = _command(self._step(state, Reference(state), state.period))
        if command.torque is None and state.fallback_torque.any():
            raise LawError("the vehicle is commanded by torque; return oqtal.Command(rate, thrust, torque=...)")
        torque = np.zeros(3) if command.torque is None else _numbers(command.torque, 3, "torque")
        given = np.concatenate([_numbers(command.rate, 3, "rate"), torque, [_numbers(command.thrust, 1, "thrust")]])
        most = np.concatenate([state.greatest_rate, np.full(3, state.greatest_torque), [state.greatest_thrust]])
        limited = np.clip(given, np.append(-most[:6], 0.0), most)
        self.limited += bool((limited != given).any())
        return np.concatenate([limited[:6], _numbers(command.attitude, 4, "attitude"), limited[6:]])


def _received(daemon: socket.socket) -> bytes:
    """The next question; none once the daemon has ended."""
    try:
        return daemon.recv(4096)
    except ConnectionError:
        return b""


def serve(law: Any, path: str) -> int:
    """Answers the questions of the daemon behind the socket ``path`` until it ends; returns the number of answers."""
    adapter, answers, flight = LawAdapter(law), 0, None
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as daemon:
        try:
            daemon.connect(path)
        except OSError as error:
            remedy = 'start a daemon with control.controller = "external", or give `law` in the directory of its instance'
            raise PeerError(f"{path}: {error}; {remedy}") from error
        while packet := _received(daemon):
            if len(packet) != QUESTION_LENGTH or not packet.startswith(QUESTION):
                raise PeerError(f"{path}: a question of another version; install the package oqtal of the daemon's version")
            _, sequence, number, flown, time_ns, *_ = COUNTERS.unpack_from(packet)
            if number != flight:
                flight = number
                adapter.reset()
            numbers = np.frombuffer(packet, dtype="<f8", offset=COUNTERS.size)
            answer = adapter.answer(numbers, bool(flown), 1e-9 * time_ns)
            try:
                daemon.send(ANSWER.pack(b"OQTALEX1", sequence) + answer.astype("<f8").tobytes())
            except ConnectionError:
                break
            answers += 1
    if answers == 0:
        raise PeerError(f"{path}: closed before the first question: end another law at this socket, or start the daemon again")
    return answers


def law(law: Law) -> Law:
    """Decorator: in a program that is executed with the path of a daemon's socket as its argument, answers that daemon."""
    is_program = getattr(law, "__module__", None) == "__main__"
    if is_program and len(sys.argv) == 2:
        serve(law, sys.argv[1])
    return law
