"""Dense against sparse factorization where nothing is compiled: what DENSE_LIMIT rests on."""

from __future__ import annotations

import numpy as np
import pandas as pd
import scipy.sparse as sp
from systems import beam
from timing import taken

import beamdae as bd
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.step_equations import StepPrediction, formulate_step
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.linear.blas_threads import single_threaded
from beamdae.linear.factorizations import create_factorization

TIME = np.array([0.1, 0.5])


def _times(pattern: sp.csc_array, method: str, nonzeros: np.ndarray) -> tuple[float, float]:
    solver, right = create_factorization(pattern, method), np.ones(pattern.shape[0])
    solver.factorize(nonzeros)
    factorize = min(
        taken(lambda: [solver.factorize(nonzeros) for _ in range(20)]) for _ in range(5)
    )
    solve = min(taken(lambda: [solver.solve(right) for _ in range(50)]) for _ in range(5))
    return factorize / 20, solve / 50


@single_threaded
def linear() -> pd.DataFrame:
    """Factorize and solve, LAPACK against SuperLU."""
    lines = []
    for elements in (4, 8, 11, 16, 32, 64):
        equations = bd.equations_of_motion(beam(elements))
        start = ConsistencySolver(equations).state(TIME, equations.q0, equations.v0)
        ida, alpha = (
            formulate_first_order(equations, "stabilized-index1"),
            formulate_step(equations, False),
        )
        coefficients = np.array([2e3, 3e6, 3e-7])
        at = StepPrediction(start.q, start.v, start.a, start.q.copy(), coefficients)
        for name, form, nonzeros in (
            ("Ida", ida, ida.jacobian(TIME, *ida.pack(start), 2e3)),
            ("GeneralizedAlpha", alpha, alpha.jacobian(TIME, at, np.zeros(alpha.size))),
        ):
            line = {"form": name, "unknowns": form.size, "non-zeros": form.pattern.nnz}
            for method in ("dense", "sparse"):
                factorize, solve = _times(form.pattern, method, nonzeros)
                line[f"{method} factorize [us]"] = round(factorize * 1e6)
                line[f"{method} solve [us]"] = round(solve * 1e6, 1)
            lines.append(line)
    return pd.DataFrame(lines)
