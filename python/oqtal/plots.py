"""Figures of flights, with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from oqtal.flight import Flight


def flight(flown: Flight) -> Figure:
    """Path from above, height, position error and tilt."""
    import matplotlib.pyplot as plt
    import numpy as np

    ticks = flown.columns
    time = ticks["t_s"]
    source = "true" if np.isfinite(ticks["true_x_m"]).any() else "est"
    figure: Figure = plt.figure(figsize=(11, 7), layout="constrained")
    (above, height), (error, tilt) = figure.subplots(2, 2)
    above.plot(ticks["ref_x_m"], ticks["ref_y_m"], "--", color="gray", label="reference")
    above.plot(ticks[f"{source}_x_m"], ticks[f"{source}_y_m"], label=source)
    above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="From above")
    above.legend()
    height.plot(time, ticks["ref_z_m"], "--", color="gray")
    height.plot(time, ticks[f"{source}_z_m"])
    height.set(ylabel="height [m]")
    squares = sum((ticks[f"{source}_{axis}_m"] - ticks[f"ref_{axis}_m"]) ** 2 for axis in "xyz")
    error.plot(time, 100 * np.sqrt(squares))
    error.set(xlabel="time [s]", ylabel="position error [cm]")
    x, y = ticks[f"{source}_qx"], ticks[f"{source}_qy"]
    tilt.plot(time, np.degrees(2 * np.arcsin(np.clip(np.hypot(x, y), 0, 1))))
    tilt.set(xlabel="time [s]", ylabel="tilt [deg]")
    return figure
