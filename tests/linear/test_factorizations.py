"""Accuracy of factorizations, also as linear solvers of IDA."""

import contextlib
import io
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.cases import CAR_AXIS, PENDULUM, SLIDER_CRANK
from conformance import integrators
from numpy.testing import assert_allclose
from sksundae.ida import IDA
from support import use_scikit_sundae

import beamdae as bd
from beamdae.equations.formulations.first_order import (
    FIRST_ORDER,
    evaluate_jacobian,
    evaluate_residual,
    formulate_first_order,
)
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators.ida import python_solver
from beamdae.integrators.ida.callbacks import MAX_STEPS_PER_FACTORIZATION
from beamdae.linear.factorizations import (
    DENSE_LIMIT,
    DenseFactorization,
    SingularMatrixError,
    create_factorization,
)


def numbers(size, rng, dtype):
    imaginary = 1j * rng.normal(size=size) if dtype is complex else 0.0
    return rng.normal(size=size) + imaginary


def arrow(size, rng, dtype=float):
    """Return a banded matrix with full first rows and columns, as floating frames cause."""
    row, column = np.indices((size, size))
    full = (np.minimum(row, column) < 3) | (np.abs(row - column) <= 2)
    pattern = sp.csc_array(full.astype(float))
    nonzeros = numbers(pattern.nnz, rng, dtype)
    matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
    return pattern, nonzeros, matrix.toarray()


@pytest.mark.parametrize("dtype", [float, complex])
@pytest.mark.parametrize("method", ["dense", "sparse"])
@pytest.mark.parametrize("size", [1, 4, 60])
def test_factorization_solves_every_matrix_of_its_pattern(method, size, dtype):
    rng = np.random.default_rng(size)
    pattern, _, _ = arrow(size, rng)
    ones = pattern.data.copy()
    solver = create_factorization(pattern, method, dtype)
    for _ in range(2):
        _, nonzeros, matrix = arrow(size, rng, dtype)
        solver.factorize(nonzeros)
        # Backward stability: the residual, not the solution, is at rounding.
        for shape in ((size,), (size, 3)):
            right = numbers(shape, rng, dtype)
            x = solver.solve(right)
            scale = np.abs(matrix).sum() * np.abs(x).max()
            assert_allclose(matrix @ x, right, rtol=0.0, atol=1e-14 * scale)
    assert (solver.factorizations, solver.solves) == (2, 4)
    # The pattern is shared between factorizations.
    assert_allclose(pattern.data, ones, rtol=0.0, atol=0.0)


def test_auto_is_dense_for_small_systems_and_sparse_for_large_ones():
    for size, dense in ((DENSE_LIMIT, True), (DENSE_LIMIT + 1, False)):
        solver = create_factorization(sp.csc_array(sp.eye_array(size, format="csc")))
        assert isinstance(solver, DenseFactorization) == dense


@pytest.mark.parametrize("dtype", [float, complex])
@pytest.mark.parametrize("method", ["dense", "sparse"])
@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_singular_or_infinite_matrix_is_rejected(method, bad, dtype):
    pattern = sp.csc_array(sp.eye_array(3, format="csc"))
    solver = create_factorization(pattern, method, dtype)
    with pytest.raises(SingularMatrixError):
        solver.factorize(np.array([1.0, bad, 1.0]))
    # The bad matrix must not affect the next one.
    solver.factorize(np.array([1.0, 2.0, 4.0]))
    assert_allclose(solver.solve(np.ones(3)), [1.0, 0.5, 0.25], rtol=1e-15)


@pytest.mark.parametrize("method", ["dense", "sparse"])
def test_rank_deficient_matrix_is_rejected(method):
    pattern = sp.csc_array(np.ones((2, 2)))
    with pytest.raises(SingularMatrixError):
        create_factorization(pattern, method).factorize(np.array([1.0, 2.0, 2.0, 4.0]))


@pytest.mark.parametrize("method", ["dense", "sparse"])
def test_entries_near_the_largest_float_do_not_overflow(method):
    pattern = sp.csc_array(sp.eye_array(2, format="csc"))
    solver = create_factorization(pattern, method)
    solver.factorize(np.array([1.5e308, 1.5e308]))
    assert_allclose(solver.solve(np.array([1.5e308, 0.0])), [1.0, 0.0], rtol=1e-15)


_FIRST_STEPS = 10
_RTOL = 1e-4


class DenseSundialsRun:
    """A run of IDA with the dense solver of SUNDIALS."""

    def __init__(self, form, options):
        self._form = form
        self._buffers, self._nonzeros = form.buffers(), np.zeros(form.pattern.nnz)
        self._branch = 0.0
        self.residuals = self.jacobians = 0
        band_options = ("jacfn", "lband", "uband")
        others = {name: value for name, value in options.items() if name not in band_options}
        dense = {**others, "jacfn": self._jacobian, "linsolver": "dense"}
        self.solver = IDA(self._residual, **dense)

    def _residual(self, t, y, yp, out):
        evaluate_residual(self._buffers, t, self._branch, y, yp, out)
        self.residuals += 1

    def _jacobian(self, t, y, yp, res, c, out):
        nonzeros, pattern = self._nonzeros, self._form.pattern
        evaluate_jacobian(self._buffers, t, self._branch, c, y, yp, nonzeros)
        self.jacobians += 1
        out[:] = sp.csc_array(
            (nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape
        ).toarray()

    def run(self, t_end):
        e = self._form.equations
        self._branch = 0.5 * t_end
        state = ConsistencySolver(e).state(np.array([0.0, 0.5 * t_end]), e.q0, e.v0)
        y, yp = self._form.pack(state)
        t, rows = [0.0], [y]
        with contextlib.redirect_stdout(io.StringIO()):
            self.solver.init_step(0.0, y, yp)
            while t[-1] < t_end:
                result = self.solver.step(t_end, "onestep", t_end)
                assert result.success
                t.append(result.t)
                rows.append(result.y)
        return np.array(t), np.array(rows)


@pytest.mark.slow(reason="runs of beams twice")
@pytest.mark.parametrize("formulation", FIRST_ORDER)
@pytest.mark.parametrize("case", [CAR_AXIS, PENDULUM, SLIDER_CRANK], ids=lambda c: c.name)
def test_ida_with_these_factors_takes_the_steps_of_ida_with_its_dense_solver(
    case, formulation, monkeypatch
):
    options_of_ida = {}

    def create_and_record(residual, **options):
        options_of_ida.update(options)
        return IDA(residual, **options)

    monkeypatch.setattr(python_solver, "IDA", create_and_record)
    settings = bd.Ida(
        rtol=_RTOL,
        formulation=formulation,
        error_control="positions",
        max_order=2,
        linear_solver="dense",
    )
    t_end = 0.5
    solutions = [bd.simulate(case.equations, settings, t_end)]
    use_scikit_sundae(monkeypatch)
    solutions.append(bd.simulate(case.equations, settings, t_end))
    reference = DenseSundialsRun(formulate_first_order(case.equations, formulation), options_of_ida)
    t, y = reference.run(t_end)
    for solution in solutions:
        assert solution.status.success
        compare(solution, reference, t, y)


def compare(solution, reference, t, y):
    """Compare the steps of a run with those of the dense solver of SUNDIALS."""
    (segment,) = solution.trajectory.intervals
    counts = solution.statistics
    # Newton's iterates differ by rounding times the condition number of the iteration matrix, and
    # each step depends on the previous step: the first steps agree to rounding, counts and the end
    # only as in two runs of the same accuracy.
    assert_allclose(len(segment.t), len(t), rtol=0.1)
    # Without scaled rows, rounding changes the rate of convergence: the car axis takes 1275
    # residuals and 5 Jacobians instead of 956 and 9.
    assert 0.7 < counts.residual_calls / reference.residuals < 1.1
    # IDA itself does not limit the age of factors.
    renewals = len(t) / MAX_STEPS_PER_FACTORIZATION
    fewest, most = 0.9 * reference.jacobians - 4, 1.1 * reference.jacobians + 4 + renewals
    assert fewest <= counts.jacobian_calls <= most
    n, first = solution.equations.n, slice(0, _FIRST_STEPS)
    assert_allclose(segment.t[first], t[first], rtol=0.0, atol=1e-10)
    assert_allclose(segment.state.q[first], y[first, :n], rtol=0.0, atol=1e-10)
    assert_allclose(segment.state.v[first], y[first, n : 2 * n], rtol=0.0, atol=1e-9)
    assert_allclose(segment.state.q[-1], y[-1, :n], rtol=0.0, atol=10.0 * _RTOL)
    assert_allclose(segment.state.v[-1], y[-1, n : 2 * n], rtol=0.0, atol=100.0 * _RTOL)


@integrators(
    rtol=1e-5,
    step=5e-3,
    also={"ida ggl": bd.Ida(formulation="ggl")},
    error_control="velocities",
    linear_solver="dense",
    newton_tolerance=1e-11,
)
def test_dense_and_sparse_factors_give_the_same_run(integrator):
    runs = [
        bd.simulate(SLIDER_CRANK.equations, replace(integrator, linear_solver=method), 2.0)
        for method in ("dense", "sparse")
    ]
    assert all(run.status.success for run in runs)
    assert runs[0].statistics.steps == runs[1].statistics.steps
    # A thousandth of rtol: iterations end at other points, so rounding differs.
    assert_allclose(runs[0].q, runs[1].q, rtol=0.0, atol=1e-8)
    assert_allclose(runs[0].v, runs[1].v, rtol=0.0, atol=1e-7)
