"""Points sliding along deformed beams: exact solutions, reactions and balances."""

import numpy as np
import pytest
from conformance import integrators
from mechanisms import EARTH, clamped_beam, hinged_beam, rectangle
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations

import beamdae as bd

CHORD = VARIANTS[2]


def bead_on_rotating_rod(E, elements=4):
    """Return a mechanism of a bead on a rod that rotates at a constant rate."""
    omega, distance = 2.0, 0.3
    section = rectangle(0.02, material=bd.Material(E=E, nu=0.3, rho=7800.0))
    mech, rod = hinged_beam(section, elements, 2.0, name="rod", angular_velocity=omega)
    velocity = (0.0, omega * distance)
    bead = mech.add(bd.PointMass("bead", 0.1, at=(distance, 0.0), velocity=velocity))
    motor = mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), rod.start, lambda t: omega * t))
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


def bead_on_hanging_arc(elements):
    """Return a bead on a pinned flexible arc."""
    mech = bd.Mechanism(gravity=EARTH)
    start = (-np.sin(1.2), -np.cos(1.2))
    arc = bd.Arc(radius=1.0, length=2.4, start=start, angle=-1.2)
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7800.0)
    section = rectangle(0.004, 0.03, damping=1e-4, material=steel)
    beam = mech.add(bd.Beam("arc", arc, section, elements=elements))
    bead = mech.add(bd.PointMass("bead", 0.5, at=tuple(arc.point(0.4).tolist())))
    for name, end in (("left", beam.start), ("right", beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*end.point), end))
    slide = mech.add(bd.SlidingOnBeam("slide", bead.point, beam))
    mech.observe("s", slide.s)
    mech.observe("slide", slide.reaction)
    return mech


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


def bead_on_short_rail(speed, ends="record"):
    """Return a mechanism of a bead at s = 0.4 m on a rail of 1 m."""
    section = rectangle(0.02)
    mech, rail = clamped_beam(section, 1, name="rail", nodes=3)
    bead = mech.add(bd.PointMass("bead", 1e-3, at=(0.4, 0.0), velocity=(speed, 0.0)))
    mech.add(bd.SlidingOnBeam("slide", bead.point, rail, ends=ends))
    return mech


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("ends", ["record", "stop"])
def test_passing_an_end_is_an_event(ends):
    solution = bd.simulate(bead_on_short_rail(2.0, ends), bd.Radau(), t_end=0.5)
    (record,) = solution.events.to_dict("records")
    assert record["event"] == "slide at the end of rail"
    assert record["direction"] == "up"
    assert_allclose(record["t [s]"], 0.3, rtol=1e-6)
    assert_allclose(solution.t[-1], 0.5 if ends == "record" else 0.3, rtol=1e-6)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    ("speed", "t_end", "place"),
    [
        (2.0, 0.5, "the end of rail at t = 0.30"),
        (-20.0, 0.12, "the start of rail at t = 0.02"),
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
