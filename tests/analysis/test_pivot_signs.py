"""Numbers of negative eigenvalues from signs of pivots, and eigenvalues of Krylov subspaces."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.statics import bordered_system, corrector
from beamdae.analysis.statics.corrector import Corrector
from beamdae.analysis.statics.krylov_eigenvalues import (
    KrylovSpace,
    begin_block,
    end_block,
    largest_eigenvalues,
)
from beamdae.analysis.statics.load_scaling import build_loading
from beamdae.analysis.statics.path_controls import LoadControl
from beamdae.analysis.statics.stability import assess_stability

STEEL = bd.Material.of("steel")


@pytest.fixture(params=["on", "off"])
def native(request, monkeypatch):
    """Run a test with machine code, compiled at the first iteration, and without it."""
    monkeypatch.setenv("BEAMDAE_NATIVE", request.param)
    monkeypatch.setattr(bordered_system, "_COORDINATE_SECONDS", np.inf)
    return request.param


def column(unit=1.0, axes="inertial"):
    """Return a cantilever column under the force EI / L^2, with lengths in 1 / `unit` m."""
    mech, section = bd.Mechanism(), bd.Section.rectangle(STEEL, 0.02 * unit, 0.005 * unit)
    line = bd.Line((0.0, 0.0), (0.0, unit))
    beam = mech.add(bd.Beam("column", line, section, 8, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("press", beam.end, (0.0, -section.EI / unit**2), axes=axes))
    return mech


def straight_column(mech, factor):
    """Return the straight equilibrium of a column under a load factor."""
    equations = bd.equations_of_motion(mech)
    (system,) = build_loading(mech, equations, None, 0.0).systems
    x = np.append(equations.q0, np.zeros(equations.m))
    return Corrector(system).correct(LoadControl(), factor, x, factor)


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e-3])
def test_column_has_as_many_negative_pivots_as_buckling_loads_below(native, unit):
    # Buckling loads are (2 k - 1)^2 pi^2 / 4 = 2.5, 22.2, 61.7.
    mech = column(unit)
    for factor, expected in ((2.4, 0), (2.6, 1), (21.0, 1), (40.0, 2), (70.0, 3)):
        point = straight_column(mech, factor)
        assert point.system.bordered.count_negative_eigenvalues(point.x, factor) == expected
        assert point.unstable_count == expected
        assert point.free_count == 0


def test_pivots_do_not_decide_about_motions_without_stiffness(native):
    mech = column()
    del mech.parts["clamp"]
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), mech.parts["column"].start))
    point = straight_column(mech, 0.0)
    assert point.system.bordered.count_negative_eigenvalues(point.x, 0.0) is None
    assert point.free_count == 1


def test_pivots_do_not_decide_about_follower_loads(native):
    # Beck's column flutters at 20.05 EI / L^2, where no eigenvalue of the stiffness is negative.
    point = straight_column(column(axes="body"), 25.0)
    assert point.system.bordered.count_negative_eigenvalues(point.x, 25.0) is None
    assert not point.has_potential
    assert point.unstable_count == 2


def test_path_without_critical_points_needs_no_eigenvalues():
    with patch.object(corrector, "assess_stability", wraps=assess_stability) as assess:
        mech = column()
        mech.add(bd.Force("push", mech.parts["column"].end, (1.0, 0.0)))
        path = bd.equilibrium(mech, to=2.0)
    assert path.status.success
    assert list(path.unstable) == [0] * len(path.unstable)
    # The comparison of meshes needs them at the end unless machine code is available.
    assert assess.call_count <= 1


def test_nearest_modes_agree_with_dense_eigenvalues(monkeypatch):
    monkeypatch.setenv("BEAMDAE_NATIVE", "on")
    monkeypatch.setattr(bordered_system, "_COORDINATE_SECONDS", np.inf)
    point = straight_column(column(), 30.0)
    bordered = point.system.bordered
    if not bordered.is_native:
        pytest.skip("machine code is not available")
    modes = bordered.nearest_modes(point.x, 30.0, 4, 1e-10)
    dense = assess_stability(point.system, point.x, 30.0)
    assert modes.negative_count == dense.negative_count == 2
    expected = dense.eigenvalues[np.sort(np.argsort(np.abs(dense.eigenvalues))[:4])]
    # Rounding errors of the axial stiffness.
    assert_allclose(modes.eigenvalues, expected, rtol=1e-6)
    assert_allclose(modes.vectors.T @ modes.vectors, np.eye(4), atol=1e-12)


def test_solutions_by_symmetric_elimination_agree_with_chosen_pivots(monkeypatch):
    monkeypatch.setenv("BEAMDAE_NATIVE", "on")
    monkeypatch.setattr(bordered_system, "_COORDINATE_SECONDS", np.inf)
    point = straight_column(column(), 30.0)
    bordered, random = point.system.bordered, np.random.default_rng(1)
    if not bordered.is_native:
        pytest.skip("machine code is not available")
    gradient = (random.standard_normal(len(point.x)), 0.3)
    x = point.x + 1e-3 * random.standard_normal(len(point.x))
    forces, by_factor = bordered.residual(x, 30.0)
    equations = (x, 30.0, gradient, by_factor, -np.append(forces, 0.1))
    eliminated = bordered.solve(*equations)
    assert bordered._loop.work.by_blocks == 1
    monkeypatch.setattr(bordered, "_eliminates", False)
    expected = bordered.solve(*equations)
    assert bordered._loop.work.by_blocks == 0
    assert_allclose(eliminated, expected, atol=1e-9 * np.max(np.abs(expected)))


def largest_eigenvalues_of(matrix, count, with_vectors=True):
    """Return the eigenvalues of largest magnitude of a symmetric matrix, and their vectors."""
    space = KrylovSpace.allocate(len(matrix))

    def extend(blocks):
        for _ in range(blocks):
            begin_block(space)
            for k in range(space.first, space.vectors):
                space.images[k] = matrix @ space.basis[k]
            end_block(space)

    return largest_eigenvalues(space, extend, count, 1e-12, with_vectors)


def test_krylov_subspaces_find_double_eigenvalues():
    random = np.random.default_rng(0)
    vectors = np.linalg.qr(random.standard_normal((40, 40)))[0]
    expected = np.append([-9.0, 5.0, 5.0, 2.0], 1.0 / np.arange(1.0, 37.0))
    matrix = vectors @ np.diag(expected) @ vectors.T
    values, found = largest_eigenvalues_of(matrix, 4)
    assert_allclose(values, [-9.0, 5.0, 5.0, 2.0], rtol=1e-10)
    assert_allclose(matrix @ found, found * values, atol=1e-5)
    alone, nothing = largest_eigenvalues_of(matrix, 4, with_vectors=False)
    assert_allclose(alone, values, rtol=1e-13)
    assert nothing.shape == (40, 0)


def test_krylov_subspaces_end_at_the_rank_of_the_operator():
    matrix = np.diag([3.0, 2.0, 0.0, 0.0, 0.0])
    values, _ = largest_eigenvalues_of(matrix, 4)
    assert_allclose(np.sort(values)[-2:], [2.0, 3.0], rtol=1e-12)
