"""Environment steps per second: oqtal's, those of RotorPy and gym-pybullet-drones where they are installed, and the plant alone.

``python python/benches/environments.py`` prints a table, of one run. Batches are on all processors, single environments on one.
The plant alone is measured on one processor by ``cargo bench``, unless ``--no-plant`` is given, and multiplied by their number.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import statistics
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import oqtal
import oqtal.gym

#: Control tick [s], and integration steps in it: the grid of 1 ms.
TICK_S = 1 / 60
#: Integration steps of the plant in a tick on average: the grid of 1 ms, a camera frame, and a command that takes effect.
PLANT_STEPS = 1000 / 60 + 2
#: Additions and multiplications of one step, as written in plant-sim/src: four derivatives of the 17 numbers of a state (thrust
#: axis 13, acceleration 28, attitude 25, rate 15, thrust 10), three states between them, the weighted sum, the norm of attitude.
FLOPS = 4 * (13 + 28 + 25 + 15 + 10) + 3 * 2 * 17 + 7 * 17 + 13
#: Double-precision operations of a core in a clock cycle without AVX, as the package is compiled: two additions and two
#: multiplications of vectors of 128 bits. With AVX2 and fused operations, as in PyTorch, it is up to four times as many.
FLOPS_PER_CYCLE = 8


def rate(step: Callable[[], None], per_call: int, seconds: float) -> float:
    """Steps per second: the median of five measurements."""
    step()
    rates = []
    for _ in range(5):
        began, calls = time.perf_counter(), 0
        while time.perf_counter() - began < seconds / 5:
            step()
            calls += 1
        rates.append(calls * per_call / (time.perf_counter() - began))
    return statistics.median(rates)


def oqtal_batch(lanes: int, seconds: float) -> float:
    """``make_vec(lanes)`` in the hover, with actions that a policy could give."""
    env = oqtal.make_vec(lanes)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    actions = [random.normal([0, 0, 0, -0.51], 0.02, (lanes, 4)).astype(np.float32) for _ in range(64)]
    turn = iter(range(10**9))
    return rate(lambda: env.step(actions[next(turn) % 64]) and None, lanes, seconds)


def rotorpy_batch(lanes: int, steps: int, seconds: float) -> float:
    """RotorPy's batch: the vehicle alone, ``steps`` Runge-Kutta steps in a control tick, body rates and thrust commanded."""
    import torch
    from rotorpy.vehicles.hummingbird_params import quad_params
    from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams

    device = torch.device("cpu")

    def rows(*row: float) -> torch.Tensor:
        return torch.tensor([row] * lanes, dtype=torch.double)

    state = {
        "x": rows(0, 0, 1),
        "v": rows(0, 0, 0),
        "q": rows(0, 0, 0, 1),
        "w": rows(0, 0, 0),
        "wind": rows(0, 0, 0),
        "rotor_speeds": rows(*[quad_params["rotor_speed_max"] / 2] * 4),
    }
    params = BatchedMultirotorParams([quad_params] * lanes, lanes, device)
    vehicle = BatchedMultirotor(params, lanes, state, device, control_abstraction="cmd_ctbr", integrator="rk4")
    command = {"cmd_thrust": rows(quad_params["mass"] * 9.81), "cmd_w": rows(0, 0, 0)}

    def step() -> None:
        nonlocal state
        for _ in range(steps):
            state = vehicle.step(state, command, TICK_S / steps)

    return rate(step, lanes, seconds)


def pybullet_drones(seconds: float) -> float:
    """gym-pybullet-drones: one vehicle in hover, 240 physics steps and 60 control ticks per second."""
    from gym_pybullet_drones.envs.HoverAviary import HoverAviary

    env = HoverAviary(ctrl_freq=60, pyb_freq=240)
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, np.float32)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return rate(step, 1, seconds)


def plant_step_s() -> float:
    """Time of one integration step of the plant alone on one core [s], by the benchmark of its crate."""
    command = ["cargo", "bench", "-p", "oqtal-plant-sim", "--bench", "plant", "--", "eq61"]
    repository = Path(__file__).resolve().parents[2]
    printed = subprocess.run(command, cwd=repository, check=True, capture_output=True, text=True).stdout
    found = re.search(r"time:\s+\[\S+ \S+ (\S+) (\S+)", printed)
    if found is None:
        raise RuntimeError(f"`cargo bench` printed no time: {printed}")
    return float(found[1]) * {"ps": 1e-12, "ns": 1e-9, "µs": 1e-6, "us": 1e-6, "ms": 1e-3}[found[2]]


def clock_hz() -> float:
    """Clock of the processor as the kernel shows it [Hz]."""
    found = re.search(r"cpu MHz\s*:\s*(\S+)", Path("/proc/cpuinfo").read_text())
    return 1e6 * float(found[1]) if found else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, default=256, help="vehicles of a batch [256]")
    parser.add_argument("--seconds", type=float, default=5.0, help="duration of each measurement [5]")
    parser.add_argument("--no-plant", action="store_true", help="without `cargo bench`")
    given = parser.parse_args()

    def show(name: str, steps_per_second: float) -> None:
        print(f"{name:72} {steps_per_second:12,.0f}", flush=True)

    cores = len(os.sched_getaffinity(0))
    print("control ticks per second, all vehicles together")
    show("oqtal.make_vec(1): plant, cameras, radio, delay", oqtal_batch(1, given.seconds))
    show(f"oqtal.make_vec({given.lanes}), {cores} cores", oqtal_batch(given.lanes, given.seconds))
    needed = ("rotorpy", "torch", "torchdiffeq", "roma")
    if all(importlib.util.find_spec(name) for name in needed):
        for steps in (1, 17):
            name = f"RotorPy, batch of {given.lanes}: plant alone, {steps} integration steps in a tick"
            show(name, rotorpy_batch(given.lanes, steps, given.seconds))
    if importlib.util.find_spec("gym_pybullet_drones"):
        show("gym-pybullet-drones, one vehicle: plant alone, 4 steps in a tick", pybullet_drones(given.seconds))
    if given.no_plant:
        return
    step_s = plant_step_s()
    show(f"oqtal's plant alone, {PLANT_STEPS:.1f} steps in a tick, one core x {cores}", cores / step_s / PLANT_STEPS)
    print("integration steps per second")
    show(f"oqtal's plant alone, with gusts, battery and radio, one core x {cores}", cores / step_s)
    limit = cores * clock_hz() * FLOPS_PER_CYCLE / FLOPS
    show(f"limit: {cores} x {clock_hz() / 1e9:.2f} GHz x {FLOPS_PER_CYCLE} operations per cycle / {FLOPS} operations", limit)


if __name__ == "__main__":
    main()
