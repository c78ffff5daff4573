"""Environments: Gymnasium's checks, and lanes equal to flights."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest

import oqtal
from oqtal import _native

gymnasium = pytest.importorskip("gymnasium")

from oqtal import gym  # noqa: E402

#: Action of the thrust that carries the weight.
HOVER = 2 * 0.5 * 9.81 / 20 - 1


@pytest.mark.parametrize("name", gym.TASKS)
@pytest.mark.filterwarnings("ignore:.*infinity:UserWarning")
def test_environments_pass_the_check(name):
    from gymnasium.utils.env_checker import check_env

    check_env(gymnasium.make(name).unwrapped, skip_render_check=True)


def truth_of(flight: oqtal.Flight) -> np.ndarray:
    vectors = ("true_{}_m", "true_v{}_m_s", "true_q{}", "true_rate_{}_rad_s")
    return np.hstack([flight.vector(name) for name in vectors])


def commands_of(flight: oqtal.Flight) -> np.ndarray:
    actions = np.column_stack([flight[f"stick_{axis}"] for axis in ("roll", "pitch", "yaw")] + [flight["thrust"]])
    armed = np.isin(flight["mode"], ["flying", "landing"])
    return np.where(armed[:, None], actions, np.nan)


def assert_lanes_equal(flights: list[oqtal.Flight], seed: int, sources) -> None:
    """Lanes with the commands of flights have their truth and their poses, bit for bit."""
    lanes = _native.Lanes(sources, "floor", len(flights), seed, (1e9, 0))
    count = min(len(flight["t_s"]) for flight in flights)
    commands = np.stack([commands_of(flight)[:count] for flight in flights])
    truths = np.stack([truth_of(flight)[:count] for flight in flights])
    poses = np.stack([np.hstack([f.vector("pose_{}_m"), f.vector("pose_q{}")])[:count] for f in flights])
    times = np.stack([np.round(1e9 * (flight["t_s"] - flight["t_s"][0]))[:count] for flight in flights])
    began = lanes.truths()[:, 13]
    for tick in range(count):
        np.testing.assert_array_equal(lanes.truths()[:, :13], truths[:, tick], f"tick {tick}")
        np.testing.assert_array_equal(np.round(1e9 * (lanes.truths()[:, 13] - began)), times[:, tick], f"tick {tick}")
        seen = lanes.poses()
        known = ~np.isnan(poses[:, tick])
        np.testing.assert_array_equal(seen[known], poses[:, tick][known], f"tick {tick}")
        lanes.command(commands[:, tick])


#: Flights of each law: OQTAL_TEST_LANES=200 takes some minutes. Removed, since OQTAL_ variables are settings.
LANES = int(os.environ.pop("OQTAL_TEST_LANES", "12"))


@pytest.mark.parametrize("law", ["pid", "oqtal", "oqtal-dt"])
def test_every_lane_equals_the_flight_of_its_seed(law):
    flights = [oqtal.fly(controller=law, seed=seed) for seed in range(300, 300 + LANES)]
    assert_lanes_equal(flights, 300, ([], []))


@pytest.mark.parametrize(
    "fault",
    [
        "command:off@5+0.1",
        "command:delayed=40ms@5+3",
        "command:intermittent=30%@5+3",
        "command:wrong=80%@6+0.3",
        "command:stuck@5+0.2",
        "pose:off@5+0.05",
        "pose:delayed=30ms@5+3",
        "pose:intermittent=20%@5+3",
        "pose:noise=2mm@5+3",
        "radio:delayed=30ms@5+3",
    ],
)
def test_lanes_have_the_faults_of_flights(fault):
    flights = [
        oqtal.fly(controller="oqtal-dt", trajectory="hover", duration=6, seed=seed, faults=fault) for seed in range(300, 302)
    ]
    assert_lanes_equal(flights, 300, ([], [("t", "fault.inject", [fault])]))


def test_lanes_have_cameras_and_disturbances_of_flights():
    arguments = {
        "settings": {"mocap.preset": "measured", "plant.fidelity": "rotors"},
        "disturb": ["gust@8+2=0,3,0m/s", "mass@12=0.05kg"],
    }
    flights = [oqtal.fly(seed=seed, **arguments) for seed in range(2)]
    settings = [
        ("t", "mocap.preset", "measured"),
        ("t", "plant.fidelity", "rotors"),
        ("t", "plant.disturb", arguments["disturb"]),
    ]
    assert_lanes_equal(flights, 0, ([], settings))


def test_lanes_do_not_depend_on_threads_and_neighbours():
    actions = np.random.default_rng(1).uniform(-0.05, 0.05, (40, 7, 4)) + np.array([0.0, 0.0, 0.0, HOVER])
    histories = []
    for threads in (1, 2, 7):
        env = oqtal.make_vec(7, threads=threads)
        env.reset(seed=5)
        histories.append([env.step(action)[0] for action in actions])
    np.testing.assert_array_equal(histories[0], histories[1])
    np.testing.assert_array_equal(histories[0], histories[2])
    single = gymnasium.make("Oqtal-Hover-v0").unwrapped
    single.reset(seed=8)
    alone = [single.step(action[3])[0] for action in actions]
    np.testing.assert_array_equal(alone, np.array(histories[0])[:, 3])


def test_an_episode_that_has_ended_begins_anew_in_the_next_step():
    env = oqtal.make_vec(3, duration=0.2)
    env.reset(seed=1)
    hover = np.tile([0.0, 0.0, 0.0, 0.0], (3, 1))
    ends = [env.step(hover)[3] for _ in range(30)]
    over = np.flatnonzero(np.array(ends)[:, 0])
    assert len(over) >= 2 and (np.diff(over) > 5).all()
    _, rewards, *_ = env.step(np.tile([0.0, 0.0, 0.0, -1.0], (3, 1)))
    assert np.isfinite(rewards).all()
    with pytest.raises(oqtal.UsageError, match="actions are not finite"):
        env.step(np.full((3, 4), np.nan))


def test_a_partial_reset_leaves_the_other_lanes_as_they_are():
    env = oqtal.make_vec(2, duration=0.2)
    env.reset(seed=1)
    hover = np.tile([0.0, 0.0, 0.0, HOVER], (2, 1))
    while not env.step(hover)[3].any():
        pass
    env.reset(seed=[5, None])
    began = env.truths()[:, 13]
    env.step(hover)
    assert env.truths()[0, 13] > began[0]
    assert env.truths()[1, 13] < began[1], "its episode had ended"


def test_a_mask_selects_the_lanes_that_are_reset():
    env = oqtal.make_vec(2)
    env.reset(seed=1)
    hover = np.tile([0.0, 0.0, 0.0, HOVER], (2, 1))
    env.step(hover)
    began = env.truths()[:, 13]
    env.reset(options={"reset_mask": np.array([True, False])})
    after = env.truths()[:, 13]
    assert after[0] < began[0] and after[1] == began[1]
    with pytest.raises(oqtal.UsageError, match="reset_mask"):
        env.reset(options={"reset_mask": [True]})


def test_each_thread_gets_the_results_of_its_own_step():
    env = oqtal.make_vec(4, duration=1e3)
    env.reset(seed=1)
    seen: list[tuple[float, float]] = []

    def fly(action: float) -> None:
        actions = np.tile([action, 0.0, 0.0, HOVER], (4, 1))
        # The newest of the past actions in an observation.
        seen.extend((action, float(number)) for _ in range(20) for number in env.step(actions)[0][:, 13])

    threads = [threading.Thread(target=fly, args=(action,)) for action in (0.01, 0.02)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 2 * 20 * 4
    assert all(found == pytest.approx(action) for action, found in seen)


def test_vehicles_that_fall_are_terminated():
    env = oqtal.make_vec(2)
    env.reset(seed=1)
    fallen = [env.step(np.tile([0.0, 0.0, 0.0, -1.0], (2, 1)))[2] for _ in range(60)]
    assert np.any(fallen, axis=0).all()


def test_hover_can_be_held():
    # A proportional law on the observation: the environment is stable under a plain controller.
    env = oqtal.make_vec(8, duration=4.0)
    seen, _ = env.reset(seed=2)
    total = np.zeros(8)
    for _ in range(200):
        position, velocity, attitude = seen[:, :3], seen[:, 3:6], seen[:, 6:10]
        tilt = np.clip(-0.6 * position[:, :2] - 0.5 * velocity[:, :2], -0.3, 0.3)
        rates = np.column_stack([-tilt[:, 1] - 2 * attitude[:, 0], tilt[:, 0] - 2 * attitude[:, 1], -2 * attitude[:, 2]])
        thrust = HOVER - 0.5 * position[:, 2] - 0.4 * velocity[:, 2]
        seen, rewards, terminated, *_ = env.step(np.column_stack([np.clip(rates, -1, 1), thrust]))
        assert not terminated.any()
        total += rewards
    assert (total / 200 > 0.4).all(), total / 200


def test_what_environments_cannot_have_is_refused():
    for arguments, word in [
        ({"settings": {"vehicle.preset": "spacecraft"}}, "interface"),
        ({"settings": {"fault.inject": ["daemon:stop@1+1"]}}, "daemon:stop"),
    ]:
        with pytest.raises(oqtal.ConfigError, match=word):
            oqtal.make_vec(1, **arguments)
    with pytest.raises(oqtal.UsageError, match="Oqtal-Fly"):
        oqtal.make_vec(1, "Oqtal-Fly-v0")
    env = oqtal.make_vec(2)
    with pytest.raises(oqtal.UsageError, match="shape"):
        env._lanes.command(np.zeros((3, 4)))


def episode(env, seed: object) -> list[list[float]]:
    seen = [env.reset(seed=seed)[0]]
    seen += [env.step(np.array([0.1, 0.0, 0.0, HOVER]))[0] for _ in range(20)]
    return [numbers.tolist() for numbers in seen]


def test_episodes_follow_from_the_seed():
    first, second = (gymnasium.make("Oqtal-Hover-v0").unwrapped for _ in range(2))
    assert episode(first, 3) == episode(first, 3) == episode(second, np.int64(3))
    # Without a seed the next episodes follow from the last one.
    assert [episode(first, None) for _ in range(2)] == [episode(second, None) for _ in range(2)]
    assert episode(first, None) != episode(first, None)
    lanes = [oqtal.make_vec(3), oqtal.make_vec(3)]
    for env in lanes:
        env.reset(seed=np.int64(3))
        env.reset()
    np.testing.assert_array_equal(lanes[0].truths(), lanes[1].truths())
    for seed in ("three", -1, 2.5):
        with pytest.raises(oqtal.UsageError, match="seed is"):
            first.reset(seed=seed)


def test_runs_of_neighbouring_seeds_do_not_share_their_later_episodes():
    envs = [oqtal.make_vec(2), oqtal.make_vec(2)]
    for seed, env in enumerate(envs, 1):
        env.reset(seed=seed)
    later = [env._lanes.next_seed() for env in envs]
    assert abs(later[0] - later[1]) > 2**32
    seen, _ = envs[0].reset()
    np.testing.assert_array_equal(seen, envs[1].reset(seed=[later[0], later[0] + 1])[0])


def test_a_closed_environment_says_so():
    for env in (oqtal.make_vec(2), gymnasium.make("Oqtal-Hover-v0").unwrapped):
        env.reset(seed=1)
        env.close()
        env.close()
        for use in (env.reset, lambda env=env: env.step(np.zeros((2, 4)))):
            with pytest.raises(oqtal.UsageError, match="the environment is closed"):
                use()


def test_actions_of_another_shape_are_refused():
    env = oqtal.make_vec(2)
    for actions in (np.zeros(7), np.zeros((2, 3)), np.zeros((3, 4))):
        with pytest.raises(oqtal.UsageError, match="actions have the shape"):
            env.step(actions)
    with pytest.raises(oqtal.UsageError, match="did you mean `duration`"):
        oqtal.make_vec(2, durations=3)
