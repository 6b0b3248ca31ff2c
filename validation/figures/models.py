"""The pictures of models in the readme: a motion, and drawings.

python validation/figures/models.py
"""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib.image as mpimg
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import beamdae as bd

NAMES = (
    "four_bar",
    "quick_return",
    "leaf_spring_vehicle",
    "governor",
    "ring_mount",
    "sliding_mass",
)
COLUMNS = 3


def drawing(name: str):
    """Of a model, as an image."""
    figure = bd.load_model(f"example:{name}")().draw().figure
    figure.set_size_inches(5.0, 3.6)
    found = io.BytesIO()
    figure.savefig(found, dpi=110, format="png")
    found.seek(0)
    return mpimg.imread(found)


def main() -> None:
    rows = -(-len(NAMES) // COLUMNS)
    figure = Figure(figsize=(5.0 * COLUMNS, 3.9 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    for k, name in enumerate(NAMES):
        axis = figure.add_subplot(rows, COLUMNS, k + 1)
        axis.imshow(drawing(name))
        axis.set_title(name, fontsize=12)
        axis.set_axis_off()
    folder = Path(__file__).parent
    figure.savefig(folder / "models.png", dpi=80)
    run = bd.simulate(bd.load_model("example:four_bar"))
    run.animate(folder / "four_bar.gif", speed=0.8, frames=50)


if __name__ == "__main__":
    main()
