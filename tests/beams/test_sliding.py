"""Points sliding along deformed beams: interpolated track, exact solutions, balances."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from conformance import integrators
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations

import beamdae as bd
from beamdae.beams.sliding import interpolate_track, nearest_arc_length

CHORD = VARIANTS[2]


def interpolated_curve(points):
    """Return the function of the curve through `points`, and of its first two derivatives."""
    along = ca.SX.sym("along")
    at = interpolate_track(ca.SX(points), along)
    slope = ca.jacobian(at, along)
    function = ca.Function("track", [along], [at, slope, ca.jacobian(slope, along)])
    return lambda where: [x.full().ravel() for x in function(where)]


@pytest.mark.parametrize("count", [2, 3, 4, 5, 7, 25])
def test_curve_is_exact_for_polynomials(count):
    """Values and two derivatives are exact up to degree four (count - 1 with fewer points)."""
    degree = min(count - 1, 4)
    shape = np.polynomial.Polynomial([0.3, -0.2, 0.5, -0.1, 0.02][: degree + 1])
    k = np.arange(count, dtype=float)
    curve = interpolated_curve(np.stack([k, shape(k)]))
    for at in np.linspace(0.0, count - 1.0, 41):
        values = curve(at)
        expected = [[at, shape(at)], [1.0, shape.deriv(1)(at)], [0.0, shape.deriv(2)(at)]]
        # Rounding errors of fourth powers of 24.
        assert_allclose(values, expected, rtol=1e-12, atol=1e-10)


def test_curve_is_smooth_at_its_points_and_straight_beyond_its_ends():
    points = np.random.default_rng(0).standard_normal((2, 9))
    curve = interpolated_curve(points)
    for k in range(9):
        assert_allclose(curve(k)[0], points[:, k], atol=1e-14)
        below, above = (curve(k + side * 1e-9) for side in (-1, 1))
        # One-sided values, 1e-9 apart, of derivatives of order 100; the curvature jumps to zero at
        # the ends.
        for derivative in range(2 if k in (0, 8) else 3):
            assert_allclose(below[derivative], above[derivative], atol=1e-6)
    start, slope, _ = curve(0.0)
    assert_allclose(curve(-0.7)[0], start - 0.7 * slope, atol=1e-13)
    end, slope, _ = curve(8.0)
    assert_allclose(curve(8.7)[0], end + 0.7 * slope, atol=1e-13)


def test_nearest_arc_length_along_the_whole_curve():
    for s in (0.0, 1e-3, 0.731, ARC.length):
        assert_allclose(nearest_arc_length(ARC, tuple(ARC.point(s))), s, atol=1e-14)


def bead_on_rotating_rod(E, elements=4):
    """Return a mechanism of a bead on a rod that rotates at a constant rate."""
    omega, distance = 2.0, 0.3
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material(E=E, nu=0.3, rho=7800.0), width=0.02, height=0.02)
    line = bd.Line((0.0, 0.0), (2.0, 0.0))
    rod = mech.add(bd.Beam("rod", line, section, elements=elements, angular_velocity=omega))
    velocity = (0.0, omega * distance)
    bead = mech.add(bd.PointMass("bead", 0.1, at=(distance, 0.0), velocity=velocity))
    root = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", root, rod.start))
    motor = mech.add(bd.Driver("motor", root, rod.start, law=lambda t: omega * t))
    slide = mech.add(bd.SlidingOnBeam("slide", bead.point, rod))
    mech.observe("s", slide.s)
    mech.observe("slide", slide.reaction)
    mech.observe("motor", motor.drive)
    return mech, distance, omega


# The flexible bead test below runs with all integrators.
@integrators(rtol=1e-6, step=1e-3, slow=("ida", "alpha stabilized"))
def test_bead_on_a_stiff_rotating_rod(integrator):
    """The solution is s = r0 cosh(omega t); the rod is 1000 times as stiff as steel."""
    mech, distance, omega = bead_on_rotating_rod(2.1e14)
    solution = bd.simulate(mech, integrator, t_end=0.9)
    columns, t = solution.observed, np.asarray(solution.t)
    # 50 rtol, for positions of order 1 m.
    assert_allclose(columns["s [m]"], distance * np.cosh(omega * t), atol=5e-5)
    assert solution.quality.energy_imbalance < 1e-4


@pytest.mark.slow(reason="ten seconds: the fast vibrations of a stiff rod are resolved")
def test_error_of_the_rigid_rod_is_proportional_to_the_compliance():
    """With ten times the stiffness, the difference from the rigid rod is a tenth."""
    off = []
    for E in (2.1e12, 2.1e13):
        mech, distance, omega = bead_on_rotating_rod(E)
        # The error of the steps is 6e-8 m at 1e-5.
        solution = bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=0.9)
        exact = distance * np.cosh(omega * np.asarray(solution.t))
        off.append(np.abs(solution.observed["s [m]"] - exact).max())
    # Measured 2.6e-6 m and 2.6e-7 m.
    assert_allclose(off[0] / off[1], 10.0, rtol=0.02)


def bead_on_hanging_arc(elements, turn=0.0, place=(0.0, 0.0), damping=1e-4):
    """Return a bead on a pinned flexible arc, rotated by `turn` and displaced by `place`."""

    def transform(x, y):
        c, s = np.cos(turn), np.sin(turn)
        return (float(c * x - s * y + place[0]), float(s * x + c * y + place[1]))

    gravity = np.subtract(transform(0.0, -9.81), place)
    mech = bd.Mechanism(gravity=tuple(gravity.tolist()))
    start = transform(-np.sin(1.2), -np.cos(1.2))
    arc = bd.Arc(radius=1.0, length=2.4, start=start, angle=-1.2 + turn)
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7800.0)
    section = bd.Section.rectangle(steel, width=0.03, height=0.004, damping=damping)
    beam = mech.add(bd.Beam("arc", arc, section, elements=elements))
    bead = mech.add(bd.PointMass("bead", 0.5, at=tuple(arc.point(0.4).tolist())))
    for name, end in (("left", beam.start), ("right", beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*end.point), end))
    slide = mech.add(bd.SlidingOnBeam("slide", bead.point, beam))
    mech.observe("s", slide.s)
    mech.observe("slide", slide.reaction)
    return mech


@pytest.mark.slow(reason="half a second and more")
@integrators(rtol=1e-5, step=5e-4, slow=("alpha stabilized",))
def test_energies_of_a_bead_on_a_flexible_arc_are_in_balance(integrator):
    """The bead crosses all element boundaries in both directions."""
    solution = bd.simulate(bead_on_hanging_arc(4), integrator, t_end=1.0)
    assert solution.status.kind == "ok"
    assert solution.observed["s [m]"].max() > 1.9
    # Measured: 6e-7 at most.
    assert solution.quality.energy_imbalance < 1e-5
    assert solution.quality.max_position_drift < 1e-7


@pytest.mark.slow(reason="half a second and more")
def test_element_boundaries_cost_no_steps():
    """Compare eight elements with two in the same motion."""
    few, many = (
        bd.simulate(bead_on_hanging_arc(elements), bd.Radau(rtol=1e-5), t_end=1.0)
        for elements in (2, 8)
    )
    # Measured: 487 and 518 steps.
    assert many.statistics.steps < 1.2 * few.statistics.steps
    # The discretization error of two elements is 2e-4 m.
    assert_allclose(few.observed["s [m]"], many.observed["s [m]"], atol=1e-3)


@pytest.mark.slow(reason="half a second and more")
def test_results_do_not_depend_on_position_and_orientation():
    here, there = (
        bd.simulate(bead_on_hanging_arc(2, *how), bd.Radau(rtol=1e-7), t_end=0.3)
        for how in ((), (0.7, (3.0, -2.0)))
    )
    assert_allclose(here.observed["s [m]"], there.observed["s [m]"], atol=1e-8)
    forces = [
        np.hypot(*x.observed[["slide.Fx [N]", "slide.Fy [N]"]].to_numpy().T) for x in (here, there)
    ]
    assert_allclose(*forces, atol=1e-4 * np.max(forces))


def test_reaction_is_normal_to_the_axis_in_equilibrium():
    mech = bd.Mechanism()
    section = bd.Section(bd.Material(E=60.0, nu=0.3, rho=1.3), area=0.9, second_moment=0.05)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=2))
    bead = mech.add(bd.PointMass("bead", 0.5, at=(0.4, 0.0)))
    slide = mech.add(bd.SlidingOnBeam("slide", bead.point, beam))
    mech.observe("slide", slide.reaction)
    numeric = NumericEquations(mech)
    q, lam = numeric.equations.q0, np.array([0.3, -0.7])
    assert_allclose(numeric.observed("slide", q=q, lam=lam), -lam, rtol=1e-15)
    on_bead = numeric.reaction(q, lam=lam)[numeric.index("bead.x") :][:2]
    assert_allclose(on_bead, lam, rtol=1e-14)
    # In equilibrium the generalized force of s is zero, as there is no friction.
    on_s = numeric.reaction(q, lam=lam)[numeric.index("slide.s")]
    assert_allclose(on_s, -lam[0], rtol=1e-12)


def test_reported_reactions_replace_the_slider():
    """The point is at a node of the beam, where the track coincides with the axis."""
    mech, loaded = bd.Mechanism(), bd.Mechanism()
    beam = CHORD.beam(ARC)
    disk = bd.RigidBody("disk", 1.0, 0.1, center=(0.5, 0.4))
    for mechanism in (mech, loaded):
        mechanism.add(beam)
        mechanism.add(disk)
    s = float(beam.mesh.node_arc_lengths[3])
    point = disk.at(*ARC.point(s).tolist())
    slide = mech.add(bd.SlidingOnBeam("slide", point, beam))
    for name, where in (("a", ("a", "body")), ("beam", ("beam",)), ("s", None)):
        mech.observe(name, slide.s if where is None else slide.reaction_on(*where))
    numeric = NumericEquations(mech)
    rng = np.random.default_rng(4)
    q = numeric.equations.q0 + 0.1 * rng.standard_normal(numeric.n)
    q[-1], lam = s, rng.standard_normal(2)
    *force, moment = numeric.observed("a", q=q, lam=lam).tolist()
    on_beam = numeric.observed("beam", q=q, lam=lam).tolist()
    assert moment == 0.0
    loaded.add(bd.Force("on a", point, tuple(force), "body"))
    loaded.add(bd.Force("on beam", beam.at(s), tuple(on_beam)))
    by_loads = NumericEquations(loaded).force(q[:-1]) - numeric.force(q)[:-1]
    assert_allclose(by_loads, numeric.reaction(q, lam=lam)[:-1], atol=1e-12)  # rounding errors


@pytest.mark.slow(reason="half a second and more")
def test_reaction_on_the_beam_is_normal_to_its_axis():
    mech = bead_on_hanging_arc(4)
    slide = mech.part("slide")
    mech.observe("on beam", slide.reaction_on("beam", axes="body"))
    mech.observe("on bead", slide.reaction_on())
    columns = bd.simulate(mech, bd.Radau(rtol=1e-8), t_end=0.05).columns
    across = columns["on beam.Fy [N]"]
    size = np.hypot(columns["on bead.Fx [N]"], columns["on bead.Fy [N]"])
    # The bead presses the beam down, to the right of the curve.
    assert_allclose(across, -size, rtol=1e-6)
    assert_allclose(columns["on beam.Fx [N]"], 0.0, atol=1e-6 * size.max())
    with pytest.raises(bd.BeamdaeError, match="slide: place must be one of 'a', 'beam', got 'b'"):
        slide.reaction_on("b")


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("ends", ["record", "stop"])
def test_passing_an_end_is_an_event(ends):
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.02)
    rail = mech.add(bd.Beam("rail", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), rail.start))
    bead = mech.add(bd.PointMass("bead", 1e-3, at=(0.4, 0.0), velocity=(2.0, 0.0)))
    mech.add(bd.SlidingOnBeam("slide", bead.point, rail, ends=ends))
    solution = bd.simulate(mech, bd.Radau(), t_end=0.5)
    (record,) = solution.events.to_dict("records")
    assert record["event"] == "slide at the end of rail"
    assert record["direction"] == "up"
    assert_allclose(record["t [s]"], 0.3, rtol=1e-6)
    assert_allclose(solution.t[-1], 0.5 if ends == "record" else 0.3, rtol=1e-6)


def bead_on_short_rail(speed):
    """Return a mechanism of a bead at s = 0.4 m on a rail of 1 m."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.02)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    rail = mech.add(bd.Beam("rail", line, section, elements=1, nodes=3))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), rail.start))
    bead = mech.add(bd.PointMass("bead", 1e-3, at=(0.4, 0.0), velocity=(speed, 0.0)))
    mech.add(bd.SlidingOnBeam("slide", bead.point, rail))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    ("speed", "t_end", "place"),
    [
        (2.0, 0.5, "the end of rail from t = 0.3 s on, by up to 40 % of its length"),
        (-20.0, 0.12, "the start of rail from t = 0.02 s on, by up to 200 % of its length"),
        (2.0, 0.304, ""),
        (2.0, 0.29, ""),
    ],
    ids=["end", "start", "0.8 % beyond", "inside"],
)
def test_regression_points_beyond_an_end_have_a_warning(speed, t_end, place):
    """A trolley in mm/s left its bridge, and loaded it through the tangent without a word."""
    solution = bd.simulate(bead_on_short_rail(speed), bd.Radau(1e-3), t_end)
    assert solution.status.success
    texts = [x for x in solution.warnings if "is beyond the" in x]
    assert len(texts) == bool(place)
    assert all(x.startswith(f"slide: bead is beyond {place}") for x in texts)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda d, b: bd.SlidingOnBeam("slide", d.at(0.0, 0.0), b),
            r"slide: the point must lie on the beam .* disk at \(0, 0\) is 0.36\d* m off the axis "
            "of beam",
        ),
        (
            lambda d, b: bd.SlidingOnBeam("slide", b.end, b),
            "slide: the point must belong to a body other than the beam, got beam at",
        ),
        (
            lambda d, b: bd.SlidingOnBeam("slide", d.at(*ARC.start), b.end),
            "slide: beam must be a Beam, got",
        ),
    ],
)
def test_invalid_sliders_are_rejected(make, message):
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1))
    beam = mech.add(CHORD.beam(ARC))
    with pytest.raises(bd.BeamdaeError, match=message):
        make(disk, beam)


def test_beam_with_too_many_elements_is_rejected():
    mech, *_ = bead_on_rotating_rod(1e9, elements=32)
    assert "slide" in mech.parts
    with pytest.raises(bd.BeamdaeError, match=r"at most 32 elements, but rod has 33 .*; use fewer"):
        bead_on_rotating_rod(1e9, elements=33)


def test_regression_elements_added_at_attachments_count_for_the_limit():
    """The limit was checked only at construction, before assembly adds elements."""
    mech, *_ = bead_on_rotating_rod(1e9, elements=32)
    mech.add(bd.Force("load", mech.part("rod").at(0.77), (0.0, -1.0)))
    with pytest.raises(bd.BeamdaeError, match=r"slide: .* at most 32 elements, but rod has 33 "):
        bd.equations_of_motion(mech)
