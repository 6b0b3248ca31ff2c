"""Laws of the runs of every entry of the catalog."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from conformance import IDA_FORMS
from numpy.testing import assert_allclose, assert_array_equal
from properties.catalog_models import T_END, entry_model
from properties.run_laws import max_relative_difference, position_columns

import beamdae as bd

ROWS, RTOL = 0.02, 1e-5
INTEGRATORS = [getattr(bd, name) for name in bd.__all__]
INTEGRATORS = [x for x in INTEGRATORS if isinstance(x, type) and issubclass(x, bd.Integrator)]
METHODS = {x.__name__: x(rtol=RTOL) for x in INTEGRATORS if x is not bd.Integrator}
FORMS = {name: replace(method, rtol=RTOL) for name, method in IDA_FORMS.items()} | {
    "alpha stabilized": bd.GeneralizedAlpha(rtol=RTOL, formulation="stabilized-index2")
}
STEP = 1e-2  # relative, of differences by the parameter
# They are called in runs only.
WITHOUT_DERIVATIVES = ("Controller", "Sample")


@cache
def reference_run(entry: str) -> bd.results.Solution:
    return completed(entry_model(entry=entry), bd.Radau(1e-3 * RTOL))


def completed(model, method, t_end=T_END, rows=ROWS, **settings) -> bd.results.Solution:
    """Return a run that has reached its end."""
    run = bd.simulate(model, method, t_end, rows, **settings)
    assert run.status.success, run.status.sentence
    return run


def require_agreement(
    run: bd.results.Solution, exact: bd.results.Solution, name: str = "", most=100.0
) -> None:
    """Require differences of at most `most` rtol of half the range of each position."""
    off = max_relative_difference(run, exact) / RTOL
    assert off <= most, f"{name}: off by {off:.2g} rtol"


def check_integrators(entry: str) -> None:
    """All integrators satisfy their tolerance and balance the energy."""
    exact = reference_run(entry)
    assert exact.quality.energy_imbalance <= RTOL
    for name, method in METHODS.items():
        run = completed(exact.equations, method)
        require_agreement(run, exact, name)
        assert run.quality.energy_imbalance <= 100.0 * RTOL, name


def check_formulations(entry: str) -> None:
    """Joints constrain positions, velocities and accelerations alike."""
    exact = reference_run(entry)
    for name, method in FORMS.items():
        require_agreement(completed(exact.equations, method), exact, name)


def check_storage(entry: str) -> None:
    """A saved run has the same numbers, alone and with its model."""
    run = reference_run(entry)
    with TemporaryDirectory() as folder:
        path = run.save(Path(folder) / "entry.run")
        for loaded in (bd.load(path), bd.load(path, entry_model(entry=entry))):
            assert list(loaded.table()) == list(run.table())
            assert_array_equal(loaded.table(), run.table())


def check_resumption(entry: str) -> None:
    """A run continues another, in memory and from a checkpoint."""
    exact = reference_run(entry)
    with TemporaryDirectory() as folder:
        first = completed(exact.equations, bd.Radau(RTOL), 0.6 * T_END)
        starts = (first, first.save(Path(folder) / "end.json"))
        later = [completed(exact.equations, bd.Radau(RTOL), start=start) for start in starts]
    assert_array_equal(later[0].table(), later[1].table())
    require_agreement(first.followed_by(later[0]), exact)


@contextmanager
def plain_python() -> Iterator[None]:
    """Switch machine code off."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BEAMDAE_NATIVE", "off")
        yield


def check_interpretation(entry: str) -> None:
    """Machine code and Python have the same results, with fixed steps up to rounding."""
    equations = reference_run(entry).equations
    for method in (bd.GeneralizedAlpha(1e-3, newton_tolerance=1e-10), *METHODS.values()):
        compiled = completed(equations, method, 2.0 * ROWS)
        with plain_python():
            interpreted = completed(equations, method, 2.0 * ROWS)
        if method.accuracy.name == "step":
            # Positions of 1 m and angles of 1 rad are rounded, however little they move.
            here, there = position_columns(interpreted), position_columns(compiled)
            assert_allclose([*here.values()], [*there.values()], rtol=0.0, atol=1e-11)
        else:
            require_agreement(interpreted, compiled, method.method, 10.0)


def difference(function: Callable[[float], np.ndarray]) -> np.ndarray:
    """Return the derivative of a function at 1 by differences of fourth order."""
    far, near = ((function(1.0 + h) - function(1.0 - h)) / (2 * h) for h in (2 * STEP, STEP))
    return (4.0 * near - far) / 3.0


def check_derivatives(entry: str) -> None:
    """Derivatives of runs, forward and backward, are differences of runs."""
    method, values = bd.Radau(1e-9), {"entry": entry}
    settings = {"parameters": values, "estimate_error": False}
    if entry in WITHOUT_DERIVATIVES:
        with pytest.raises(bd.BeamdaeError, match="is called only in runs"):
            bd.sensitivities(entry_model, "x", method, **settings)
        return
    found = bd.sensitivities(entry_model, "x", method, output_step=ROWS, **settings)

    def columns(x):
        return np.stack(list(completed(entry_model(x=x, **values), method).columns.values()))

    expected = difference(columns)
    for name, exact in zip(found.solution.columns, expected, strict=True):
        size = max(float(np.max(np.abs(exact))), 1e-3)
        actual = found.sensitivity(name, "x")
        assert_allclose(actual, exact, rtol=0.0, atol=1e-4 * size, err_msg=name)
    end = bd.gradient(entry_model, bd.quantities.EndValue("tip.y"), "x", method, **settings)
    assert_allclose(end.array[0], found.sensitivity("tip.y", "x").iloc[-1], rtol=1e-8, atol=1e-11)


def check_beam_formulations(entry: str) -> None:
    """Both formulations of a beam with small strains agree within 2 % of the travel of its end."""
    settings = {"entry": entry, "elements": 4, "stiffness": 1000.0}
    runs = [
        completed(entry_model(formulation=x, **settings), bd.Radau(RTOL))
        for x in ("floating frame", "exact")
    ]
    for name in ("tip.x [m]", "tip.y [m]", "disk.x [m]", "disk.y [m]"):
        here, there = (run.columns[name] for run in runs)
        travel = max(float(np.max(np.abs(there - there[0]))), 1e-3)
        assert np.max(np.abs(here - there)) <= 0.02 * travel, name


RUN_LAWS = {
    "integrators": check_integrators,
    "formulations": check_formulations,
    "storage": check_storage,
    "resumption": check_resumption,
    "interpretation": check_interpretation,
    "derivatives": check_derivatives,
    "beam formulations": check_beam_formulations,
}
