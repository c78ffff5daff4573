"""Executes the code cells of a notebook in order, in one namespace, without a display: notebook.py NOTEBOOK."""

import json
import sys

import matplotlib

matplotlib.use("Agg")

with open(sys.argv[1], encoding="utf-8") as file:
    notebook = json.load(file)

namespace = {"__name__": "__main__"}
for number, cell in enumerate(notebook["cells"], 1):
    if cell["cell_type"] == "code":
        source = "".join(cell["source"])
        exec(compile(source, f"cell {number}", "exec"), namespace)

drawn = [matplotlib.pyplot.figure(number) for number in matplotlib.pyplot.get_fignums()]
for figure in drawn:
    assert any(axes.lines for axes in figure.axes), "a figure without a line"
    figure.canvas.draw()
print(f"{len(drawn)} figures")
