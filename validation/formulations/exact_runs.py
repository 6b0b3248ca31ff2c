"""Hub beam and pendulum of the paper by the exact beam, and where other strains part from it.

    python validation/formulations/exact_runs.py

The tip every 10 ms. Stored references are 32 exact elements by Radau(1e-9); `known.csv` says how
far from them a floating frame with exact strains, generalized-alpha, and Exudyn's beam end,
`eight_elements.csv` what 8 elements reach by each integrator, `parting.csv` and its picture how far
the other strains are off up to a time.
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
from pan_liu_2012.drawing import BLUE, GRAY, GREEN, ORANGE, RED, panels, save
from pendulum import pendulum

import beamdae as bd

Array = np.ndarray

RESULTS = Path(__file__).parent / "results"
EXUDYN_FOLDER = Path(__file__).parents[1] / "performance" / "results"
MODELS = {"hub_beam": hub_beam, "pendulum": pendulum}
EXUDYN_FILES = {
    "hub_beam": "reference_hub_beam_undamped.csv",
    "pendulum": "reference_pendulum_damped.csv",
}
EXACT, EXACT_STRAIN = {"formulation": "exact"}, {"strain": "exact"}
REFERENCE_INTEGRATOR = bd.Radau(1e-9)
CHECK_INTEGRATOR = bd.GeneralizedAlpha(5e-5, newton_tolerance=1e-9)
# How near to the converged answer 8 exact elements are to stay [m].
BOUNDS = {"hub_beam": 1e-5, "pendulum": 2e-5}
INTEGRATORS = {
    "Ida rtol 1e-07": bd.Ida(1e-7),
    "Radau rtol 1e-05": bd.Radau(1e-5),
    "GeneralizedAlpha step 0.00025": bd.GeneralizedAlpha(2.5e-4),
}
# Strains in a frame, in 16 elements: what is left is not of the mesh.
STRAINS: dict[str, tuple[dict[str, Any], str]] = {
    "linear, tangent frame": ({"strain": "linear"}, GRAY),
    "nonlinear (the paper's), tangent frame": ({"strain": "nonlinear"}, RED),
    "green, tangent frame": ({"strain": "green"}, ORANGE),
    "exact strain in a frame": (EXACT_STRAIN, GREEN),
}
STEP = 1e-2


def simulate_tip(name: str, integrator: Any, elements: int, **words: Any) -> Array:
    """The tip (rows, 2) [m] every 10 ms."""
    model = MODELS[name]
    with warnings.catch_warnings():
        # Of strains that do not reach: that is what is measured.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        mech = model(elements=elements, **words)
        solution = bd.simulate(mech, integrator, model.t_end, output_step=STEP)
    assert solution.status.success, solution.status.sentence
    return solution.observed[["tip.x [m]", "tip.y [m]"]].to_numpy()


def load_reference(name: str) -> Array:
    """The stored reference."""
    return pd.read_csv(RESULTS / f"{name}.csv")[["x [m]", "y [m]"]].to_numpy()


def max_distance(found: Array, right: Array) -> float:
    """Largest distance [m]."""
    return float(np.max(np.linalg.norm(found - right, axis=1)))


def store_reference(name: str) -> list[dict[str, Any]]:
    """Store the reference; how far others are from it."""
    right = simulate_tip(name, REFERENCE_INTEGRATOR, 32, **EXACT)
    table = pd.DataFrame(right, columns=["x [m]", "y [m]"])
    table.insert(0, "t [s]", STEP * np.arange(len(table)))
    table.to_csv(RESULTS / f"{name}.csv", index=False, float_format="%.10g")
    exudyn = pd.read_csv(EXUDYN_FOLDER / EXUDYN_FILES[name])[["x [m]", "y [m]"]].to_numpy()
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
        "Exudyn, 64 elements, step 5e-05": exudyn,
    }
    return [
        {"model": name, "computation": label, "off [mm]": f"{1e3 * max_distance(found, right):.2g}"}
        for label, found in others.items()
    ]


def measure_eight_elements(name: str, label: str) -> dict[str, Any]:
    """Eight exact elements by an integrator."""
    error = max_distance(simulate_tip(name, INTEGRATORS[label], 8, **EXACT), load_reference(name))
    return {"model": name, "integrator": label, "off [mm]": f"{1e3 * error:.2g}"}


def error_histories(name: str) -> dict[str, Array]:
    """How far each strain has been off until a time [m]."""
    right = load_reference(name)
    found = {
        label: simulate_tip(name, bd.Radau(1e-7), 16, **words)
        for label, (words, _) in STRAINS.items()
    }
    found["exact, 8 elements"] = simulate_tip(name, REFERENCE_INTEGRATOR, 8, **EXACT)
    return {
        label: np.maximum.accumulate(np.linalg.norm(own - right, axis=1))
        for label, own in found.items()
    }


def plot_error_histories(parted: dict[str, dict[str, Array]]) -> None:
    """How far each strain has been off until a time, of both models."""
    figure, axes = panels(columns=2, height=3.6)
    colors = {label: color for label, (_, color) in STRAINS.items()} | {"exact, 8 elements": BLUE}
    for axis, (name, curves) in zip(axes, parted.items(), strict=True):
        for label, error in curves.items():
            t = STEP * np.arange(len(error))
            axis.semilogy(t, 1e3 * error, color=colors[label], lw=1.3, label=label)
        axis.axhline(1e3 * BOUNDS[name], color="black", lw=0.7, ls=":")
        axis.set_title(name.replace("_", " "), fontsize=9)
        axis.set_xlabel("t [s]", fontsize=9)
        axis.set_ylim(1e-6, 1e3)
    axes[0].set_ylabel("tip, largest error so far [mm]", fontsize=9)
    axes[1].legend(fontsize=7, framealpha=0.8, edgecolor="none", loc="lower right")
    save(figure, RESULTS / "parting.png")


def main() -> None:
    tables = {"known": [row for name in MODELS for row in store_reference(name)]}
    tables["eight_elements"] = [
        measure_eight_elements(name, x) for name in MODELS for x in INTEGRATORS
    ]
    parted = {name: error_histories(name) for name in MODELS}
    plot_error_histories(parted)
    tables["parting"] = [
        {
            "model": name,
            "strain": label,
            **{
                f"{share:.0%} of the run": f"{1e3 * error[round(share * (len(error) - 1))]:.2g}"
                for share in (0.1, 0.25, 0.5, 1.0)
            },
        }
        for name, curves in parted.items()
        for label, error in curves.items()
    ]
    for name, rows in tables.items():
        table = pd.DataFrame(rows)
        table.to_csv(RESULTS / f"{name}.csv", index=False)
        print(table.to_string(index=False), end="\n\n")


if __name__ == "__main__":
    main()
