"""Environments of Gymnasium: hover, track, recover, with cameras, delays, radio and noise in the loop.

One step is one control tick, 1/60 s as shipped. Importing this module registers ``Oqtal-Hover-v0``, ``Oqtal-Track-v0`` and
``Oqtal-Recover-v0``.

Action, four numbers from -1 to 1: body rates about x, y, z over the greatest ones, and thrust, where -1 is none and 1 the greatest.

Observation, 25 numbers, as the cameras give them some 15 ms late: position and velocity relative to the reference [m, m/s, world],
attitude (quaternion, body to world, scalar last and not negative), body rate [rad/s], and the last three actions with the newest
first, of which some have not reached the vehicle yet (thrust from 0 to 1). Velocity and rate are filtered differences of poses.

Reward: ``n = 1 / (1 + (e / 0.3 m)^2)`` for the true distance ``e`` from the reference, less 0.02 for each rad/s of body rate and
0.02 times the norm of the change of the action, with thrust from 0 to 1. ``Recover`` has ``n / 2 + (1 + cos(tilt)) / 4`` in place
of ``n``. An episode is terminated when the vehicle is 2 m from its reference or on the floor, and truncated after its duration.

``Hover`` and ``Recover`` hold the first point of ``[trajectory]``, as shipped (1.3, 0, 1) m. The seed draws the start: ``Hover``
within 0.3 m, 0.3 m/s, 0.2 rad and 0.3 rad/s on each axis, ``Track`` within 0.02 m of the reference, ``Recover`` within 0.5 m, 1 m/s
and 1 rad/s at any attitude. ``gymnasium.make`` and ``make_vec`` take ``duration`` [s], and like ``oqtal.fly`` ``config``, ``plant``
and ``settings``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NoReturn, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from oqtal import _native
from oqtal.errors import UsageError
from oqtal.settings import ConfigLike, check_names, integer, sources

Array = NDArray[Any]

#: Tasks by the names of their environments.
TASKS = {"Oqtal-Hover-v0": "hover", "Oqtal-Track-v0": "track", "Oqtal-Recover-v0": "recover"}
#: Duration of an episode [s].
DURATION_S = 8.0


def _spaces() -> tuple[spaces.Box, spaces.Box]:
    observation = spaces.Box(-np.inf, np.inf, (_native.OBSERVATION,), np.float32)
    return observation, spaces.Box(-1.0, 1.0, (4,), np.float32)


def _lanes(
    task: str,
    count: int,
    seed: int,
    duration: float,
    threads: int,
    call: tuple[ConfigLike, Mapping[str, Any] | None, Mapping[str, Any] | None],
) -> _native.Lanes:
    return _native.Lanes(sources(*call), task, count, seed, (float(duration), integer("threads", threads, 0, 1024)))


class _ClosedLanes:
    """Stands in for the lanes of a closed environment; every use raises ``UsageError``."""

    def __getattr__(self, name: str) -> NoReturn:
        raise UsageError("the environment is closed; make a new one")


#: Assigned in place of lanes, which releases their memory and ends their threads.
_CLOSED = cast(_native.Lanes, _ClosedLanes())


def _later_seed(seed: int) -> int:
    """First seed of later episodes. Those of different ``seed`` lie far apart, so that two runs share none."""
    return int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0] >> np.uint64(2))


def _numbers(actions: Any) -> Array:
    return np.asarray(actions, dtype=float)


class OqtalEnv(gymnasium.Env[Array, Array]):
    """One vehicle."""

    metadata = {"render_modes": []}  # noqa: RUF012

    @check_names
    def __init__(
        self,
        task: str = "hover",
        *,
        config: ConfigLike = None,
        plant: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        duration: float = DURATION_S,
        render_mode: str | None = None,
    ) -> None:
        self.observation_space, self.action_space = _spaces()
        self.render_mode = render_mode
        self._lanes = _lanes(task, 1, 0, duration, 1, (config, settings, plant))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begins the episode of ``seed``; without one, of a random seed."""
        given = None if seed is None else integer("seed", seed)
        super().reset(seed=given)
        episode = int(self.np_random.integers(2**31)) if given is None else given
        seen = self._lanes.reset([episode])
        return seen[0], {"seed": episode, **self._info()}

    def _info(self) -> dict[str, Any]:
        """Truth, and position [m] and velocity [m/s] of the reference, for rewards of one's own."""
        return {"truth": self._lanes.truths()[0], "reference": self._lanes.references()[0]}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Flies for one control tick."""
        seen, reward, terminated, truncated = self._lanes.act(_numbers(action), False)
        return seen[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), self._info()

    def close(self) -> None:
        """Releases the vehicle; the environment cannot be used any more."""
        self._lanes = _CLOSED


class OqtalVectorEnv(VectorEnv[Array, Array, Array]):
    """Vehicles stepped together on all processors. A lane whose episode has ended begins the next one in the following step."""

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    @check_names
    def __init__(
        self,
        num_envs: int = 1,
        task: str = "hover",
        *,
        config: ConfigLike = None,
        plant: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        duration: float = DURATION_S,
        threads: int = 0,
    ) -> None:
        self.num_envs = integer("num_envs", num_envs, 1, 2**20)
        self.single_observation_space, self.single_action_space = _spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._lanes = _lanes(task, num_envs, 0, duration, threads, (config, settings, plant))

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begins new episodes: of the seeds ``seed``, ``seed + 1``, …, of a list of seeds, or of the next ones.

        After an integer, the seeds of later episodes count from a large number that follows from it; after a list, from the number
        after its greatest one. ``None`` in a list, and ``False`` in ``options["reset_mask"]``, let the episode of a lane go on.
        """
        later: int | None = None
        if isinstance(seed, Sequence):
            seeds = [None if each is None else integer("a seed", each) for each in seed]
        else:
            first = self._lanes.next_seed() if seed is None else integer("seed", seed)
            seeds = [first + lane for lane in range(self.num_envs)]
            later = None if seed is None else _later_seed(first)
        if (mask := (options or {}).get("reset_mask")) is not None:
            if np.shape(mask) != (self.num_envs,):
                raise UsageError(f"reset_mask has the shape {np.shape(mask)}; expected ({self.num_envs},)")
            seeds = [each if chosen else None for each, chosen in zip(seeds, mask, strict=False)]
        return self._lanes.reset(seeds, later), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Flies every vehicle for one control tick."""
        seen, rewards, terminated, truncated = self._lanes.act(_numbers(actions), True)
        return seen, rewards, terminated, truncated, {}

    def close_extras(self, **kwargs: Any) -> None:
        """Called by ``close``: releases the vehicles and ends their threads; the environment cannot be used any more."""
        self._lanes = _CLOSED

    def truths(self) -> Array:
        """True position [m, world], velocity [m/s, world], attitude (quaternion, body to world, scalar last), body rate [rad/s] and
        time [s] of every vehicle, 14 numbers each."""
        return self._lanes.truths()

    def references(self) -> Array:
        """Position [m, world] and velocity [m/s, world] of the reference of every vehicle, 6 numbers each."""
        return self._lanes.references()


def make_vec(num_envs: int, env: str = "Oqtal-Hover-v0", **options: Any) -> OqtalVectorEnv:
    """``num_envs`` vehicles in the environment ``env``, stepped in Rust on all processors."""
    if env not in TASKS:
        raise UsageError(f"`{env}` is not an environment; expected one of {', '.join(TASKS)}")
    return OqtalVectorEnv(num_envs, TASKS[env], **options)


for _name, _task in TASKS.items():
    gymnasium.register(
        _name,
        entry_point="oqtal.gym:OqtalEnv",
        vector_entry_point="oqtal.gym:OqtalVectorEnv",
        kwargs={"task": _task},
    )
