"""Section forces that balance what acts on a beam, against closed forms and reactions."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hub_beam import hub_beam

import beamdae as bd
from beamdae.equations.consistent_start import Starter
from beamdae.equations.formulations import State
from beamdae.equations.given_start import started
from beamdae.results.section_forces import of_state

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=235e6)
BAR = bd.Section.rectangle(STEEL, width=0.02, height=0.01)
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))
# Loads as small that what bends leaves the closed forms of the undeformed beam as they are.
SMALL = 1e-5


def held(curve=LINE, elements=1, section=BAR, gravity=(0.0, 0.0), **settings):
    """A cantilever."""
    mech = bd.Mechanism(gravity=gravity)
    beam = mech.add(bd.Beam("beam", curve, section, elements=elements, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(*beam.start.point), beam.start))
    return mech, beam


def supported(elements):
    """A beam on a hinge and a roller."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", LINE, BAR, elements=elements))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    roller = mech.ground.at(1.0, 0.0)
    mech.add(bd.PointOnLine("roller", roller, beam.end, (1.0, 0.0)))
    return mech, beam


def at_rest(mech, beam, s=None, t=0.0):
    """Section forces in the equilibrium under the loads at a time."""
    e = started(bd.equations_of_motion(mech), "equilibrium", t)
    time = np.array([t, t])
    a, lam = Starter(e).acceleration(time, e.q0, e.v0)
    state = State(e.q0[None], e.v0[None], a[None], lam[None])
    return of_state(e, beam, t, state, s)


def assert_are(forces, N, Q, M, size=SMALL, off=3e-8):
    """To what the deflection, 1e-8 of the length, makes of them, relative to the load."""
    for found, expected in zip((forces.N, forces.Q, forces.M), (N, Q, M), strict=True):
        np.testing.assert_allclose(found[0], expected + 0.0 * forces.s, rtol=0.0, atol=off * size)


S = np.array([0.0, 0.21, 0.5, 0.8, 1.0])


@pytest.mark.parametrize("elements", [1, 3])
def test_a_cantilever_under_end_loads(elements):
    mech, beam = held(elements=elements)
    mech.add(bd.Force("load", beam.end, (3.0 * SMALL, -SMALL)))
    mech.add(bd.Moment("moment", beam.end, 0.5 * SMALL))
    # M lengthens the left side, here the upper one: what pushes down does.
    assert_are(at_rest(mech, beam, S), 3.0 * SMALL, -SMALL, SMALL * (1.0 - S) - 0.5 * SMALL)


def test_loads_along_a_single_element_and_inside_it():
    mech, beam = held()
    mech.add(bd.DistributedForce("line", beam, lambda s, x, y, t: (0.0, -SMALL * s)))
    mech.add(bd.Force("load", beam.at(0.37), (0.0, -SMALL)))
    forces = at_rest(mech, beam)
    s = forces.s
    # The place of the force comes twice, and section forces jump there.
    (twice,) = np.flatnonzero(np.diff(s) == 0.0)
    assert s[twice] == pytest.approx(0.37)
    assert forces.Q[0, twice + 1] - forces.Q[0, twice] == pytest.approx(SMALL)
    near = np.arange(len(s)) <= twice
    Q = -SMALL * (near + 0.5 * (1.0 - s**2))
    M = SMALL * (near * (0.37 - s) + 1.0 / 3.0 - 0.5 * s + s**3 / 6.0)
    assert_are(forces, 0.0, Q, M)
    # The strains of one cubic element are far off, and the estimate says so.
    off = np.max(np.abs(forces.strained[2] - M))
    assert off > 0.05 * SMALL
    assert np.max(forces.error[2]) == pytest.approx(off, rel=1e-6)


def test_weight_is_a_load_as_numbers_and_as_laws():
    mech, beam = held(gravity=(0.0, -9.81))
    weight = BAR.rhoA * 9.81
    found = at_rest(mech, beam, S)
    # Its slope of up to 7e-3 turns forces by as much.
    assert_are(found, 0.0, -weight * (1.0 - S), 0.5 * weight * (1.0 - S) ** 2, weight, 4e-3)
    lawful, beam = held(gravity=(0.0, lambda t: -9.81 + 0.0 * t))
    again = at_rest(lawful, beam, S)
    np.testing.assert_allclose(again.M, found.M, rtol=1e-9, atol=1e-9)


def test_an_arc_under_an_end_force():
    # Quarter of a circle about the origin from (R, 0) to (0, R), force P outward at its end.
    R = 0.5
    arc = bd.Arc(radius=R, length=0.5 * np.pi * R, start=(R, 0.0), angle=0.5 * np.pi)
    mech, beam = held(arc, elements=3)
    mech.add(bd.Force("load", beam.end, (0.0, SMALL)))
    s = np.linspace(0.0, arc.length, 7)
    angle = s / R
    # Tangent (-sin, cos), left normal (-cos, -sin): N = P cos, Q = -P sin; the force turns the part
    # beyond a section counter-clockwise about it by its lever R cos to the left.
    assert_are(
        at_rest(mech, beam, s),
        SMALL * np.cos(angle),
        -SMALL * np.sin(angle),
        SMALL * R * np.cos(angle),
        # Three elements miss the arc by 1e-6 of its radius.
        off=2e-6,
    )


def test_centrifugal_force_of_a_rotating_beam():
    speed, section = 40.0, replace(BAR, damping=2e-3)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", LINE, section, elements=2, angular_velocity=speed))
    axle = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("axle", axle, beam.start))
    mech.add(bd.Driver("drive", axle, beam.start, lambda t: speed * t))
    solution = bd.simulate(mech, bd.Radau(1e-6), t_end=0.1, output_step=0.1)
    forces = solution.section_forces(beam, t=0.1, s=S)
    most = 0.5 * section.rhoA * speed**2
    # It is longer by 2e-5 of itself, which adds four times as much.
    np.testing.assert_allclose(forces.N[0], most * (1.0 - S**2), rtol=0.0, atol=1e-4 * most)
    # Two elements have a parabola of strains at three points each.
    np.testing.assert_allclose(forces.strained[0], forces.N, rtol=0.0, atol=1e-4 * most)


@pytest.mark.parametrize("place", [0.13, 0.5, 0.8])
def test_a_moving_load_bends_most_where_it_is(place):
    mech, beam = supported(elements=2)
    mech.add(bd.MovingForce("load", beam, (0.0, -SMALL), speed=1.0))
    forces = at_rest(mech, beam, t=place)
    s = forces.s
    M = -SMALL * np.where(s <= place, s * (1.0 - place), place * (1.0 - s))
    np.testing.assert_allclose(forces.M[0], M, rtol=0.0, atol=3e-8 * SMALL)
    assert forces.s[np.argmin(forces.M[0])] == pytest.approx(place)


def test_a_slider_presses_between_nodes():
    mech, beam = supported(elements=3)
    block = mech.add(bd.RigidBody("block", 1.0, 1.0, center=(0.4, 0.0)))
    mech.add(bd.Force("load", block.at(0.4, 0.0), (0.0, -SMALL)))
    mech.add(bd.SlidingOnBeam("slide", block.at(0.4, 0.0), beam))
    post = mech.ground.at(0.4, 0.0)
    mech.add(bd.PointOnLine("guide", post, block.at(0.4, 0.0), (0.0, 1.0)))
    mech.add(bd.Driver("upright", post, block.at(0.4, 0.0), 0.0))
    forces = at_rest(mech, beam)
    M = -SMALL * np.where(forces.s <= 0.4, forces.s * 0.6, 0.4 * (1.0 - forces.s))
    np.testing.assert_allclose(forces.M[0], M, rtol=0.0, atol=1e-7 * SMALL)


@pytest.fixture(scope="module")
def swinging():
    """A damped, dragged arc with a tip mass, on a hinge, in motion."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    arc = bd.Arc(radius=0.85, length=0.8, angle=-0.6)
    strip = bd.Section.rectangle(STEEL, width=0.03, height=0.0025, damping=1e-4)
    beam = mech.add(bd.Beam("beam", arc, strip, elements=3))
    mech.add(bd.PointMass("tip mass", 0.06, on=beam.end))
    mech.add(bd.AirDrag("drag", beam, 0.5))
    mech.add(bd.RayleighDamping("oil", beam, mass=0.2, stiffness=1e-5))
    mech.add(bd.Spring("stay", mech.ground.at(0.0, -1.0), beam.at(0.3), stiffness=20.0))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("hinge", hinge.reaction_on("b"))
    mech.observe("root", beam.start)
    mech.observe("tip", beam.end)
    mech.observe("inside", beam.section_forces(0.5))
    return bd.simulate(mech, bd.Radau(1e-6), t_end=0.2, output_step=0.01)


def test_at_its_ends_they_balance_reactions_and_masses(swinging):
    forces = swinging.section_forces("beam", s=[0.0, 0.8])
    columns, tip = swinging.columns, np.s_[1:-1]
    n = {}
    beam = forces.beam
    for k, (place, at) in enumerate({"root": beam.start, "tip": beam.end}.items()):
        # Observed is the angle of the element, the section stands across the curve.
        across = beam.curve.tangent_angle(forces.s[k]) - at.inclination
        angle = columns[f"{place}.angle [rad]"] + across
        c, w = np.cos(angle), np.sin(angle)
        N, Q = forces.N[:, k], forces.Q[:, k]
        n[place] = np.stack([c * N - w * Q, w * N + c * Q])
    size = np.max(np.abs(n["root"]))
    # The reaction on the beam is what the part before its start exerts on it.
    reaction = np.stack([columns[f"hinge.{x} [N]"] for x in ("Fx", "Fy")])
    np.testing.assert_allclose(n["root"], -reaction, rtol=0.0, atol=1e-9 * size)
    np.testing.assert_allclose(forces.M, 0.0, atol=1e-9 * size)
    # What moves the tip mass, by central differences of its velocity over 20 ms.
    moved = np.stack([np.gradient(columns[f"tip.{x}_dot [m/s]"], 0.01) for x in "xy"])
    weighed = 0.06 * (moved + np.array([[0.0], [9.81]]))
    np.testing.assert_allclose(n["tip"][:, tip], -weighed[:, tip], rtol=0.0, atol=0.05 * size)


def test_between_they_agree_with_the_strains(swinging):
    forces = swinging.section_forces("beam", s=0.5)
    for k, name in enumerate(("N [N]", "Q [N]", "M [N m]")):
        observed = swinging.columns[f"inside.{name}"]
        np.testing.assert_allclose(forces.strained[k, :, 0], observed, rtol=1e-9, atol=1e-9)
        found = (forces.N, forces.Q, forces.M)[k][:, 0]
        size = np.max(np.abs(found))
        # Three elements, and a spring inside one of them.
        np.testing.assert_allclose(found, observed, rtol=0.0, atol=0.1 * size)


def test_parts_that_are_inactive_do_not_act():
    mech, beam = held()
    load = mech.add(bd.Force("load", beam.end, (0.0, -SMALL)))
    mech.deactivate(load)
    solution = bd.simulate(mech, bd.GeneralizedAlpha(1e-3), t_end=2e-3)
    assert np.max(np.abs(solution.section_forces(beam).M)) < 1e-9 * SMALL


def test_drawings_may_be_moved_turned_and_run_the_other_way():
    arc = bd.Arc(radius=0.7, length=0.9)
    there = bd.Arc(radius=0.7, length=0.9, start=(3.0, -5.0), angle=2.0)
    found = []
    for curve, turn in ((arc, 0.0), (there, 2.0)):
        mech, beam = held(curve, elements=2)
        force = (-np.sin(turn), np.cos(turn))
        mech.add(bd.Force("load", beam.end, tuple(100.0 * x for x in force)))
        found.append(at_rest(mech, beam))
    for name in "NQM":
        one, other = (getattr(x, name) for x in found)
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-8 * 100.0)


def test_tables_envelopes_and_safety(swinging):
    forces = swinging.section_forces("beam")
    table = forces.table()
    assert list(table)[:5] == ["t [s]", "s [m]", "N [N]", "Q [N]", "M [N m]"]
    assert list(table)[5:] == ["N error [N]", "Q error [N]", "M error [N m]"]
    assert len(table) == len(forces.t) * len(forces.s)
    envelope = forces.envelope()
    most = envelope.loc[envelope["M max [N m]"].idxmax()]
    row = table[(table["t [s]"] == most["t of M max [s]"]) & (table["s [m]"] == most["s [m]"])]
    assert row["M [N m]"].max() == most["M max [N m]"] == forces.M.max()
    stress = forces.stress("top")
    A, W = 0.03 * 0.0025, 0.03 * 0.0025**2 / 6.0
    sigma = table["N [N]"] / A + table["M [N m]"] / W
    pd.testing.assert_series_equal(stress["sigma [Pa]"], sigma, check_names=False)
    np.testing.assert_allclose(stress["tau [Pa]"], 1.5 * table["Q [N]"] / A)
    safety = forces.safety()
    largest = max(np.abs(forces.stress(x)["sigma [Pa]"]).max() for x in ("top", "bottom"))
    assert safety.stress == pytest.approx(largest)
    assert safety.factor == pytest.approx(235e6 / largest)
    assert forces.safety(yield_stress=2.0 * 235e6).factor == pytest.approx(2.0 * safety.factor)


def test_shear_peaks_of_shapes():
    # A thin pipe has twice the mean, a thick one that of a solid circle; a web bears nearly all.
    assert bd.Section.pipe(STEEL, 0.1, 1e-5).shear_peak == pytest.approx(2.0, rel=1e-3)
    assert bd.Section.pipe(STEEL, 0.1, 0.0499).shear_peak == pytest.approx(4.0 / 3.0, rel=3e-3)
    solid = bd.Section.i_profile(STEEL, width=0.02, height=0.1, flange=0.02, web=0.0199999)
    assert solid.shear_peak == pytest.approx(1.5, rel=1e-4)


def test_a_diagram_is_a_picture(swinging, tmp_path):
    plot = swinging.diagram("beam", "M", t=0.1)
    assert plot.save(tmp_path / "M.png").stat().st_size > 5000
    (axes,) = plot.figure.axes
    assert axes.get_ylabel() == "M [N m]"
    # The whole run: largest and least.
    envelope = swinging.diagram("beam", "Q")
    assert "0 to 0.2 s" in envelope.figure.axes[0].get_title()


@pytest.mark.parametrize(
    ("ask", "why"),
    [
        (lambda x: x.section_forces("rod"), "beam must be one of .*'beam', got 'rod'"),
        (lambda x: x.section_forces("hinge"), "beam must be one of"),
        (lambda x: x.section_forces("beam", t=0.3), "t must be times of the run"),
        (lambda x: x.section_forces("beam", t=[0.1, 0.1]), "t must be times of the run"),
        (lambda x: x.section_forces("beam", t=[]), "t must be a number or a list"),
        (lambda x: x.section_forces("beam", s=0.9), r"s must lie in \[0, 0.8\] m"),
        (lambda x: x.section_forces("beam", s="end"), "s must be a number"),
        (lambda x: x.diagram("beam", "P"), "what must be one of 'N', 'Q', 'M'"),
        (lambda x: x.section_forces("beam").diagram("M", t=7.0), "t must be one of the times"),
        (lambda x: x.section_forces("beam").safety(-1.0), "yield_stress must be positive"),
        (lambda x: x.section_forces("beam").stress(1.0), "offset must lie within half the height"),
    ],
)
def test_what_is_asked_wrongly_is_refused(swinging, ask, why):
    with pytest.raises(bd.BeamdaeError, match=why):
        ask(swinging)


def test_safety_needs_a_yield_stress():
    mech, beam = held(section=bd.Section.rectangle(replace(STEEL, yield_stress=None), 0.02, 0.01))
    mech.add(bd.Force("load", beam.end, (0.0, -1.0)))
    with pytest.raises(bd.BeamdaeError, match="its material has no yield_stress"):
        at_rest(mech, beam).safety()


@pytest.mark.slow(reason="runs the hub beam on five meshes")
def test_orders_and_the_estimate_on_the_hub_beam():
    settings = {"strain": "green", "frame": "chord", "damping": 1e-3}
    times, length = np.linspace(0.1, 2.0, 20), hub_beam.parameters["length"]

    def forces(elements):
        model = hub_beam(elements=elements, **settings)
        run = bd.simulate(model, bd.Radau(1e-9), t_end=2.0, output_step=0.1)
        found = run.section_forces("beam", t=times, s=np.linspace(0.0, length, 49))
        return found.M, found.strained[2], found.error[2]

    finest, _, _ = forces(24)
    size = np.max(np.abs(finest))
    balanced, strained, estimates = [], [], []
    for elements in (2, 4, 8):
        M, of_strains, error = forces(elements)
        balanced.append(np.max(np.abs(M - finest)) / size)
        strained.append(np.max(np.abs(of_strains - finest)) / size)
        estimates.append(np.max(error) / size)
    # Measured: 1.9e-3, 4.0e-5, 7.2e-7 and 1.3e-2, 1.6e-3, 2.0e-4.
    assert np.all(np.log2(np.array(balanced[:-1]) / balanced[1:]) > 5.0)
    assert np.all(np.log2(np.array(strained[:-1]) / strained[1:]) > 2.7)
    # Effectivity of the estimate for the strains: 0.970, 0.994, 0.999.
    np.testing.assert_allclose(np.array(estimates) / strained, 1.0, atol=0.05)
