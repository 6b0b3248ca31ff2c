"""Critical points of damped structures under follower loads, against dense eigenvalues."""

import numpy as np
import pytest
import scipy.linalg as la
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.eigenproblems.eigensolution import solve_eigenproblem
from beamdae.analysis.linear_dynamics.linearization import linearize_about
from beamdae.analysis.statics import stability
from beamdae.analysis.statics.stability import Stability

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
EXACT = {"formulation": "exact"}
FLOATING = {"strain": "exact"}
# Next to a critical point, growth is too slow to be distinguished from rounding.
MARGIN = 2e-2
MIN_GROWTH = 1e-7
SHIFT = 100.0


def frame(damping=1e-5, mass=0.2, elements=8, options=EXACT, height=0.004):
    """Return an L frame of 1 m by 1 m with a tip mass, under a follower force of 40 EI / L^2."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.02, height=height, damping=damping)
    column, arm = (
        mech.add(bd.Beam(name, bd.Line(start, end), section, elements, **options))
        for name, start, end in (
            ("column", (0.0, 0.0), (0.0, 1.0)),
            ("arm", (0.0, 1.0), (1.0, 1.0)),
        )
    )
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), column.start))
    mech.add(bd.Weld("corner", column.end, arm.start))
    mech.add(bd.PointMass("mass", mass, on=arm.end))
    mech.add(bd.Force("load", arm.end, (-40.0 * section.EI, 0.0), axes="body"))
    return mech


def column(damping, follower=1.0, elements=8, height=0.02, options=EXACT):
    """Return a cantilever of 1 m under EI / L^2, of which the fraction `follower` turns with it."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.02, height=height, damping=damping)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("column", line, section, elements, **options))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("load", beam.end, (-follower * section.EI, 0.0), axes="body"))
    mech.add(bd.Force("dead load", beam.end, ((follower - 1.0) * section.EI, 0.0)))
    return mech


def dense_growth(mech, path, row):
    """Return the growing eigenvalues [1/s] about a row of the path, from dense matrices."""
    lin = linearize_about("modes", mech, path.at(row))
    scales = lin.equations.position_scales
    gradients = lin.tangent.position_jacobian.toarray() * scales
    basis = la.null_space(gradients / np.max(np.abs(gradients), axis=1)[:, None])
    mass, damping, stiffness = (
        basis.T @ (scales[:, None] * matrix.toarray() * scales) @ basis
        for matrix in (lin.tangent.mass, lin.tangent.damping, lin.tangent.stiffness)
    )
    # Inverted about a shift, so that rounding of fast modes does not enter slow ones.
    factors = la.lu_factor(stiffness + SHIFT * damping + SHIFT**2 * mass)
    by_position, by_rate = (
        -la.lu_solve(factors, matrix) for matrix in (SHIFT * mass + damping, mass)
    )
    one = np.eye(len(mass))
    inverses = la.eigvals(
        np.block([[by_position, by_rate], [one + SHIFT * by_position, SHIFT * by_rate]])
    )
    values = SHIFT + 1.0 / inverses[np.abs(inverses) > 1e-10 * np.max(np.abs(inverses))]
    return values[values.real > MIN_GROWTH * np.abs(values)]


def check_path(mech, path):
    """Check that rows are in order and agree with critical points and dense eigenvalues."""
    assert path.status.success
    assert np.all(np.diff(path.factors[:, -1]) >= 0.0)
    critical = np.array([point.factor for point in path.critical])
    change = {point.row: 2 if point.kind == "flutter point" else 1 for point in path.critical}
    count = 0
    for row, factor in enumerate(path.factors[:, -1]):
        count += change.get(row, 0)
        if np.min(np.abs(factor - critical), initial=np.inf) < MARGIN * factor:
            continue
        assert path.unstable[row] == len(dense_growth(mech, path, row))
        # No mode becomes stable again on these paths.
        assert path.unstable[row] == count


@pytest.mark.slow(reason="two seconds")
def test_regression_damped_follower_frame_has_no_invented_branch_points():
    # Shapes of damped modes have real and imaginary parts, whose span has further eigenvalues; one
    # of these seemed to grow, so that branch points appeared at 0.76 and 0.92, and rows at 0.78
    # had five unstable directions.
    mech = frame(elements=4)
    path = bd.equilibrium(mech)
    assert [point.kind for point in path.critical] == ["flutter point", "flutter point"]
    factors = [point.factor for point in path.critical]
    # 16 elements: 0.098364 and 0.748174.
    assert factors == pytest.approx([0.098364, 0.748174], rel=4e-4)
    check_path(mech, path)


@pytest.mark.slow(reason="seconds for each frame")
@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(
    ("damping", "mass", "elements", "options", "height"),
    [
        (1e-6, 0.2, 8, EXACT, 0.004),
        (1e-5, 0.2, 8, EXACT, 0.004),
        (1e-5, 0.2, 16, EXACT, 0.004),
        (1e-4, 0.2, 8, EXACT, 0.004),
        (1e-3, 0.2, 8, EXACT, 0.004),
        (1e-4, 2.0, 6, FLOATING, 0.004),
        (1e-6, 0.5, 4, FLOATING, 0.004),
        (1e-5, 1.0, 32, EXACT, 0.01),
        (1e-3, 0.05, 8, EXACT, 0.02),
    ],
)
def test_unstable_directions_of_damped_follower_frames(damping, mass, elements, options, height):
    mech = frame(damping, mass, elements, options, height)
    check_path(mech, bd.equilibrium(mech))


@pytest.mark.slow(reason="two seconds")
def test_regression_growth_behind_strongly_damped_modes_is_found():
    # Twelve modes that decay at 1 / damping are slower than the growing ones, which were not
    # counted: no critical point, or 18.2 as the first one.
    mech = column(damping=0.1, follower=0.3)
    path = bd.equilibrium(mech, to=30.0)
    # cos(sqrt(P)) = -0.3 / 0.7 without shear.
    angle = np.arccos(-0.3 / 0.7)
    expected = [angle**2, (2.0 * np.pi - angle) ** 2]
    assert [point.kind for point in path.critical] == ["branch point", "branch point"]
    assert [point.factor for point in path.critical] == pytest.approx(expected, rel=2e-3)
    check_path(mech, path)


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("elements", [8, 16])
def test_regression_flutter_behind_strongly_damped_modes_is_found(elements):
    mech = column(damping=0.01, elements=elements)
    path = bd.equilibrium(mech, to=100.0)
    (point,) = path.critical
    assert point.kind == "flutter point"
    check_path(mech, path)


@pytest.mark.slow(reason="seconds for each formulation")
def test_regression_flutter_of_slender_damped_columns_is_located_without_noise():
    # Errors of the mode shapes entered growth rates in first order, as noise of 1e-8 of the
    # frequency: the loads of both formulations differed by 1.6e-6.
    exact, floating = (
        bd.equilibrium(column(6.7e-4, elements=16, height=1e-3, options=options), to=11.5, step=0.5)
        for options in (EXACT, FLOATING)
    )
    assert [point.kind for point in exact.critical] == ["flutter point"]
    assert [point.kind for point in floating.critical] == ["flutter point"]
    assert exact.critical[0].factor == pytest.approx(floating.critical[0].factor, rel=2e-7)


def portal(damping, elements):
    """Return a clamped portal frame of 1 m by 1 m with follower forces on both corners."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.01, damping=damping)
    corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)]
    left, beam, right = (
        mech.add(bd.Beam(name, bd.Line(start, end), section, elements, **EXACT))
        for name, start, end in zip(("left", "beam", "right"), corners, corners[1:], strict=False)
    )
    mech.add(bd.Weld("left foot", mech.ground.at(0.0, 0.0), left.start))
    mech.add(bd.Weld("right foot", mech.ground.at(1.0, 0.0), right.end))
    mech.add(bd.Weld("left corner", left.end, beam.start))
    mech.add(bd.Weld("right corner", beam.end, right.start))
    for name, at, load in (("first", left.end, 1.0), ("second", right.start, 0.8)):
        mech.add(bd.Force(name, at, (0.3 * section.EI, -load * section.EI), axes="body"))
    return mech


@pytest.mark.slow(reason="five seconds")
def test_regression_limit_point_next_to_a_slow_damped_oscillation_is_no_flutter_point():
    # Behind the minimum of the load, two modes that grow become an oscillation. Their small squared
    # frequencies left one motion out of the refined modes: the point was a flutter point, and the
    # number of unstable directions changed from one to two.
    path = bd.equilibrium(portal(1e-4, 2), to=12.0, control="arc length")
    kinds = [point.kind for point in path.critical]
    assert kinds == ["limit point", "limit point", "flutter point"]
    rows = [point.row for point in path.critical]
    assert [path.unstable[row - 1] for row in rows] == [0, 1, 2]
    assert path.unstable[-1] == 0


@pytest.mark.slow(reason="two seconds")
def test_contradictory_numbers_of_growing_modes_end_the_path(monkeypatch):
    # A real eigenvalue passes zero only where the tangent is singular.
    def grows_beyond(system, x, mu):
        growth = np.array([1.0 + 0j] if mu > 0.6 else [])
        modes = np.ones((system.equations.n, len(growth)))
        return Stability(np.zeros(0), modes, len(growth), growth=growth, growing_modes=modes)

    monkeypatch.setattr(stability, "_assess_motion", grows_beyond)
    with pytest.warns(bd.BeamdaeWarning, match="stability of equilibria changes abruptly"):
        path = bd.equilibrium(column(1e-5), step=0.5)
    assert path.status.kind == "failed"
    assert path.critical == ()


def assert_candidates_match_dense_matrices(mech, about):
    """Compare the modes that may grow with those of dense matrices."""
    lin = linearize_about("modes", mech, about).linearized_equations
    modes = stability.merge_modes(stability.solve_slowest_modes(lin, lin.equations))
    every = solve_eigenproblem(lin, None)
    undamped = solve_eigenproblem(lin, 12, damped=False)
    limit = np.max(np.abs(undamped.values))
    candidates, expected = (
        values[(values.real >= -0.5 * np.abs(values)) & (np.abs(values) < limit)][:12]
        for values in (modes.values, every.values)
    )
    assert len(candidates) == len(expected)
    assert_allclose(candidates, expected, rtol=1e-6)


@pytest.mark.slow(reason="dense matrices of many elements")
@pytest.mark.parametrize("options", [EXACT, FLOATING])
@pytest.mark.parametrize("damping", [1e-6, 1e-4, 1e-3, 1e-2, 1e-1])
def test_slowest_modes_that_may_grow_are_those_of_dense_matrices(damping, options):
    for mech in (column(damping, elements=34, options=options), portal(damping, 12)):
        assert_candidates_match_dense_matrices(mech, "reference")


@pytest.mark.slow(reason="many elements")
def test_regression_flutter_of_a_strongly_damped_column_of_many_elements_is_known():
    # Of 903 coordinates, "the stability of equilibria cannot be computed" was noted.
    fine, coarse = (
        bd.equilibrium(column(damping=0.01, elements=elements), to=36.0, step=18.0)
        for elements in (100, 16)
    )
    (point,), (expected,) = fine.critical, coarse.critical
    assert point.kind == "flutter point"
    assert point.factor == pytest.approx(expected.factor, rel=1e-5)
