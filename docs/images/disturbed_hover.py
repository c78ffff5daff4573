"""Draws docs/images/disturbed_hover.svg: two hovers with the same gust and payload. Requires matplotlib.

    for law in oqtal-dt oqtal; do
        oqtal fly --clock in-process --trajectory hover --duration 30 --seed 7 --controller $law \
            --disturb gust@16+3=3,0,0m/s --disturb mass@24=0.05kg --out flights/hover-$law
    done
    python docs/images/disturbed_hover.py flights/hover-oqtal-dt flights/hover-oqtal
"""

import csv
import math
import pathlib
import sys

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "oqtal", "font.family": "sans-serif", "font.size": 11})
from matplotlib import pyplot


def distances(flight):
    """Times since arming [s] and distances between true position and set-point [cm], while the hover is scored."""
    with open(pathlib.Path(flight) / "telemetry.csv") as file:
        rows = [row for row in csv.DictReader(file) if row["scored"] == "1"]
    times = [float(row["t_s"]) for row in rows]
    points = [[[float(row[f"{which}_{axis}_m"]) for axis in "xyz"] for which in ("true", "ref")] for row in rows]
    return times, [100 * math.dist(true, ref) for true, ref in points]


figure, axes = pyplot.subplots(figsize=(7.2, 3.0), layout="constrained")
styles = zip(sys.argv[1:], ("#0b6e4f", "#b23a48"))
for flight, colour in styles:
    axes.plot(*distances(flight), color=colour, linewidth=1.6)
axes.text(24.9, 2.0, "oqtal-dt: 3.4 cm", color="#0b6e4f")
axes.text(26.3, 15.5, "oqtal, the paper's law: 19 cm", color="#b23a48")
axes.axvspan(16, 19, color="#8888", alpha=0.25, linewidth=0)
axes.axvline(24, color="#888", linestyle=":")
axes.text(17.5, 20.4, "gust of 3 m/s", ha="center", color="#666")
axes.text(24.2, 20.4, "payload of 50 g, 10 % of the mass", color="#666")
axes.set(xlim=(12.5, 34), ylim=(0, 22), xlabel="time since arming [s]", ylabel="distance from set-point [cm]")
axes.spines[["top", "right"]].set_visible(False)
figure.savefig(pathlib.Path(__file__).with_suffix(".svg"), metadata={"Date": None})
