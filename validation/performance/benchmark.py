"""Time runs, building and linear algebra, as ratios.

    python validation/performance/benchmark.py            runs and building
    python validation/performance/benchmark.py --linear   dense against sparse factorization

"price of Python" is the wall time of a run over the time its own counted residuals, Jacobians,
factorizations and solutions take when called back to back. BEAMDAE_NATIVE=off shows plain
Python in place of machine code. "setup" and "books" (the energy ledger of a run, its
drift and residual) are those of a second run with the same equations of motion.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

MODELS = Path(__file__).parents[2] / "models"
sys.path.insert(0, str(MODELS))

import numpy as np
import pandas as pd
import scipy.sparse as sp
from hub_beam import hub_beam
from pendulum import pendulum
from slider_crank import slider_crank

import beamdae as bd
from beamdae.equations.formulations import first_order
from beamdae.equations.step_equations import step_equations
from beamdae.results.solution import Statistics
from beamdae.symbolic.compiled import Compiled
from beamdae.symbolic.factorizations import factorization, single_threaded

# Goals of the project on two cores of a 2020s machine [s], and the CPU time the paper reports.
RUNS = (
    ("hub beam, Ida(1e-5)", hub_beam, {}, bd.Ida(1e-5), 0.08, 12.0),
    ("hub beam, GeneralizedAlpha(1e-3)", hub_beam, {}, bd.GeneralizedAlpha(1e-3), 0.15, 12.0),
    ("pendulum undamped, Ida(1e-5)", pendulum, {"damping": 0.0}, bd.Ida(1e-5), 0.5, None),
    ("slider-crank chord, Ida(1e-4)", slider_crank, {"frame": "chord"}, bd.Ida(1e-4), 0.1, None),
)


def median_time(action: Callable[[], object], repeats: int) -> float:
    """Median wall time of an action [s], after one call to warm up."""
    action()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


@single_threaded
def kernel_time(equations: bd.EquationsOfMotion, integrator: object, s: Statistics) -> float:
    """Time of a run's counted calls, back to back [s]."""
    if isinstance(integrator, bd.Ida):
        form = first_order(equations, integrator.formulation)
        last = (equations.p, np.ones(1))
    else:
        form = step_equations(equations, integrator.formulation != "index3")
        last = (equations.p,)
    residual, jacobian = Compiled(form.residual, equations.p), Compiled(form.jacobian, *last)
    linear = factorization(form.pattern)
    for function in (residual, jacobian):
        for buffer in function.inputs[: -len(last)]:
            buffer[:] = 1e-3
    nonzeros = jacobian()[0] + np.random.default_rng(0).normal(size=form.pattern.nnz)
    linear.factorize(nonzeros)
    right = np.ones(form.size)
    calls = (
        (residual, s.residual_calls),
        (jacobian, s.jacobian_calls),
        (lambda: linear.factorize(nonzeros), s.factorizations),
        (lambda: linear.solve(right), s.solves),
    )
    return sum(count * median_time(action, 300) for action, count in calls)


def _next_quality(solutions: Iterator[bd.Solution]) -> object:
    return next(solutions).quality


def runs() -> pd.DataFrame:
    """Integration time of the published systems."""
    lines = []
    for name, model, parameters, integrator, goal, paper in RUNS:
        equations = bd.equations_of_motion(model(**parameters))
        times = np.linspace(0.0, model.t_end, 1001)
        solutions = [integrator.integrate(equations, times) for _ in range(7)]
        results = [solution.statistics for solution in solutions]
        setup = statistics.median(r.setup_time for r in results)
        # Every solution keeps its books when it is first asked for them.
        books = median_time(partial(_next_quality, iter(solutions)), 6)
        wall = statistics.median(r.wall_time for r in results)
        kernels = kernel_time(equations, integrator, results[0])
        lines.append(
            {
                "run": name,
                "wall [s]": round(wall, 4),
                "wall / goal": round(wall / goal, 2),
                "price of Python": round(wall / kernels, 2),
                "paper / wall": "" if paper is None else round(paper / wall),
                "setup [s]": round(setup, 4),
                "(setup + books) / wall": round((setup + books) / wall, 2),
            }
        )
    return pd.DataFrame(lines)


def building() -> pd.DataFrame:
    """Building and compiling the functions, and cost a call, over the number of elements."""
    lines = []
    for elements in (8, 32, 128, 512):
        mechanism = hub_beam(elements=elements)

        def build(mechanism: bd.Mechanism = mechanism) -> tuple[Compiled, Compiled]:
            form = first_order(bd.equations_of_motion(mechanism), "stabilized-index1")
            return Compiled(form.residual), Compiled(form.jacobian)

        residual, jacobian = build()
        lines.append(
            {
                "elements": elements,
                "build [s]": round(median_time(build, 3), 3),
                "residual / element [us]": round(median_time(residual, 200) / elements * 1e6, 2),
                "jacobian / element [us]": round(median_time(jacobian, 50) / elements * 1e6, 2),
            }
        )
    return pd.DataFrame(lines)


def shell() -> pd.DataFrame:
    """From shell to table."""
    command = [sys.executable, "-m", "beamdae", "run", str(MODELS / "hub_beam.py"), "--out"]
    with tempfile.TemporaryDirectory() as folder:
        wall = median_time(
            lambda: subprocess.run([*command, folder], check=True, capture_output=True), 3
        )
    return pd.DataFrame(
        [
            {
                "command": "beamdae run hub_beam.py",
                "wall [s]": round(wall, 2),
                "wall / goal": round(wall / 2.5, 2),
            }
        ]
    )


def _linear_times(pattern: sp.csc_array, method: str, nonzeros: np.ndarray) -> tuple[float, float]:
    solver = factorization(pattern, method)
    right = np.ones(pattern.shape[0])
    return (
        median_time(lambda: solver.factorize(nonzeros), 50),
        median_time(lambda: solver.solve(right), 200),
    )


@single_threaded
def linear() -> pd.DataFrame:
    """Factorize and solve, LAPACK against SuperLU: what is behind factorizations.DENSE_LIMIT."""
    lines = []
    for elements in (4, 8, 11, 16, 32, 64):
        equations = bd.equations_of_motion(hub_beam(elements=elements))
        for name, form, last in (
            ("Ida", first_order(equations, "stabilized-index1"), (np.array([2e3]),)),
            ("GeneralizedAlpha", step_equations(equations, False), ()),
        ):
            function = Compiled(form.jacobian, *(equations.p, *last))
            if not last:
                function.inputs[-2][:] = [2e3, 3e6, 3e-7]
            function.inputs[1 if last else 2][: equations.n] = equations.q0
            nonzeros = function()[0].copy()
            line = {"form": name, "unknowns": form.size, "non-zeros": form.pattern.nnz}
            for method in ("dense", "sparse"):
                factorize, solve = _linear_times(form.pattern, method, nonzeros)
                line[f"{method} factorize [us]"] = round(factorize * 1e6)
                line[f"{method} solve [us]"] = round(solve * 1e6, 1)
            lines.append(line)
    return pd.DataFrame(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--linear", action="store_true")
    tables = (linear,) if parser.parse_args().linear else (runs, building, shell)
    for table in tables:
        print(table().to_string(index=False), end="\n\n")


if __name__ == "__main__":
    main()
