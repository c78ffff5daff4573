"""oqtal for Python: flights of a multirotor in an indoor laboratory, in this process.

>>> import oqtal
>>> flight = oqtal.fly(controller="oqtal-dt", trajectory="hover", seed=7)
>>> flight.summary["outcome"]
'landed'
"""

from typing import TYPE_CHECKING, Any

from oqtal import _native, paper
from oqtal.errors import (
    AccessError,
    ConfigError,
    DataError,
    FlightError,
    InternalError,
    LawError,
    OqtalError,
    PeerError,
    SystemFailure,
    UsageError,
    VersionError,
)
from oqtal.flight import Flight, fly
from oqtal.instance import Instance, Observation, connect
from oqtal.python_law import Command, Reference, State, law, serve
from oqtal.studies import Identification, Tuned, campaign, identify, laws, robustness, sweep, tune
from oqtal.table import Table

__version__ = _native.VERSION
__revision__ = _native.REVISION

if TYPE_CHECKING:
    from oqtal.gym import OqtalVectorEnv


def make_vec(num_envs: int, env: str = "Oqtal-Hover-v0", **options: Any) -> "OqtalVectorEnv":
    """Vehicles in an environment of ``oqtal.gym``, stepped in Rust on all processors; requires gymnasium."""
    from oqtal import gym

    return gym.make_vec(num_envs, env, **options)


__all__ = [
    "AccessError",
    "Command",
    "ConfigError",
    "DataError",
    "Flight",
    "FlightError",
    "Identification",
    "Instance",
    "InternalError",
    "LawError",
    "Observation",
    "OqtalError",
    "PeerError",
    "Reference",
    "State",
    "SystemFailure",
    "Table",
    "Tuned",
    "UsageError",
    "VersionError",
    "__revision__",
    "__version__",
    "campaign",
    "connect",
    "fly",
    "identify",
    "law",
    "laws",
    "make_vec",
    "paper",
    "robustness",
    "serve",
    "sweep",
    "tune",
]
