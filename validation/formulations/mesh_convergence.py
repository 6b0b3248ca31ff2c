"""Mesh convergence of the hub beam's tip deformation for all element variants.

    python validation/formulations/mesh_convergence.py [--subtended 30] [--shape parabolic]

All meshes are integrated with the same generalized-alpha settings and compared with 24 curved
elements, so that time errors cancel. Errors are the largest of u and v over the run, relative to
half of the larger range.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "models"))

import numpy as np
import pandas as pd
from hub_beam import hub_beam

import beamdae as bd

REFERENCE_ELEMENTS = 24
ELEMENTS = (1, 2, 3, 4, 6, 8, 12)
COLUMNS = ["deformation.u [m]", "deformation.v [m]"]
VARIANTS = {
    "curved": {},
    "curved, local continuity (paper)": {"continuity": "local"},
    "straight": {"elements_shape": "straight"},
}


def simulate_deformation(**parameters: object) -> np.ndarray:
    """Return the tip deformation (rows, 2) [m] of the hub beam."""
    integrator = bd.GeneralizedAlpha(step=2e-3, newton_tolerance=1e-7)
    mechanism = hub_beam(**parameters)
    solution = bd.simulate(mechanism, integrator, t_end=hub_beam.t_end, output_step=2e-3)
    return solution.observed[COLUMNS].to_numpy()


def compute_mesh_errors(elements: tuple[int, ...] = ELEMENTS, **parameters: object) -> np.ndarray:
    """Return the error of each mesh relative to 24 elements of the default variant."""
    beam = {k: v for k, v in parameters.items() if k in ("subtended", "shape")}
    reference = simulate_deformation(elements=REFERENCE_ELEMENTS, **beam)
    amplitude = 0.5 * np.max(np.ptp(reference, axis=0))
    runs = (simulate_deformation(elements=n, **parameters) for n in elements)
    return np.array([np.max(np.abs(run - reference)) / amplitude for run in runs])


def compute_orders(elements: tuple[int, ...], errors: np.ndarray) -> np.ndarray:
    """Return the observed order between successive meshes."""
    return np.diff(np.log(errors)) / -np.diff(np.log(elements))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--subtended", type=float, default=60.0, help="angle of the arc [deg]")
    parser.add_argument("--shape", default="circular", help="circular (default) or parabolic")
    beam = vars(parser.parse_args())
    rows = []
    for quadrature in ("reduced", "full"):
        for name, variant in VARIANTS.items():
            errors = compute_mesh_errors(quadrature=quadrature, **variant, **beam)
            orders = ["", *(f"{o:.1f}" for o in compute_orders(ELEMENTS, errors))]
            cells = {
                f"{n}": f"{e:.1e} {o}" for n, e, o in zip(ELEMENTS, errors, orders, strict=True)
            }
            rows.append({"elements": name, "quadrature": quadrature, **cells})
    print("error and observed order over the number of elements")
    print(pd.DataFrame(rows).to_string(index=False))


if __name__ == "__main__":
    main()
