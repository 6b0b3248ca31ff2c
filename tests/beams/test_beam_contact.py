"""Contact along beams: strips on a cylinder and on a plane, in closed form, and point contacts."""

import re

import numpy as np
import pytest
from conformance import integrators
from mechanisms import rectangle
from numpy.testing import assert_allclose
from scipy.integrate import quad
from support import NumericEquations, random_state

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
