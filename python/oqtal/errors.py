"""Exceptions: one class for each kind of failure of the program, each with the program's message."""

from __future__ import annotations

from typing import Any


class OqtalError(Exception):
    """Base of all exceptions of this package."""

    #: Exit code of the program for the same failure.
    exit_code = 70


class FlightError(OqtalError):
    """A flight did not end as requested, or the daemon refused a request."""

    exit_code = 1


class LawError(FlightError):
    """A law written in Python raised an exception, or returned something that is not a command.

    ``flight``: the flight until then, an ``oqtal.Flight``; ``None`` if the law failed before it or beside a daemon.
    """

    flight: Any = None


class UsageError(OqtalError, ValueError):
    """An argument is wrong."""

    exit_code = 64


class DataError(OqtalError, ValueError):
    """Input data are invalid: a recording, a file of waypoints, an equation without a solution."""

    exit_code = 65


class InternalError(OqtalError, RuntimeError):
    """Defect of this package."""


class SystemFailure(OqtalError, OSError):
    """The operating system refused."""

    exit_code = 71


class PeerError(OqtalError, ConnectionError):
    """No daemon answers, or another controller holds the instance."""

    exit_code = 75


class VersionError(OqtalError):
    """The running processes, or a recording, are of another version."""

    exit_code = 76


class AccessError(OqtalError, PermissionError):
    """No permission."""

    exit_code = 77


class ConfigError(OqtalError, ValueError):
    """The configuration is wrong; the message names file and line, or the argument."""

    exit_code = 78
