"""Create the pictures of models in the readme: an animation and six drawings.

python validation/figures/models.py
"""

import io
from pathlib import Path

import matplotlib.image as mpimg
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import beamdae as bd
from beamdae.report.pictures.drawing import create_drawing

NAMES = (
    "four_bar",
    "quick_return",
    "leaf_spring_vehicle",
    "governor",
    "ring_mount",
    "sliding_mass",
)
COLUMNS = 3


def render_drawing(name: str):
    """Return the drawing of an example model as an image array."""
    figure = create_drawing(bd.load_model(f"example:{name}")(), size=(5.0, 3.6))
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=110, format="png")
    buffer.seek(0)
    return mpimg.imread(buffer)


def main() -> None:
    rows = -(-len(NAMES) // COLUMNS)
    figure = Figure(figsize=(5.0 * COLUMNS, 3.9 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    for k, name in enumerate(NAMES):
        axis = figure.add_subplot(rows, COLUMNS, k + 1)
        axis.imshow(render_drawing(name))
        axis.set_title(name, fontsize=12)
        axis.set_axis_off()
    folder = Path(__file__).parent
    figure.savefig(folder / "models.png", dpi=80)
    four_bar = bd.load_model("example:four_bar")
    # A coupler of half the thickness bends visibly.
    mechanism = four_bar(height=0.002, speed=3.0 * np.pi, stiffness=60.0, formulation="exact")
    run = bd.simulate(mechanism, bd.Radau(1e-6), t_end=3.0)
    run.animate(folder / "four_bar.gif", speed=0.6, color="stress", trail="rocker")


if __name__ == "__main__":
    main()
