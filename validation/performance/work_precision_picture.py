"""The picture of `work_precision`: time over error, a panel a system."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

mpl.use("Agg")
import matplotlib.pyplot as plt

# Colors told apart by all, and marks for those who see none.
STYLES = {
    "Exudyn, 2 nodes": ("0.55", "s"),
    "Exudyn, 3 nodes": ("0.25", "D"),
    "GeneralizedAlpha(step)": ("#0072b2", "o"),
    "GeneralizedAlpha(rtol)": ("#56b4e9", "v"),
    "Radau": ("#d55e00", "^"),
    "Ida": ("#009e73", "P"),
}


def kind(line: pd.Series) -> str:
    """Which of the styles a line of the table has."""
    if line["tool"] == "Exudyn":
        return f"Exudyn, {line['mesh'].split()[-2]} nodes"
    name = line["integrator"]
    return next(style for style in STYLES if name.startswith(style.rstrip(")")))


def draw(lines: pd.DataFrame, path: Path) -> None:
    """A picture of all lines, and of the fastest at each error by each tool as steps."""
    cases = list(dict.fromkeys(lines["case"]))
    columns = min(len(cases), 2)
    rows = -(-len(cases) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(5.0 * columns, 3.9 * rows), layout="constrained", squeeze=False
    )
    lines = lines.assign(kind=lines.apply(kind, axis=1))
    for axis, case in zip(axes.flat, cases, strict=False):
        own = lines[(lines["case"] == case) & (lines["error [mm]"] < 30.0)]
        for name, (color, marker) in STYLES.items():
            some = own[own["kind"] == name]
            axis.plot(
                some["error [mm]"],
                some["integration [s]"],
                marker,
                color=color,
                markersize=4,
                alpha=0.6,
                linestyle="none",
                label=name,
            )
        for tool, color in (("Exudyn", "0.25"), ("beamdae", "#0072b2")):
            x, y = _front(own[own["tool"] == tool])
            axis.step(x, y, where="post", color=color, linewidth=1.2)
        axis.set(xscale="log", yscale="log", title=case)
        axis.grid(alpha=0.3)
    for axis in axes[:, 0]:
        axis.set_ylabel("integration [s of processor]")
    for axis in axes[-1]:
        axis.set_xlabel("largest error of the tip [mm]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize="small")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _front(own: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Errors, and the least times of those with at most that error."""
    own = own.sort_values("error [mm]")
    return own["error [mm]"].to_numpy(), own["integration [s]"].cummin().to_numpy()
