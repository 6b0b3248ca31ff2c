"""Calibrations drawn at random, beside SciPy: `python validation/calibration/drawn.py [COUNT]`.

Each case draws a model, its true parameters, first values, noise, and unknown sensors or several
experiments. The twin is `scipy.optimize.least_squares` with differences of plain runs, which varies
all unknowns, scales and offsets included, from the true values. Then the data of the same case are
recorded with an error (mirrored, in a wrong unit, delayed), which the fit must name, and the search
begins from first values that are wrong by factors between 0.04 and 9.
"""

import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

import beamdae as bd
from beamdae.errors import BeamdaeWarning

COUNT = 36
RESULTS = Path(__file__).parent / "results"
METHOD = bd.GeneralizedAlpha(step=4e-3)
# Factors of an error of the recording, and words of the phrase that names it.
ERRORS = {
    "mirrored": (-1.0, 0.0, "mirrored"),
    "unit": (0.1, 0.0, "scaled"),
    "delay": (1.0, 0.1, "late by"),
}


@bd.model(t_end=2.0)
def hanger(stiffness=60.0, damping=0.5, mass=1.0):
    """Mass that is released from the unloaded length of its spring."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    body = mech.add(bd.PointMass("mass", mass, at=(0.0, 0.0)))
    mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 1.0), body.point, stiffness, damping))
    mech.observe("mass", body.point)
    return mech


@bd.model(t_end=2.0)
def chain(first=60.0, second=90.0, damping=0.5, mass=0.7):
    """Two masses in a row, of which the first one is pushed."""
    mech = bd.Mechanism()
    one = mech.add(bd.PointMass("one", 1.0, at=(1.0, 0.0), velocity=(0.3, 0.0)))
    two = mech.add(bd.PointMass("two", mass, at=(2.0, 0.0)))
    mech.add(bd.SpringDamper("left", mech.ground.at(0.0, 0.0), one.point, first, damping))
    mech.add(bd.SpringDamper("right", one.point, two.point, second, damping))
    mech.observe("mass", two.point)
    return mech


@bd.model(t_end=1.0)
def strip(E=70e9, damping=1e-3, mass=0.05):
    """Clamped strip with a mass at its tip, released from its drawing."""
    alloy = bd.Material(E=E, nu=0.3, rho=2700.0)
    section = bd.Section.rectangle(alloy, width=0.03, height=0.003, damping=damping)
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    beam = bd.Beam("strip", bd.Line((0.0, 0.0), (0.5, 0.0)), section, elements=2, strain="exact")
    beam = mech.add(beam)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointMass("tip mass", mass, on=beam.end))
    mech.observe("mass", beam.end)
    return mech


MODELS = [
    (hanger, ["stiffness", "damping"]),
    (chain, ["first", "second", "damping"]),
    (strip, ["E", "damping"]),
    (hanger, ["stiffness", "mass", "damping"]),
]


class Case:
    """A drawn calibration: truth, data of one or two experiments, and options of the fit."""

    def __init__(self, number, factor=1.0, delay=0.0, spread=1.3):
        rng = np.random.default_rng([7, number])
        self.model, self.by = MODELS[number % len(MODELS)]
        defaults = self.model.parameters
        self.truth = {x: defaults[x] * np.exp(rng.uniform(-0.5, 0.5)) for x in self.by}
        ratios = np.exp(rng.uniform(-1.0, 1.0, len(self.by)) * np.log(spread))
        self.first = {x: v * r for (x, v), r in zip(self.truth.items(), ratios, strict=True)}
        t_end = self.model.t_end
        self.times = np.linspace(0.15, t_end, int(rng.integers(60, 160)))
        masses = [defaults["mass"]]
        if number % 3 == 1 and "mass" not in self.by:
            masses.append(1.4 * defaults["mass"])
        self.experiments = {f"mass {x:g}": {"mass": x} for x in masses}
        if "mass" in self.by:
            self.experiments = {"one": {}}
        # Unknown sensors in a third of the cases without an error.
        has_sensor = number % 3 == 2 and factor == 1.0 and not delay
        self.sensor = (1.1, 0.02) if has_sensor else (factor, 0.0)
        self.options = {"offset": ["mass.y"], "scale": ["mass.y"]} if has_sensor else {}
        self.column = "mass.x" if self.model is chain else "mass.y"
        self.options = {k: [self.column] for k in self.options}
        self.data = {}
        for name in self.experiments:
            exact = self.run(name, self.truth, self.times - delay)
            exact = self.sensor[0] * exact + self.sensor[1]
            self.sigma = abs(factor) * 10.0 ** rng.uniform(-3.0, -2.0) * np.ptp(exact / factor)
            noise = rng.normal(scale=self.sigma, size=len(self.times))
            self.data[name] = exact + noise

    def run(self, experiment, values, times):
        """Return the measured column of a run with parameters."""
        parameters = {**values, **self.experiments[experiment]}
        run = bd.simulate(self.model(**parameters), METHOD, t_end=float(self.times[-1]))
        return run.at_times(np.maximum(times, 0.0))[self.column].to_numpy()

    def fit(self, first=None, **options):
        """Return the fit of the case."""
        data = {x: {"t [s]": self.times, self.column: y} for x, y in self.data.items()}
        return bd.fit(
            self.model,
            data,
            self.by,
            METHOD,
            sigma=self.sigma,
            parameters=self.first if first is None else first,
            experiments=self.experiments,
            **self.options,
            **options,
        )

    def twin(self, fit):
        """Return chi-square of the estimates of a fit in plain runs, and the minimum of SciPy."""

        def residuals(x):
            values = dict(zip(self.by, np.exp(x).tolist(), strict=False))
            scale, offset = x[len(self.by) :] if self.options else self.sensor
            parts = [
                scale * self.run(name, values, self.times) + offset - data
                for name, data in self.data.items()
            ]
            return np.concatenate(parts) / self.sigma

        first = np.log(list(self.truth.values()))
        first = np.append(first, self.sensor if self.options else ())
        end = least_squares(residuals, first, "3-point", x_scale="jac", xtol=1e-12, ftol=1e-14)
        values = np.append(np.log(list(fit.parameters.values())), list(fit.sensors.values()))
        return float(np.sum(residuals(values) ** 2)), 2.0 * end.cost


def compare(number):
    """Return a row: the fit beside its twin."""
    case = Case(number)
    fit = case.fit()
    row = {"case": number, "kind": "twin", "model": case.model.name, "status": fit.status.kind}
    chi_square, minimum = case.twin(fit)
    row |= {"chi-square": chi_square, "SciPy": minimum, "evaluations": fit.evaluations}
    return row | {"is right": chi_square < (1.0 + 1e-6) * minimum}


def name_error(number, kind):
    """Return a row: the fit of data with an error."""
    factor, delay, words = ERRORS[kind]
    case = Case(number, factor, delay)
    fit = case.fit()
    text = " ".join([fit.status.sentence, *fit.warnings])
    row = {"case": number, "kind": kind, "model": case.model.name, "status": fit.status.kind}
    return row | {"evaluations": fit.evaluations, "is right": words in text}


def start_far(number):
    """Return a row: the fit from first values that are wrong by large factors."""
    case = Case(number)
    rng = np.random.default_rng([8, number])
    name = case.by[0]
    first = case.first | {name: case.truth[name] * np.exp(rng.uniform(np.log(0.04), np.log(9.0)))}
    fit = case.fit(first)
    near = case.fit()
    row = {"case": number, "kind": "far start", "model": case.model.name}
    row |= {"status": fit.status.kind, "chi-square": fit.chi_square, "SciPy": near.chi_square}
    is_right = abs(fit.chi_square / near.chi_square - 1.0) < 1e-4
    return row | {"evaluations": fit.evaluations, "is right": is_right}


def main(count=COUNT):
    warnings.simplefilter("ignore", BeamdaeWarning)
    rows = []
    for number in range(count):
        rows.append(compare(number))
        rows.extend(name_error(number, kind) for kind in ERRORS)
        rows.append(start_far(number))
    table = pd.DataFrame(rows)
    RESULTS.mkdir(exist_ok=True)
    table.to_csv(RESULTS / "drawn.csv", index=False, float_format="%.8g")
    groups = table.groupby("kind", sort=False)
    summary = groups["evaluations"].describe()[["count", "mean", "max"]]
    print(summary.assign(right=groups["is right"].sum()).to_string())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
