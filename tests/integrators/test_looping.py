"""Matrices of compiled loops, and their pivots."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp

import beamdae as bd
from beamdae.errors import KernelWarning
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.native.loops import CompiledLoop
from beamdae.native.object_code import is_native_enabled


def test_pivots_of_another_matrix_are_tried_first():
    pattern = sp.csc_array(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]))
    real = FactorizedMatrix.from_pattern(pattern)
    pair = FactorizedMatrix.from_pattern(pattern, complex, pivot_source=real)
    real.nonzeros[:] = [4.0, 1.0, 1.0, 5.0, 1.0, 1.0, 6.0]
    pair.nonzeros[:] = real.nonzeros * (1.0 + 2.0j)
    factors, pair_factors = (matrix.make_solver(True, "auto") for matrix in (real, pair))
    real.renew_pivots(factors)
    pair.renew_pivots(pair_factors)
    assert pair_factors.plan is factors.plan
    assert pair_factors.factors.matrix.dtype == complex
    # Pivots that worked before and fail now are not tried again.
    pair_factors.is_untried = 0
    pair.renew_pivots(pair_factors)
    assert pair_factors.plan is not factors.plan
    assert pair_factors.singular == 0


def test_matrix_without_pivot_source_finds_its_pivots():
    matrix = FactorizedMatrix.from_pattern(sp.csc_array(np.eye(2)))
    matrix.nonzeros[:] = [2.0, np.nan]
    factors = matrix.make_solver(True, "auto")
    matrix.renew_pivots(factors)
    assert factors.singular == 1
    matrix.nonzeros[:] = 2.0
    factors.singular = 0
    matrix.renew_pivots(factors)
    assert factors.singular == 0
    assert factors.plan.rows.size == 2


def beam():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
    strip = bd.Section.rectangle(alloy, width=0.03, height=0.0025, damping=1e-4)
    strip = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (0.4, 0.0)), strip, elements=1))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), strip.start))
    return mech


@pytest.mark.skipif(not is_native_enabled(), reason="without machine code")
@pytest.mark.parametrize(
    "integrator",
    [
        bd.GeneralizedAlpha(1e-3),
        bd.GeneralizedAlpha(1e-3, formulation="stabilized-index2"),
        bd.GeneralizedAlpha(rtol=1e-3),
        bd.Radau(1e-3),
        bd.Ida(1e-3),
    ],
    ids=lambda x: f"{x.label}",
)
def test_runs_use_machine_code_if_available(integrator, monkeypatch):
    """Otherwise no test fails if a loop cannot be compiled: it runs in plain Python."""
    loops = []
    compile_loop = CompiledLoop.__init__

    def record_loop(self, *arguments, **more):
        compile_loop(self, *arguments, **more)
        loops.append(self)

    monkeypatch.setattr(CompiledLoop, "__init__", record_loop)
    with warnings.catch_warnings():
        warnings.simplefilter("error", KernelWarning)
        solution = bd.simulate(beam(), integrator, 0.01)
    assert solution.status.success
    assert loops
    assert solution.integrator.get("ida", "shared libraries") == "shared libraries"
