"""Hub beam and pendulum of the paper: the exact beam, and the errors of other strains.

    python validation/formulations/exact_runs.py

Compares the tip every 10 ms with runs of 32 exact elements by Radau(1e-9), in `references.csv`.
`exact_runs.csv` lists the largest distances in three groups: "reference", other accurate
computations (64 elements, exact strains in a floating frame, generalized-alpha and Exudyn);
"8 elements", exact beams by integrator; "strains", 16 elements by strain, up to shares of the run,
of which `parting.png` is a picture.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2] / "models")]

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from matplotlib.figure import Figure
from pan_liu_2012.plots import BLUE, GRAY, GREEN, ORANGE, RED, add_panels
from pendulum import pendulum

import beamdae as bd

Array = np.ndarray

RESULTS = Path(__file__).parent / "results"
EXUDYN_REFERENCES = Path(__file__).parents[1] / "performance" / "results" / "references.csv"
MODELS = {"hub_beam": hub_beam, "pendulum": pendulum}
EXUDYN_CASES = {"hub_beam": "hub beam, undamped", "pendulum": "pendulum, damped"}
EXACT, EXACT_STRAIN = {"formulation": "exact"}, {"strain": "exact"}
REFERENCE_INTEGRATOR = bd.Radau(1e-9)
CHECK_INTEGRATOR = bd.GeneralizedAlpha(5e-5, newton_tolerance=1e-9)
# Largest error allowed for 8 exact elements [m].
TOLERANCES = {"hub_beam": 1e-5, "pendulum": 2e-5}
INTEGRATORS = {
    "Ida rtol 1e-07": bd.Ida(1e-7),
    "Radau rtol 1e-05": bd.Radau(1e-5),
    "GeneralizedAlpha step 0.00025": bd.GeneralizedAlpha(2.5e-4),
}
# Strains in a frame, with 16 elements: the error of the mesh is negligible.
STRAINS: dict[str, tuple[dict[str, Any], str]] = {
    "linear, tangent frame": ({"strain": "linear"}, GRAY),
    "nonlinear (the paper's), tangent frame": ({"strain": "nonlinear"}, RED),
    "green, tangent frame": ({"strain": "green"}, ORANGE),
    "exact strain in a frame": (EXACT_STRAIN, GREEN),
}
OUTPUT_STEP = 1e-2  # [s]
SHARES = (0.1, 0.25, 0.5, 1.0)  # of the run


def simulate_tip(name: str, integrator: Any, elements: int, **settings: Any) -> Array:
    """Return the tip (rows, 2) [m] every 10 ms."""
    model = MODELS[name]
    with warnings.catch_warnings():
        # Warnings about errors by the strains, which are measured here.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        mech = model(elements=elements, **settings)
        solution = bd.simulate(mech, integrator, model.t_end, output_step=OUTPUT_STEP)
    assert solution.status.success, solution.status.sentence
    return solution.observed[["tip.x [m]", "tip.y [m]"]].to_numpy()


def load_reference(name: str, file: Path = RESULTS / "references.csv") -> Array:
    """Return the stored reference of a model, (rows, 2) [m]."""
    table = pd.read_csv(file)
    return table.loc[table.iloc[:, 0] == name, ["x [m]", "y [m]"]].to_numpy()


def max_distance(tips: Array, reference: Array) -> float:
    """Return the largest distance of two paths of the tip [m]."""
    return float(np.max(np.linalg.norm(tips - reference, axis=1)))


def make_row(
    group: str, name: str, computation: str, error: float, share: float = 1.0
) -> dict[str, Any]:
    """Return a row of the table: the largest error [m] up to a share of the run."""
    row = {"group": group, "model": name, "computation": computation}
    return row | {"share of the run": share, "off [mm]": f"{1e3 * error:.2g}"}


def store_references() -> None:
    """Store the references of all models."""
    tables = []
    for name in MODELS:
        x, y = simulate_tip(name, REFERENCE_INTEGRATOR, 32, **EXACT).T
        columns = {"t [s]": OUTPUT_STEP * np.arange(len(x)), "x [m]": x, "y [m]": y}
        tables.append(pd.DataFrame({"model": name} | columns))
    pd.concat(tables).to_csv(RESULTS / "references.csv", index=False, float_format="%.10g")


def compare_with_reference(name: str) -> list[dict[str, Any]]:
    """Return the deviations of other accurate computations from the reference of a model."""
    reference = load_reference(name)
    others = {
        "exact, 32 elements, GeneralizedAlpha step 5e-05": simulate_tip(
            name, CHECK_INTEGRATOR, 32, **EXACT
        ),
        "exact, 64 elements, Radau rtol 1e-09": simulate_tip(
            name, REFERENCE_INTEGRATOR, 64, **EXACT
        ),
        "exact strain in a frame, 32 elements, Radau rtol 1e-09": simulate_tip(
            name, REFERENCE_INTEGRATOR, 32, **EXACT_STRAIN
        ),
        "exact strain in a frame, 32 elements, GeneralizedAlpha step 5e-05": simulate_tip(
            name, CHECK_INTEGRATOR, 32, **EXACT_STRAIN
        ),
        "Exudyn, 64 elements, step 5e-05": load_reference(EXUDYN_CASES[name], EXUDYN_REFERENCES),
    }
    return [
        make_row("reference", name, label, max_distance(tips, reference))
        for label, tips in others.items()
    ]


def measure_eight_elements(name: str, label: str) -> dict[str, Any]:
    """Return the error of eight exact elements with one integrator."""
    error = max_distance(simulate_tip(name, INTEGRATORS[label], 8, **EXACT), load_reference(name))
    return make_row("8 elements", name, label, error)


def error_histories(name: str) -> dict[str, Array]:
    """Return the largest error so far [m] over time, by strain."""
    reference = load_reference(name)
    tips = {
        label: simulate_tip(name, bd.Radau(1e-7), 16, **settings)
        for label, (settings, _) in STRAINS.items()
    }
    tips["exact, 8 elements"] = simulate_tip(name, REFERENCE_INTEGRATOR, 8, **EXACT)
    return {
        label: np.maximum.accumulate(np.linalg.norm(path - reference, axis=1))
        for label, path in tips.items()
    }


def plot_error_histories(histories: dict[str, dict[str, Array]]) -> None:
    """Plot the largest error so far over time, by strain, for both models."""
    figure = Figure(figsize=(10.4, 3.6), layout="constrained")
    axes = add_panels(figure, 2)
    colors = {label: color for label, (_, color) in STRAINS.items()} | {"exact, 8 elements": BLUE}
    for axis, (name, curves) in zip(axes, histories.items(), strict=True):
        for label, error in curves.items():
            t = OUTPUT_STEP * np.arange(len(error))
            axis.semilogy(t, 1e3 * error, color=colors[label], lw=1.3, label=label)
        axis.axhline(1e3 * TOLERANCES[name], color="black", lw=0.7, ls=":")
        axis.set_title(name.replace("_", " "), fontsize=9)
        axis.set_xlabel("t [s]", fontsize=9)
        axis.set_ylim(1e-6, 1e3)
    axes[0].set_ylabel("tip, largest error so far [mm]", fontsize=9)
    axes[1].legend(fontsize=7, framealpha=0.8, edgecolor="none", loc="lower right")
    figure.savefig(RESULTS / "parting.png", dpi=110)


def main() -> None:
    store_references()
    rows = [row for name in MODELS for row in compare_with_reference(name)]
    rows += [measure_eight_elements(name, x) for name in MODELS for x in INTEGRATORS]
    histories = {name: error_histories(name) for name in MODELS}
    plot_error_histories(histories)
    rows += [
        make_row("strains", name, label, error[round(share * (len(error) - 1))], share)
        for name, curves in histories.items()
        for label, error in curves.items()
        for share in SHARES
    ]
    table = pd.DataFrame(rows)
    table.to_csv(RESULTS / "exact_runs.csv", index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
