"""Critical points under follower loads, with and without damping, and the paths that branch off."""

import numpy as np
import pytest
import scipy.linalg as la
from mechanisms import STEEL, clamped_beam, lee_frame, portal_points, rectangle, welded_frame
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from test_slender_structures import FORMULATIONS

import beamdae as bd
from beamdae.analysis.linear_dynamics.linearization import linearize_about

EXACT = {"formulation": "exact"}
FLOATING = {"strain": "exact"}
# Next to a critical point, growth is too slow to be distinguished from rounding.
MARGIN = 2e-2
MIN_GROWTH = 1e-7
SHIFT = 100.0


def frame(damping=1e-5, mass=0.2, elements=8, options=EXACT, height=0.004):
    """Return an L frame of 1 m by 1 m with a tip mass, under a follower force of 40 EI / L^2."""
    section = rectangle(height, damping=damping)
    points = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
    mech, (_, arm) = welded_frame(points, section, elements, (bd.Weld, None), **options)
    mech.add(bd.PointMass("mass", mass, on=arm.end))
    mech.add(bd.Force("load", arm.end, (-40.0 * section.EI, 0.0), axes="body"))
    return mech


def column(damping, follower=1.0, elements=8, height=0.02, options=EXACT):
    """Return a cantilever of 1 m under EI / L^2, of which the fraction `follower` turns with it."""
    section = rectangle(height, damping=damping)
    mech, beam = clamped_beam(section, elements, name="column", **options)
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
    section = rectangle(0.01, damping=damping)
    mech, (left, _beam, right) = welded_frame(portal_points(), section, elements, **EXACT)
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


def flutter_load(retardation):
    """Return the flutter load of a cantilever under a follower force, in units of EI / L^2.

    The retardation time is in units of sqrt(m L^4 / EI). The characteristic equation is complex
    (Bolotin and Zhinzher 1969), or has a double root without damping (Beck 1952).
    """

    def equations(unknowns):
        load, frequency = unknowns
        factor = 1.0 + 1j * frequency * retardation
        a, b = load / factor, frequency / np.sqrt(factor)
        root = np.sqrt(0.25 * a**2 + b**2)
        one, other = np.sqrt(root + 0.5 * a), np.sqrt(root - 0.5 * a)
        value = a**2 + 2.0 * b**2 * (1.0 + np.cos(one) * np.cosh(other))
        value += a * b * np.sin(one) * np.sinh(other)
        return [value.real, value.imag / (frequency * retardation)]

    return fsolve(equations, [11.0, 5.4], xtol=1e-13)[0] if retardation else 20.0509536


@pytest.mark.slow(reason="half a second each")
@pytest.mark.parametrize("options", [EXACT, FLOATING])
@pytest.mark.parametrize(
    ("height", "retardation"),
    [
        *((height, 0.0) for height in (1e-3, 1e-4, 1e-5, 1e-6)),
        *((1e-3, retardation) for retardation in (1e-9, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 0.05, 0.1)),
        *((height, retardation) for height in (1e-4, 1e-5) for retardation in (1e-3, 0.05)),
    ],
)
def test_flutter_loads_of_columns_of_any_slenderness_and_damping(height, retardation, options):
    time = np.sqrt(12.0 * STEEL.rho / STEEL.E) / height
    mech = column(retardation * time, height=height, options=options)
    path = bd.equilibrium(mech, to=22.0)
    (point,) = path.critical
    assert point.kind == "flutter point"
    # For the mesh, for compression and shear, and for growth as slow as rounding.
    off = 3e-6 + 5.0 * height**2 + (2e-14 / retardation if retardation else 0.0)
    assert point.factor == pytest.approx(flutter_load(retardation), rel=off)


@pytest.mark.filterwarnings("ignore::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize("elements", [4, 150])
def test_motions_of_undamped_columns_grow_and_decay_at_the_same_rates(elements):
    # Beyond the flutter load of 20.05 EI / L^2; its equations have no rates.
    mech = column(0.0, elements=elements, height=0.002)
    values = bd.modes(mech, about=bd.equilibrium(mech, to=22.0), n=4).eigenvalues
    assert values[0].real > 1.0
    assert_allclose(values[1], -values[0].conj(), rtol=1e-6)
    assert_allclose(values[2:].real, 0.0, atol=1e-6)


def column_with_tip(damping, options, is_hinged):
    """Return the column of `column` with a rod hinged at its tip, or with its effective mass.

    Vibrations move a free rod of mass m with the hinge at the distance a from its center of mass
    like a particle of the mass 1 / (1 / m + a^2 / I).
    """
    mech = column(damping, options=options)
    beam, mass, inertia, distance = mech.part("column"), 3.0, 0.4, 0.5
    if is_hinged:
        rod = mech.add(bd.RigidBody("rod", mass, inertia, center=(1.0 + distance, 0.0)))
        mech.add(bd.Revolute("hinge", beam.end, rod.at(1.0, 0.0)))
    else:
        particle = 1.0 / (1.0 / mass + distance**2 / inertia)
        mech.add(bd.PointMass("particle", particle, on=beam.end))
    return mech


@pytest.mark.filterwarnings("ignore:.*this coordinate can move without stiffness")
@pytest.mark.parametrize("options", [EXACT, FLOATING])
@pytest.mark.parametrize("damping", [0.0, 1e-4])
def test_flutter_load_with_a_free_motion_is_that_of_its_effective_mass(damping, options):
    """Springs that hold a free motion on a path take no part in its vibrations."""
    hinged, particle = (
        bd.equilibrium(column_with_tip(damping, options, is_hinged), to=25.0)
        for is_hinged in (True, False)
    )
    assert [point.kind for point in hinged.critical] == ["flutter point"]
    assert_allclose(hinged.critical[0].factor, particle.critical[0].factor, rtol=1e-7)
    assert hinged.unstable[0] == 0
    assert hinged.unstable[-1] == particle.unstable[-1] == 2


@pytest.mark.slow(reason="several seconds")
@pytest.mark.filterwarnings("ignore:.*this coordinate can move without stiffness")
def test_free_motions_stay_still_on_paths_of_any_control():
    """Steps move no strip that hangs free on a frame, and its flutter points are the same."""
    paths = []
    for control in ("load", "arc length"):
        mech = frame(damping=0.0)
        line = bd.Line((1.0, 1.0), (1.5, 1.5))
        strip = mech.add(bd.Beam("strip", line, rectangle(0.004), 8, **EXACT))
        mech.add(bd.Revolute("hinge", mech.part("beam 1").end, strip.start))
        mech.observe("strip", strip.start)
        paths.append(bd.equilibrium(mech, control=control))
    by_load, by_arc_length = ([point.factor for point in path.critical] for path in paths)
    assert len(by_load) == 2
    assert_allclose(by_arc_length, by_load, rtol=1e-6)
    assert max(np.ptp(path["strip.angle"]) for path in paths) < 1e-12


# Branch and limit points under follower loads, and the paths that branch off.

SECTION = rectangle(1e-3)


def half_following_column(share=0.25, **options):
    """Return a cantilever under EI / L^2, of which `share` follows the tip."""
    options = options or {"formulation": "exact"}
    mech, beam = clamped_beam(SECTION, 8, (0.0, 1.0), name="column", **options)
    mech.add(bd.Force("dead", beam.end, (0.0, -(1.0 - share) * SECTION.EI)))
    mech.add(bd.Force("follower", beam.end, (0.0, -share * SECTION.EI), axes="body"))
    mech.observe("tip", beam.end)
    return mech


def divergence_load(share):
    """Return P L^2 / EI where cos(L sqrt(P / EI)) = -share / (1 - share)."""
    return np.arccos(-share / (1.0 - share)) ** 2


def elastica_tip(share, load):
    """Return the lateral displacement of the tip of the inextensible column by shooting."""

    def integrate(end):
        # Angle from the vertical, its derivative and the displacement, from the tip to the clamp.
        sideways = share * np.sin(end)
        downwards = 1.0 - share + share * np.cos(end)

        def rates(_, y):
            moment = load * (downwards * np.sin(y[0]) - sideways * np.cos(y[0]))
            return [-y[1], moment, np.sin(y[0])]

        return solve_ivp(rates, (0.0, 1.0), [end, 0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]

    return integrate(brentq(lambda end: integrate(end)[0], 0.05, 2.5))[2]


@pytest.mark.slow(reason="one second")
@FORMULATIONS
@pytest.mark.parametrize("share", [0.1, 0.25, 0.45])
def test_buckled_path_of_a_column_under_a_partly_following_force(share, options):
    expected = divergence_load(share)
    tips = []
    for side in (1, -1):
        path = bd.equilibrium(
            half_following_column(share, **options), to=1.15 * expected, switch=side
        )
        assert path.status.success
        (point,) = path.critical
        assert point.kind == "branch point"
        # Compression and shear.
        assert point.factor == pytest.approx(expected, rel=3e-6)
        assert path.unstable[-1] == 0
        tips.append(path.columns["tip.x [m]"][-1])
    assert tips[0] == pytest.approx(-tips[1], rel=1e-9)
    assert abs(tips[0]) == pytest.approx(elastica_tip(share, 1.15 * expected), rel=2e-5)


@pytest.mark.slow(reason="several seconds")
def test_divergence_ends_where_half_of_the_force_follows():
    # The two lowest divergence loads merge at pi^2; beyond, the column flutters.
    @bd.model(t_end=1.0)
    def model(share=0.45):
        return half_following_column(share)

    by, to = ("share", "load"), 1.2 * divergence_load(0.45)
    with pytest.warns(bd.BeamdaeWarning, match="unstable directions are not counted"):
        curve = bd.boundary(model, "branch point", by, (0.45, 0.52), step=0.4, to=to)
    assert curve.status.success
    (turning,) = curve.special
    assert turning.kind == "turning point"
    assert turning.value == pytest.approx(0.5, rel=1e-5)
    assert turning.factor == pytest.approx(np.pi**2, rel=1e-5)
    assert_allclose(np.cos(np.sqrt(curve.factors)), -curve.values / (1.0 - curve.values), atol=1e-5)


@pytest.mark.slow(reason="several seconds")
@FORMULATIONS
def test_limit_points_of_a_frame_under_a_follower_force(options):
    # Lee's frame with a follower force: the tangent is not symmetric.
    path = bd.equilibrium(lee_frame(5, "body", **options), to=60.0, control="arc length", step=0.2)
    assert path.status.success
    assert [point.kind for point in path.critical] == ["limit point"] * 2
    # Values of 16 elements; those of 4 elements differ by 5e-5.
    assert_allclose([point.factor for point in path.critical], [35.392, -13.793], rtol=1e-4)
    # The load factor has its extrema there.
    rows = [point.row for point in path.critical]
    assert_allclose(path.factors[rows, 0], [path.factors[: rows[1], 0].max(), path.factors.min()])
