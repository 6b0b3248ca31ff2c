"""Runs of a model, and the deviation between two runs."""

from typing import Any

import numpy as np
import pandas as pd

import beamdae as bd

# Half the paper's step, with Newton's iteration converged to rounding, so that rows are the same
# on every machine.
SCHEME = bd.GeneralizedAlpha(step=5e-4, newton_tolerance=1e-11)
PAPER_SCHEME = bd.GeneralizedAlpha(step=1e-3, newton_tolerance=1e-11)
SECOND_METHOD = bd.Ida(rtol=1e-6)
HUB_BEAM_T_END = 2.0  # s
PENDULUM_STRAIN_T_END = 5.0  # s, Figs. 5a and 5b
PENDULUM_T_END = 6.0  # s, Fig. 5c
SLIDER_CRANK_T_END = 4.5  # s
TIP_U = "deformation.u [m]"
TIP_V = "deformation.v [m]"
TIP_COLUMNS = [TIP_U, TIP_V]


def run_to_end(
    mechanism: bd.Mechanism, t_end: float, rows: float, integrator: Any
) -> bd.results.Solution:
    """Return the solution of a run, or raise if it does not reach its end."""
    solution = bd.simulate(mechanism, integrator, t_end=t_end, output_step=rows)
    if not solution.status.success:
        raise RuntimeError(f"{integrator.label}: {solution.status.sentence}")
    return solution


def observe_run(
    mechanism: bd.Mechanism, t_end: float, rows: float, integrator: Any = SCHEME
) -> pd.DataFrame:
    """Return observed columns of a run over time, every `rows` seconds."""
    return run_to_end(mechanism, t_end, rows, integrator).observed


def measure_deviation(run: Any, reference: Any) -> float:
    """Return the largest difference over half the largest range of the reference columns."""
    run, reference = np.asarray(run, float), np.asarray(reference, float)
    return float(np.max(np.abs(run - reference)) / (0.5 * np.max(np.ptp(reference, axis=0))))


def compare_methods(pairs: dict[str, tuple[pd.Series, pd.Series]]) -> dict[str, pd.DataFrame]:
    """Return the deviation of generalized-alpha from IDA, by column."""
    lines = [
        {"column": name, "generalized-alpha against IDA [-]": measure_deviation(one, other)}
        for name, (one, other) in pairs.items()
    ]
    return {"second_method": pd.DataFrame(lines)}


def format_range(values: Any) -> str:
    """Format the smallest and the largest value."""
    low, high = np.min(values), np.max(values)
    return f"{low:.3g} .. {high:.3g}"
