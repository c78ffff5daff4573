"""Arguments of calls as settings of the configuration."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from oqtal.errors import UsageError

#: A file, several files of which later ones override earlier ones, or keys with values.
ConfigLike: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, Any] | None"
#: Origin, key, value.
Setting: TypeAlias = tuple[str, str, Any]
#: Files and settings, as the extension module takes them.
Sources: TypeAlias = tuple[list[str], list[Setting]]


def flat(values: Mapping[str, Any], origin: str, section: str = "") -> Iterator[Setting]:
    """Settings of nested or dotted keys. A keyword such as ``mass_kg`` stands for the key ``mass-kg``."""
    for name, value in values.items():
        if not isinstance(name, str):
            raise UsageError(f"{origin}: a key is a text, as in {{'mass-kg': 0.6}}; found {name!r}")
        key = section + name.replace("_", "-")
        if isinstance(value, Mapping):
            yield from flat(value, origin, key + ".")
        else:
            yield (origin, key, value)


def sources(
    config: ConfigLike,
    settings: Mapping[str, Any] | None = None,
    plant: Mapping[str, Any] | None = None,
    **named: tuple[str, Any],
) -> Sources:
    """Files and settings of a call; ``named`` are arguments with their keys, left out if their value is ``None``."""
    files: list[str] = []
    given: list[Setting] = []
    if isinstance(config, Mapping):
        given += flat(config, "config")
    elif isinstance(config, (str, os.PathLike)):
        files = [os.fspath(config)]
    elif config is not None:
        files = [os.fspath(file) for file in config]
    given += flat(settings or {}, "settings")
    given += flat(plant or {}, "plant", "plant.")
    given += [(origin, key, value) for origin, (key, value) in named.items() if value is not None]
    return files, given


def texts(values: str | Sequence[str] | None) -> list[str] | None:
    """One text as a list of one; ``None`` for none."""
    if values is None or isinstance(values, str):
        return None if values is None else [values]
    return list(values) or None
