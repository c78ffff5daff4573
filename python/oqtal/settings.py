"""Arguments of calls as settings of the configuration."""

from __future__ import annotations

import functools
import inspect
import operator
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ParamSpec, TypeAlias, TypeVar

from oqtal import _native
from oqtal.errors import SystemFailure, UsageError

#: A file, several files of which later ones override earlier ones, or keys with values.
ConfigLike: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, Any] | None"
#: Origin, key, value.
Setting: TypeAlias = tuple[str, str, Any]
Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
#: Files and settings, as the extension module takes them; without a list of files the settings are complete.
Sources: TypeAlias = tuple[list[str] | None, list[Setting]]


def flat(values: Mapping[str, Any], origin: str, section: str = "") -> Iterator[Setting]:
    """Settings of nested or dotted keys. A keyword such as ``mass_kg`` stands for the key ``mass-kg``."""
    if not isinstance(values, Mapping):
        raise UsageError(f"{origin} is {values!r}; expected a dictionary, as in {{'mass-kg': 0.6}}")
    for name, value in values.items():
        if not isinstance(name, str):
            raise UsageError(f"{origin}: a key is a text, as in {{'mass-kg': 0.6}}; found {name!r}")
        key = section + name.replace("_", "-")
        if isinstance(value, Mapping):
            yield from flat(value, origin, key + ".")
        else:
            yield (origin, key, value)


def check_names(call: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorator: an argument that ``call`` does not have is a ``UsageError`` that names the nearest one."""
    known = [name for name in inspect.signature(call).parameters if name != "self"]
    name = call.__qualname__.removesuffix(".__init__")

    @functools.wraps(call)
    def checked(*arguments: Parameters.args, **named: Parameters.kwargs) -> Result:
        for given in named:
            if given not in known:
                near = get_close_matches(given, known, 1)
                remedy = f"did you mean `{near[0]}`?" if near else f"it has {', '.join(known)}"
                raise UsageError(f"{name} has no argument `{given}`; {remedy}")
        return call(*arguments, **named)

    return checked


def integer(name: str, value: Any, least: int = 0, most: int = 2**63 - 1) -> int:
    """``value`` as an integer of Python; integers of NumPy are accepted."""
    try:
        found = operator.index(value)
    except TypeError:
        draw = "; of a random generator give rng.integers(2**31)" if hasattr(value, "integers") else ""
        raise UsageError(f"{name} is {value!r}; expected an integer{draw}") from None
    if not least <= found <= most:
        raise UsageError(
            f"{name} is {found}; expected {least} to {most}"
            if most < 2**63 - 1 or found > most
            else f"{name} is {found}; expected at least {least}"
        )
    return found


def positive(name: str, value: Any) -> float | None:
    """``value`` as a finite number above zero; ``None`` as it is."""
    if value is not None and not 0.0 < float(value) < float("inf"):
        raise UsageError(f"{name} is {value}; expected a number above 0")
    return None if value is None else float(value)


def sources(
    config: ConfigLike,
    settings: Mapping[str, Any] | None = None,
    plant: Mapping[str, Any] | None = None,
    *,
    set_by: Mapping[str, str] | None = None,
    **named: tuple[str, Any],
) -> Sources:
    """Files and settings of a call; ``named`` are arguments with their keys, left out if their value is ``None``.

    ``set_by``: keys that the call sets itself, with the argument that determines them. A key of ``settings`` or ``plant`` is given
    once; it overrides ``config``.
    """
    files: list[str] = []
    given: list[Setting] = []
    if isinstance(config, Mapping):
        given += flat(config, "config")
    elif isinstance(config, (str, os.PathLike)):
        files = [os.fspath(config)]
    elif config is not None and not isinstance(config, Sequence):
        raise UsageError(f"config is {config!r}; expected a file, several files, or a dictionary")
    elif config is not None:
        files = [os.fspath(file) for file in config]
    own = [*flat(settings or {}, "settings"), *flat(plant or {}, "plant", "plant.")]
    own += [(origin, key, value) for origin, (key, value) in named.items() if value is not None]
    if origin := next((origin for origin, key, _ in given + own if key == "clock.kind"), None):
        reason = "clock.kind: flights of this package are in virtual time; `oqtal fly` flies in real time"
        raise UsageError(f"{origin}: {reason}")
    origins: dict[str, str] = {}
    for origin, key, _ in own:
        if set_by and key in set_by:
            raise UsageError(f"{origin}: {key} is set by this call; {set_by[key]}")
        if key in origins:
            raise UsageError(f"{key} is given by {origins[key]} and by {origin}; give it once")
        origins[key] = origin
    return files, given + own


def warn(call: Sources) -> None:
    """Warns of settings that a flight cannot satisfy, such as a fault after its end, at the line that called the caller."""
    for text in _native.warnings(call):
        # This function, its caller, the decorator, the user.
        warnings.warn(without_options(text), stacklevel=4)


def warn_of_study(depth: int = 5) -> None:
    """Issues the warnings of a study, such as gains that were found for another vehicle, ``depth`` calls above."""
    for text in _native.notes():
        # This function, `_fly`, the study, the decorator, the user.
        warnings.warn(without_options(text), stacklevel=depth)


def without_options(text: str) -> str:
    """The warning ``text`` of the program with a key in place of the option of its command."""
    return text.replace("--duration", "trajectory.duration-s")


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Writes a file and returns its path."""
    try:
        Path(path).write_text(text)
    except OSError as error:
        raise SystemFailure(f"{path}: {error.strerror}; give another path") from error
    return Path(path)


def texts(values: str | Sequence[str] | None) -> list[str] | None:
    """One text as a list of one; ``None`` for none."""
    if not isinstance(values, (str, Sequence, type(None))):
        raise UsageError(f"{values!r} is neither a text nor a list of texts")
    if values is None or isinstance(values, str):
        return None if values is None else [values]
    return list(values) or None
