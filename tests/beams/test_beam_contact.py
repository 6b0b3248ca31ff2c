"""Contact along beams, and points that slide along deformed beams."""

import re

import numpy as np
import pytest
from conformance import integrators
from mechanisms import EARTH, clamped_beam, hinged_beam, rectangle
from numpy.testing import assert_allclose
from scipy.integrate import quad
from support import ARC, VARIANTS, NumericEquations, random_state

import beamdae as bd

LENGTH, RADIUS, GRAVITY = 0.3, 0.5, 9.81
SPRING_STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
STRIP = rectangle(0.0005, material=SPRING_STEEL)
BOUNDS = tuple(np.linspace(0.0, LENGTH, 13).tolist())


def strip(mech, elements, **settings):
    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    settings = {"formulation": "exact"} | settings
    return mech.add(bd.Beam("strip", line, STRIP, elements=elements, **settings))


@pytest.mark.parametrize(
    "elements", [10, pytest.param(40, marks=pytest.mark.slow(reason="several runs"))]
)
@pytest.mark.parametrize("ratio", [2.0, 4.0])
def test_strip_pressed_around_a_cylinder(elements, ratio):
    """Elastica of the free end: EI k^2 / 2 = F sin(turn), with k = 1 / R where it lifts off."""
    mech = bd.Mechanism()
    beam = strip(mech, elements)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    cam = bd.CircleSurface(mech.ground.at(0.0, -RADIUS), RADIUS)
    wrap = mech.add(bd.BeamContact("wrap", beam, cam, 1e9, exponent=1.0))
    force = ratio * STRIP.EI / (RADIUS * LENGTH)
    mech.add(bd.Force("press", beam.end, (0.0, -force), axes="body"))
    mech.observe("tip", beam.end)
    mech.observe("strip", beam.section_forces(0.05))
    mech.observe("on strip", wrap.force)
    mech.observe("beyond", wrap.pressure(0.95 * LENGTH))
    columns = bd.equilibrium(mech).columns
    turn = np.arcsin(STRIP.EI / (2.0 * force * RADIUS**2))
    free = np.sqrt(STRIP.EI / (2.0 * force)) * quad(lambda x: np.sin(x) ** -0.5, 0.0, turn)[0]
    angle = (LENGTH - free) / RADIUS + turn
    assert_allclose(-columns["tip.angle [rad]"][-1], angle, rtol=1e-3)
    assert_allclose(columns["strip.M [N m]"][-1], STRIP.EI / RADIUS, rtol=5e-3)
    assert columns["beyond.p [N/m]"][-1] == 0.0
    assert columns["on strip.Fy [N]"][-1] > 0.0


def test_heavy_strip_on_a_plane_with_a_lifted_end():
    """Lifting the end by d raises the length a = (24 EI d / q)^(1/4); the force is q a / 2."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    beam = strip(mech, 30)
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), beam.start, (0.0, 1.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    rest = mech.add(bd.BeamContact("rest", beam, floor, 1e9, exponent=1.0))
    lift = 5e-4
    load, ends = STRIP.rhoA * GRAVITY, (mech.ground.at(LENGTH, 0.0), beam.end)
    law = lambda t: lift * t  # noqa: E731
    drive = mech.add(bd.TranslationalDriver("lift", *ends, law, (0.0, 1.0)))
    mech.observe("drive", drive.reaction)
    mech.observe("floor", rest.force)
    columns = bd.equilibrium(mech, t=1.0).columns
    raised = (24.0 * STRIP.EI * lift / load) ** 0.25
    assert raised < 0.9 * LENGTH
    assert_allclose(abs(columns["drive.F [N]"][-1]), load * raised / 2.0, rtol=0.01)
    total = abs(columns["drive.F [N]"][-1]) + columns["floor.Fy [N]"][-1]
    assert_allclose(total, load * LENGTH, rtol=1e-6)


@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_forces_are_those_of_point_contacts_at_the_gauss_points(formulation):
    law = {"exponent": 1.5, "restitution": 0.7, "impact_speed": 1.0, "friction": 0.3}
    law |= {"friction_speed": 0.2}
    equations = []
    for is_one in (True, False):
        mech = bd.Mechanism()
        beam = strip(mech, BOUNDS, formulation=formulation)
        cam = bd.CircleSurface(mech.ground.at(0.1, -0.2), 0.21)
        if is_one:
            mech.add(bd.BeamContact("wrap", beam, cam, 1e3, **law))
        else:
            places = beam.mesh.gauss_arc_lengths(beam.mesh.nodes)
            half = 0.5 * LENGTH / (len(BOUNDS) - 1)
            shares = np.polynomial.legendre.leggauss(beam.mesh.nodes)[1] * half
            for k, s in enumerate(places.tolist()):
                stiffness = 1e3 * shares[k % beam.mesh.nodes]
                mech.add(bd.Contact(f"point {k}", beam.at(s), cam, stiffness, **law))
        equations.append(NumericEquations(mech))
    one, many = equations
    q = one.equations.q0
    _, v, _ = random_state(one, 0)
    expected = many.force(q, v)
    assert np.max(np.abs(expected)) > 0.0
    assert_allclose(one.force(q, v), expected, rtol=1e-9, atol=1e-9 * np.max(np.abs(expected)))


@integrators(rtol=1e-6, step=1e-3, slow=("ida", "alpha stabilized", "alpha adaptive"))
def test_friction_stops_a_sliding_strip(integrator):
    speed, friction = 0.4, 0.3
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    section = rectangle(0.01, damping=1e-4, material=SPRING_STEEL)
    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    beam = bd.Beam("strip", line, section, elements=1, velocity=(speed, 0.0), angular_velocity=0.0)
    mech.add(beam)
    stiffness = 1e6
    depth = section.rhoA * GRAVITY / stiffness
    floor = bd.LineSurface(mech.ground.at(0.0, depth))
    law = {"friction": friction, "friction_speed": 1e-3, "exponent": 1.0}
    mech.add(bd.BeamContact("slide", beam, floor, stiffness, **law))
    mech.observe("middle", beam.at(0.5 * LENGTH))
    run = bd.simulate(mech, integrator, t_end=0.1, output_step=0.02)
    expected = speed - friction * GRAVITY * run.t
    assert_allclose(run["middle.x_dot"], expected, atol=2e-3)
    assert abs(run.energies["energy.imbalance [J]"].iloc[-1]) < 1e-4


@pytest.mark.parametrize(
    ("distance", "stiffness", "friction", "message"),
    [
        (0.01, 0.5, 0.0, "slide: the contact sinks .* more than strip is long"),
        (-0.01, 1e5, 0.0, "slide: strip starts 0.01 m inside the surface"),
        (0.01, 1e5, 0.0, None),
    ],
)
def test_warnings_are_those_of_contacts_of_points(distance, stiffness, friction, message):
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
    beam = strip(mech, 2)
    floor = bd.LineSurface(mech.ground.at(0.0, -distance))
    law = {"exponent": 1.0, "friction": friction}
    mech.add(bd.BeamContact("slide", beam, floor, stiffness, **law))
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=0.4)
    found = [x for x in run.warnings if x.startswith("slide: ")]
    assert len(found) == (message is not None)
    assert not found or re.match(message, found[0])


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_the_unit_of_the_stiffness_is_checked(exponent):
    @bd.model(t_end=0.1)
    def wrap(k=bd.param(1e5, "N/m"), exponent=exponent):
        mech = bd.Mechanism()
        floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
        mech.add(bd.BeamContact("wrap", strip(mech, 2), floor, k, exponent=exponent))
        return mech

    with pytest.raises(bd.BeamdaeError, match=rf"must be in N/m\^{exponent + 1:g} with"):
        wrap()


ERRORS = {
    "range": ({"start": 0.2, "end": 0.1}, "start must be less than end"),
    "outside": ({"end": 9.0}, "arc length s must lie in"),
    "surface": ({"surface": 3}, "surface must be a LineSurface or a CircleSurface"),
    "stiffness": ({"stiffness": 0.0}, "stiffness must be positive"),
}


def test_pressure_exists_where_the_beam_can_touch():
    mech = bd.Mechanism()
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    half = mech.add(bd.BeamContact("half", strip(mech, 2), floor, 1.0, end=0.15))
    with pytest.raises(bd.BeamdaeError, match=r"half: arc length s must lie in \[0, 0.15\] m"):
        half.pressure(0.28)


@pytest.mark.parametrize("name", ERRORS)
def test_wrong_arguments_are_one_sentence(name):
    mech = bd.Mechanism()
    beam = strip(mech, 2)
    settings, sentence = ERRORS[name]
    arguments = {"surface": bd.LineSurface(mech.ground.at(0.0, 0.0)), "stiffness": 1.0} | settings
    with pytest.raises(bd.BeamdaeError, match=sentence):
        bd.BeamContact("wrap", beam, **arguments)


def test_a_surface_on_the_beam_itself_is_rejected():
    mech = bd.Mechanism()
    beam = strip(mech, 2)
    with pytest.raises(bd.BeamdaeError, match="surface must not be on the beam itself"):
        bd.BeamContact("wrap", beam, bd.LineSurface(beam.start), 1.0)


@pytest.mark.parametrize("place", [0.31, 0.437, 0.5])
def test_small_circles_do_not_pass_between_contact_points(place):
    mech, radius = bd.Mechanism(), 0.005 * LENGTH
    beam = strip(mech, 2)
    pin = bd.CircleSurface(mech.ground.at(place * LENGTH, -radius), radius)
    contact = mech.add(bd.BeamContact("pin", beam, pin, 1e5))
    mech.observe("gap", contact.gap)
    assert -1e-12 < NumericEquations(mech).observed("gap")[0] < 0.05 * radius
    tiny = bd.CircleSurface(mech.ground.at(0.0, -1.0), 1e-4 * LENGTH)
    with pytest.raises(bd.BeamdaeError, match=r"tiny: the radius of the surface must be at least"):
        bd.BeamContact("tiny", beam, tiny, 1e5)


# Points sliding along deformed beams: exact solutions, reactions and balances.

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
