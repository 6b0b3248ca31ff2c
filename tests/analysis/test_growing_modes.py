"""Growing modes of large models under follower loads: accuracy and size of the Krylov spaces."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.eigenproblems import quadratic_eigenproblem
from beamdae.analysis.statics.stability import Stability

COUNT = 12


def column(damping=0.0, elements=32, height=1e-2):
    """Return a cantilever of 1 m under the follower load EI / L^2.

    `damping` is relative to the time L^2 sqrt(rho A / EI).
    """
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, 0.02, height)
    unit = np.sqrt(section.rhoA / section.EI)
    section = bd.Section.rectangle(steel, 0.02, height, damping=damping * unit)
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("column", line, section, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("load", beam.end, (-section.EI, 0.0), axes="body"))
    return mech


@pytest.fixture
def krylov_sizes(monkeypatch):
    """Return a list to which the size of each converged Krylov space is appended."""
    sizes = []
    converge = quadratic_eigenproblem.converge

    def spy(krylov, *arguments):
        is_converged = converge(krylov, *arguments)
        sizes.append(krylov.size)
        return is_converged

    monkeypatch.setattr(quadratic_eigenproblem, "converge", spy)
    return sizes


@pytest.mark.slow(reason="two seconds")
def test_modes_under_follower_loads_agree_with_dense_matrices(krylov_sizes):
    path = bd.equilibrium(column(elements=30), to=22.0, step=22.0)
    sparse = bd.modes(column(elements=30), about=path, n=COUNT)
    assert krylov_sizes
    dense = bd.modes(column(elements=30), about=path, n=None)
    assert sparse.kinds[0] == "unstable"
    assert_allclose(sparse.eigenvalues, dense.eigenvalues[:COUNT], rtol=1e-6)


@pytest.mark.parametrize("damping", [0.0, 1e-3, 0.1], ids=["undamped", "damped", "overdamped"])
def test_regression_stability_of_large_columns_needs_small_krylov_spaces(damping, krylov_sizes):
    # Spaces of up to 580 vectors were necessary, because damping in proportion to the stiffness
    # gives all fast modes nearly the same rate of decay.
    path = bd.equilibrium(column(damping), to=8.0, step=8.0)
    assert path.status.success
    assert not np.any(path.unstable)
    assert krylov_sizes
    # Rounding varies this number from 144 to 268.
    assert max(krylov_sizes) <= 400


@pytest.mark.slow(reason="seven seconds")
@pytest.mark.parametrize(
    ("damping", "expected"), [(0.0, 20.0365), (1e-3, 10.935), (0.1, 13.6348), (1.0, None)]
)
def test_flutter_loads_of_damped_columns_do_not_depend_on_the_mesh(damping, expected):
    for elements in (8, 32):
        path = bd.equilibrium(column(damping, elements), to=25.0)
        assert path.status.success
        loads = [one.factor for one in path.critical]
        assert_allclose(loads, [] if expected is None else [expected], rtol=2e-5)


@pytest.mark.slow(reason="two seconds")
def test_regression_flutter_of_slender_columns_with_many_elements_is_not_missed():
    # The Krylov space of the quadratic eigenvalue problem missed growing modes.
    for height, elements in ((1e-5, 32), (2e-5, 24)):
        path = bd.equilibrium(column(elements=elements, height=height), to=25.0)
        (point,) = path.critical
        assert point.kind == "flutter point"
        assert point.factor == pytest.approx(20.0510, rel=1e-4)


@pytest.mark.slow(reason="two seconds")
def test_regression_flutter_of_slender_columns_is_not_found_late():
    # Growth that rounding does not explain began at 2e-5 of the load beyond flutter (L/h = 1e5).
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 1e-5)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), (1.0, 0.0)), section, 16, strain="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))

    def drag(s, x, y, t):
        return -section.EI * (1.0 - s), 0.0 * s

    mech.add(bd.DistributedForce("drag", beam, drag, axes="section"))
    (point,) = bd.equilibrium(mech, to=166.0).critical
    assert point.kind == "flutter point"
    # W. Hauger, Ing.-Arch. 35 (1966) 221.
    assert point.factor == pytest.approx(150.64160, rel=5e-6)


def test_discriminant_of_two_vibrations_changes_its_sign_where_they_coincide():
    def stability(*squares):
        none = np.zeros((2, 0))
        return Stability(np.zeros(0), none, 0, squares=np.array(squares, complex))

    assert stability(-4.0, -1.0, -9.0).discriminant(-2.0) == pytest.approx(9.0)
    assert stability(-2.5 + 0.5j, -9.0, -2.5 - 0.5j).discriminant(-2.5) == pytest.approx(-1.0)
    assert np.isnan(stability(-4.0).discriminant(-4.0))
