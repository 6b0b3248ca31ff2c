"""Section forces of beams, and the applied loads that they balance."""

from dataclasses import replace

import numpy as np
import pytest
from conformance import JOINTS, KINEMATICS, LOADS
from hub_beam import hub_beam
from mechanisms import clamped_beam, hinged_beam, rectangle
from support import ARC, SOFT_MATERIAL

import beamdae as bd
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.results.section_forces.applied_loads import collect_applied_loads

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=235e6)


# Thick enough that the rounding of axial forces (EA) is small relative to bending.
BAR = rectangle(0.1, material=STEEL)
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))


# A load [N] that deflects the bar by 1e-6 of its length; the section forces differ by as much from
# the closed forms of the undeformed beam.
SMALL = 1.0
FORMULATIONS = {
    "frame": {},
    "moderate strain": {"strain": "green"},
    "exact": {"formulation": "exact"},
}


every_formulation = pytest.mark.parametrize(
    "kind",
    [
        "frame",
        "exact",
        pytest.param("moderate strain", marks=pytest.mark.slow(reason="as the frame")),
    ],
)


def cantilever(curve=LINE, elements=1, section=BAR, gravity=(0.0, 0.0), **settings):
    """Return a mechanism and its cantilever."""
    mech = bd.Mechanism(gravity=gravity)
    beam = mech.add(bd.Beam("beam", curve, section, elements=elements, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(*beam.start.point), beam.start))
    return mech, beam


def simply_supported_beam(elements, **settings):
    """Return a mechanism and its beam on a hinge and a roller."""
    mech, beam = hinged_beam(BAR, elements, LINE, **settings)
    roller = mech.ground.at(1.0, 0.0)
    mech.add(bd.PointOnLine("roller", roller, beam.end, (1.0, 0.0)))
    return mech, beam


def at_rest(mech, beam, s=None, t=0.0):
    """Return the section forces in the equilibrium under the loads at a time [s]."""
    return bd.equilibrium(mech, t=t, step=1.0).section_forces(beam, s)


def assert_section_forces(forces, N, Q, M, size=SMALL, off=3e-6):
    """Assert section forces up to the effect of the deflection, relative to the load."""
    for values, expected in zip((forces.N, forces.Q, forces.M), (N, Q, M), strict=True):
        np.testing.assert_allclose(values[0], expected + 0.0 * forces.s, rtol=0.0, atol=off * size)


S = np.array([0.0, 0.21, 0.5, 0.8, 1.0])


@every_formulation
@pytest.mark.parametrize("elements", [1, 3])
def test_a_cantilever_under_end_loads(elements, kind):
    mech, beam = cantilever(elements=elements, **FORMULATIONS[kind])
    mech.add(bd.Force("load", beam.end, (3.0 * SMALL, -SMALL)))
    mech.add(bd.Moment("moment", beam.end, 0.5 * SMALL))
    # A positive M stretches the left side, here the upper one, as a downward force does.
    assert_section_forces(
        at_rest(mech, beam, S), 3.0 * SMALL, -SMALL, SMALL * (1.0 - S) - 0.5 * SMALL
    )


@every_formulation
def test_loads_along_a_single_element_and_inside_it(kind):
    mech, beam = cantilever(elements=[0.0, 1.0], **FORMULATIONS[kind])
    mech.add(bd.DistributedForce("line", beam, lambda s, x, y, t: (0.0, -SMALL * s)))
    mech.add(bd.Force("load", beam.at(0.37), (0.0, -SMALL)))
    forces = at_rest(mech, beam)
    s = forces.s
    # The section of the force is listed twice, and section forces jump there.
    (twice,) = np.flatnonzero(np.diff(s) == 0.0)
    assert s[twice] == pytest.approx(0.37)
    assert forces.Q[0, twice + 1] - forces.Q[0, twice] == pytest.approx(SMALL)
    near = np.arange(len(s)) <= twice
    Q = -SMALL * (near + 0.5 * (1.0 - s**2))
    M = SMALL * (near * (0.37 - s) + 1.0 / 3.0 - 0.5 * s + s**3 / 6.0)
    assert_section_forces(forces, 0.0, Q, M)
    # Strains of one cubic element have a large error, unlike forces that balance the loads.
    assert np.max(np.abs(forces.strained[2] - M)) > 0.05 * SMALL
    assert np.max(forces.error[2]) < 1e-4 * SMALL


@every_formulation
def test_weight_by_numbers_and_by_laws(kind):
    mech, beam = cantilever(gravity=(0.0, -9.81), **FORMULATIONS[kind])
    weight = BAR.rhoA * 9.81
    constant = at_rest(mech, beam, S)
    # The slope of the beam, up to 7e-5, rotates the section forces.
    assert_section_forces(
        constant, 0.0, -weight * (1.0 - S), 0.5 * weight * (1.0 - S) ** 2, weight, 4e-5
    )
    with_law, beam = cantilever(gravity=(0.0, lambda t: -9.81 + 0.0 * t), **FORMULATIONS[kind])
    by_law = at_rest(with_law, beam, S)
    np.testing.assert_allclose(by_law.M, constant.M, rtol=1e-9, atol=1e-9)


@every_formulation
def test_a_taper_under_its_weight(kind):
    def section(s):
        return rectangle(0.1 * (1.0 - 0.5 * s), material=STEEL)

    mech, beam = cantilever(elements=2, section=section, gravity=(0.0, -9.81), **FORMULATIONS[kind])
    forces = at_rest(mech, beam, S)
    weight = section(0.0).rhoA * 9.81
    Q = -weight * (0.75 - S + 0.25 * S**2)
    M = weight * (1.0 / 3.0 - 0.75 * S + 0.5 * S**2 - S**3 / 12.0)
    assert_section_forces(forces, 0.0, Q, M, weight, off=4e-5)
    # The stress at the surface is M / W of each section.
    W = np.array([section(s).second_moment / (0.5 * section(s).height) for s in S])
    sigma = forces.stress("top")["sigma [Pa]"]
    np.testing.assert_allclose(sigma, M / W, rtol=0.0, atol=1e-4 * np.max(np.abs(M / W)))


@every_formulation
def test_an_initially_bent_beam_has_a_moment(kind):
    settings = {"free_curve": bd.Arc(radius=50.0, length=1.0), **FORMULATIONS[kind]}
    mech, beam = cantilever(elements=2, **settings)
    mech.add(bd.Weld("other clamp", mech.ground.at(1.0, 0.0), beam.end))
    forces = at_rest(mech, beam, S)
    for M in (forces.M, forces.strained[2]):
        np.testing.assert_allclose(M[0], BAR.EI / 50.0, rtol=1e-9)


@every_formulation
def test_an_arc_under_an_end_force(kind):
    # Quarter circle about the origin from (R, 0) to (0, R), with a force P outward at its end.
    R = 0.5
    arc = bd.Arc(radius=R, length=0.5 * np.pi * R, start=(R, 0.0), angle=0.5 * np.pi)
    mech, beam = cantilever(arc, elements=3, **FORMULATIONS[kind])
    mech.add(bd.Force("load", beam.end, (0.0, SMALL)))
    s = np.linspace(0.0, arc.length, 7)
    angle = s / R
    # Tangent (-sin, cos), left normal (-cos, -sin): N = P cos, Q = -P sin; the force
    # rotates the part beyond a section counter-clockwise, with the lever arm R cos to the left.
    assert_section_forces(
        at_rest(mech, beam, s),
        SMALL * np.cos(angle),
        -SMALL * np.sin(angle),
        SMALL * R * np.cos(angle),
    )


@every_formulation
@pytest.mark.parametrize("place", [0.13, 0.5])
def test_the_moment_is_largest_at_a_moving_load(place, kind):
    mech, beam = simply_supported_beam(elements=2, **FORMULATIONS[kind])
    mech.add(bd.MovingForce("load", beam, (0.0, -SMALL), speed=1.0))
    forces = at_rest(mech, beam, t=place)
    s = forces.s
    M = -SMALL * np.where(s <= place, s * (1.0 - place), place * (1.0 - s))
    np.testing.assert_allclose(forces.M[0], M, rtol=0.0, atol=3e-6 * SMALL)
    assert forces.s[np.argmin(forces.M[0])] == pytest.approx(place)


@pytest.mark.slow(reason="a fifth of a second")
@every_formulation
def test_a_slider_loads_the_beam_between_nodes(kind):
    mech, beam = simply_supported_beam(elements=3, **FORMULATIONS[kind])
    block = mech.add(bd.RigidBody("block", 1.0, 1.0, center=(0.4, 0.0)))
    mech.add(bd.Force("load", block.at(0.4, 0.0), (0.0, -SMALL)))
    mech.add(bd.SlidingOnBeam("slide", block.at(0.4, 0.0), beam))
    post = mech.ground.at(0.4, 0.0)
    mech.add(bd.PointOnLine("guide", post, block.at(0.4, 0.0), (0.0, 1.0)))
    mech.add(bd.Driver("upright", post, block.at(0.4, 0.0), 0.0))
    forces = at_rest(mech, beam)
    M = -SMALL * np.where(forces.s <= 0.4, forces.s * 0.6, 0.4 * (1.0 - forces.s))
    np.testing.assert_allclose(forces.M[0], M, rtol=0.0, atol=3e-6 * SMALL)


@every_formulation
@pytest.mark.parametrize("nodes", [4, pytest.param(7, marks=pytest.mark.slow(reason="compiles"))])
def test_air_drag_of_a_turning_beam(nodes, kind):
    """Regression: the recovered drag was uniform in an element."""
    speed, coefficient, mech = 4.0, 10.0, bd.Mechanism()
    section = replace(BAR, damping=2e-3)
    settings = {"nodes": nodes, "elements": 1, **FORMULATIONS[kind]}
    beam = mech.add(bd.Beam("beam", LINE, section, angular_velocity=speed, **settings))
    axle = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("axle", axle, beam.start))
    mech.add(bd.Driver("drive", axle, beam.start, lambda t: speed * t))
    mech.add(bd.AirDrag("air", beam, coefficient))
    # Strong damping ends the vibrations about the steady rotation.
    run = bd.simulate(mech, bd.Radau(1e-6), t_end=0.2, output_step=0.2)
    forces = run.section_forces(beam, t=0.2, s=S)
    # The drag per length is coefficient (speed s)^2. Slopes of 5e-5 turn the axial force, 1 to 2
    # times the drag, into shear forces.
    scale = coefficient * speed**2
    Q, M = -(1.0 - S**3) / 3.0, 0.25 * (1.0 - S**4) - S * (1.0 - S**3) / 3.0
    for values, expected in ((forces.Q, Q), (forces.M, M)):
        np.testing.assert_allclose(values[0] / scale, expected, rtol=0.0, atol=1e-4)


def test_inactive_parts_have_no_load():
    mech, beam = cantilever()
    load = mech.add(bd.Force("load", beam.end, (0.0, -SMALL)))
    mech.deactivate(load)
    solution = bd.simulate(mech, bd.GeneralizedAlpha(1e-3), t_end=2e-3)
    assert np.max(np.abs(solution.section_forces(beam).M)) < 1e-9 * SMALL


@pytest.mark.slow(reason="runs the hub beam on four meshes")
@every_formulation
def test_orders_and_error_estimate_on_the_hub_beam(kind):
    settings = {"frame": "chord", "damping": 1e-3} | FORMULATIONS[kind]
    times, length = np.linspace(0.1, 2.0, 20), hub_beam.parameters["length"]

    def forces(elements):
        model = hub_beam(elements=elements, **settings)
        run = bd.simulate(model, bd.Radau(1e-9), t_end=2.0, output_step=0.1)
        result = run.section_forces("beam", t=times, s=np.linspace(0.0, length, 49))
        return result.M, result.strained[2], result.error[2]

    finest, _, _ = forces(24)
    size = np.max(np.abs(finest))
    balanced, strained, estimates = [], [], []
    for elements in (2, 4, 8):
        M, of_strains, error = forces(elements)
        balanced.append(np.max(np.abs(M - finest)) / size)
        strained.append(np.max(np.abs(of_strains - finest)) / size)
        estimates.append(np.max(error) / size)
    # Measured with all formulations: 1.9e-3, 3.9e-5, 7.1e-7 and 1.3e-2, 1.6e-3, 2.0e-4.
    assert np.all(np.log2(np.array(balanced[:-1]) / balanced[1:]) > 5.0)
    assert np.all(np.log2(np.array(strained[:-1]) / strained[1:]) > 2.7)
    if kind != "exact":
        # They contain the error of the strains of the model, which no mesh reduces.
        assert np.all(np.array(estimates) > balanced)
    else:
        # A run with halved elements and a third of the tolerance shows nearly all of the error.
        np.testing.assert_allclose(np.array(estimates) / balanced, 1.1, atol=0.1)


@pytest.mark.parametrize("kind", ["exact", "frame"])
def test_a_beam_bent_into_a_hook(kind):
    # Section forces follow from the deformed positions: n = P, m = (r_end - r) x P.
    slender = rectangle(0.002, material=STEEL)
    mech, beam = cantilever(elements=6, section=slender, **FORMULATIONS[kind])
    mech.add(bd.Force("load", beam.end, (0.0, -30.0)))
    for s in (0.5, 1.0):
        mech.observe(f"at {s}", beam.at(s))
    path = bd.equilibrium(mech, to=[0.5, 1.0])
    forces, at = path.section_forces(beam, [0.0, 0.5, 1.0]), path.columns
    x, angle = (
        np.array([at[f"at {s}.{c}"][-1] for s in (0.5, 1.0)]) for c in ("x [m]", "angle [rad]")
    )
    assert angle[1] < -1.3
    np.testing.assert_allclose(forces.M[0], 30.0 * (x[1] - np.array([0.0, *x])), atol=1e-6)
    np.testing.assert_allclose(forces.N[0, 1:], -30.0 * np.sin(angle), atol=1e-6)
    np.testing.assert_allclose(forces.Q[0, 1:], -30.0 * np.cos(angle), atol=1e-6)
    # At half of the load.
    half = path.at(int(np.argmin(np.abs(path.factors[:, 0] - 0.5))))
    assert half.factor == pytest.approx(0.5)
    tip = half.section_forces(beam, 1.0)
    assert np.hypot(tip.N[0, 0], tip.Q[0, 0]) == pytest.approx(30.0 * half.factor)


@pytest.mark.parametrize("settings", [{}, {"strain": "nonlinear", "frame": "tangent"}])
@pytest.mark.parametrize("height", [0.004, 0.006])
def test_regression_axial_forces_act_normal_to_the_deformed_section(settings, height):
    """Under a transverse load, N at a clamp is zero; EA eps11 was up to 7 % of the load there."""
    section = rectangle(height, 0.03)
    mech, beam = clamped_beam(section, curve=0.5, **settings)
    mech.add(bd.Force("load", beam.end, (0.0, -30.0)))
    mech.observe("root", beam.section_forces(0.0))
    mech.observe("end", beam.section_forces(0.5))
    mech.observe("tip", beam.end)
    path = bd.equilibrium(mech)
    angle = path["tip.angle"].iloc[-1]
    np.testing.assert_allclose(path["root.N"].iloc[-1], 0.0, atol=2e-3)
    np.testing.assert_allclose(path["end.N"].iloc[-1], -30.0 * np.sin(angle), rtol=2e-3)
    forces = path.section_forces(beam)
    np.testing.assert_allclose(forces.strained[0][-1][[0, -1]], forces.N[-1][[0, -1]], atol=8e-3)


SECTION = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05, damping=0.03)
PARTS = JOINTS | LOADS


FRAME, NODES = "chord frame, Green's strain", "nodes"


# One part per distribution of loads: at points, per length, over nodes, on elements.
KINDS = ("slider on a beam", "spring within a beam", "pressure", "sliding in the span", "AirDrag")


def collect_loads(make, kind, shape="curved", nodes=4):
    """Return a beam and the loads on it at random positions and velocities."""
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    kinematics = KINEMATICS[kind]
    settings = {"elements_shape": shape, "nodes": nodes}
    beam = bd.Beam("beam", ARC, SECTION, 2, kinematics=kinematics, **settings)
    mech.add(beam)
    if make is not None:
        mech.add(make(mech, disk, beam))
    e = bd.equations_of_motion(mech)
    rng = np.random.default_rng(0)
    q, v = e.q0 + 0.05 * rng.standard_normal(e.n), rng.standard_normal(e.n)
    time = np.array([0.7, 0.7])
    a, lam = ConsistencySolver(e).acceleration(time, q, v)
    state = State(q[None], v[None], a[None], lam[None])
    return beam, collect_applied_loads(beam, e, time[None], state)


def assert_balanced(make, kind, shape="curved", off=1e-11, nodes=4):
    beam, loads = collect_loads(make, kind, shape, nodes)
    line_loads = np.einsum("rekc,k->rec", loads.line_loads, gauss_points(beam.mesh.nodes)[1])
    parts = np.concatenate([line_loads, loads.wrenches], axis=1)[0]
    np.testing.assert_allclose(parts.sum(axis=0), 0.0, atol=off * np.max(np.abs(parts)))
    return loads


@pytest.mark.parametrize(
    ("kind", "shape"),
    [*((kind, "curved") for kind in KINEMATICS), (FRAME, "straight"), (NODES, "straight")],
)
def test_weight_balances_inertia(kind, shape):
    loads = assert_balanced(None, kind, shape)
    assert not loads.wrenches.size


@pytest.mark.parametrize("kind", [FRAME, NODES])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in KINDS else [pytest.mark.slow(reason="many parts")])
        for name in PARTS
        if name not in ("Rayleigh", "RayleighDamping")
    ],
)
def test_loads_of_each_part_balance_inertia(name, kind):
    assert_balanced(PARTS[name], kind)


@pytest.mark.slow(reason="half a second")
def test_rayleigh_damping_balances_inertia():
    assert_balanced(LOADS["Rayleigh"], NODES)
    # In a floating frame its strain rates are linear, so that its moments do not balance exactly.
    assert_balanced(LOADS["Rayleigh"], FRAME, off=1e-2)


@pytest.mark.parametrize("kind", [FRAME, NODES])
@pytest.mark.parametrize("nodes", [3, 5])
def test_loads_on_elements_with_a_gauss_point_at_a_node(nodes, kind):
    """Regression: loads on elements of an odd number of nodes were errors in a floating frame."""
    for name in ("AirDrag", "pressure"):
        assert_balanced(PARTS[name], kind, nodes=nodes)
