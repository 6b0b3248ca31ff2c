"""Runs that other optimizers need for the same fit: `python validation/calibration/methods.py`.

The problem is the twin experiment. All methods vary the same six variables between the same bounds:
five parameters of the model, two of them as logarithms, and the time shift. Scale and offset of the
gauge are solved for linearly in each run, for all methods. A method is counted until its sum of
squares is within 0.1 of the minimum, a change of less than a third of a standard deviation of the
parameters. `bd.fit` is counted until it converges, in runs with derivatives.
"""

import sys
import time
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import twin
from scipy.optimize import differential_evolution, least_squares, minimize

import beamdae as bd
from beamdae.errors import BeamdaeError, BeamdaeWarning

RESULTS = Path(__file__).parent / "results"
SUFFICIENT = 0.1
MOST_RUNS = 6000
SEED = 1
IS_LOG = np.array([name in twin.LOG for name in twin.TRUE] + [False])
BOUNDS = np.array([*twin.BOUNDS.values(), twin.SENSORS["shift"]["*"]])
FIRST = np.array([*twin.FIRST.values(), 0.0])


class EnoughError(Exception):
    """Raised when a method has found the minimum, or exceeds the maximum number of runs."""


class Problem:
    """Residuals of plain runs in variables from 0 to 1; counts runs and keeps the best one."""

    def __init__(self, data, minimum):
        self.data, self.minimum = data, minimum
        self.runs, self.best, self.used = 0, np.inf, 0
        self.limits = np.where(IS_LOG[:, None], np.log(np.maximum(BOUNDS, 1e-30)), BOUNDS)
        first = np.where(IS_LOG, np.log(np.maximum(FIRST, 1e-30)), FIRST)
        self.first = (first - self.limits[:, 0]) / np.ptp(self.limits, axis=1)

    def residuals(self, x):
        """Return the residuals with the best scale and offset."""
        values = self.limits[:, 0] + np.clip(x, 0.0, 1.0) * np.ptp(self.limits, axis=1)
        values = np.where(IS_LOG, np.exp(np.minimum(values, 0.0)), values)
        model = twin.pendulum(**dict(zip(twin.TRUE, values.tolist(), strict=False)))
        times = self.data["t [s]"]
        self.runs += 1
        try:
            run = bd.simulate(model, twin.METHOD, float(times[-1]) + 0.05)
            strain = run.at_times(times - values[-1])
        except BeamdaeError:
            return np.full(2 * len(times), 1e6)
        gauge = strain["gauge 1"].to_numpy()
        matrix = np.stack([gauge, np.ones_like(gauge)], axis=1)
        # Scaled, because strains are small.
        coefficients = np.linalg.lstsq(matrix / [1e-4, 1.0], self.data["gauge 1"], rcond=None)[0]
        first = (matrix / [1e-4, 1.0]) @ coefficients - self.data["gauge 1"]
        residuals = np.concatenate([first, strain["gauge 2"] - self.data["gauge 2"]]) / twin.NOISE
        self._record(float(residuals @ residuals))
        return residuals

    def _record(self, chi_square):
        if chi_square < self.best:
            self.best, self.used = chi_square, self.runs
        if self.best < self.minimum + SUFFICIENT or self.runs >= MOST_RUNS:
            raise EnoughError

    def chi_square(self, x):
        """Return the sum of squares."""
        residuals = self.residuals(x)
        return float(residuals @ residuals)


def nelder_mead(problem):
    minimize(
        problem.chi_square,
        problem.first,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(FIRST),
        options={"maxfev": MOST_RUNS, "adaptive": True, "xatol": 1e-8, "fatol": 1e-4},
    )


def evolution(problem):
    differential_evolution(
        problem.chi_square, [(0.0, 1.0)] * len(FIRST), rng=SEED, maxiter=10_000, polish=False
    )


def differences(problem):
    least_squares(
        problem.residuals, problem.first, bounds=(0.0, 1.0), x_scale="jac", diff_step=1e-5
    )


METHODS = {
    "least_squares with differences": differences,
    "Nelder-Mead": nelder_mead,
    "differential evolution": evolution,
}


def main():
    warnings.simplefilter("ignore", BeamdaeWarning)
    data = twin.noisy_record(twin.exact_record(), seed=0)
    twin.fit(data)
    begin = time.process_time()
    fit = twin.fit(data)
    seconds = time.process_time() - begin
    rows = [("bd.fit", fit.evaluations, fit.chi_square - fit.chi_square, seconds)]
    for name, method in METHODS.items():
        problem = Problem(data, fit.chi_square)
        begin = time.process_time()
        with suppress(EnoughError):
            method(problem)
        seconds = time.process_time() - begin
        rows.append((name, problem.runs, problem.best - fit.chi_square, seconds))
        print(rows[-1], flush=True)
    columns = ["method", "runs", "chi-square above minimum", "processor time [s]"]
    table = pd.DataFrame(rows, columns=columns)
    RESULTS.mkdir(exist_ok=True)
    table.to_csv(RESULTS / "methods.csv", index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format="%.4g"))


if __name__ == "__main__":
    sys.exit(main())
