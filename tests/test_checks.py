"""Findings of `check` for sound mechanisms and for mechanisms with common mistakes."""

import re
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from conformance import integrators
from mechanisms import (
    EARTH,
    clamped_beam,
    driven,
    mass_on_rail,
    rectangle,
    symbols,
)
from numpy.testing import assert_allclose
from slider_crank import slider_crank

import beamdae as bd


def linkage(bars, lean=0.3, height=1.0, **settings):
    """Return a coupler on parallel bars; two bars determine its motion."""
    mech = bd.Mechanism(gravity=EARTH, **settings)
    middle = (0.5 * (bars - 1) + lean, height)
    coupler = mech.add(bd.RigidBody("coupler", 1.0, 0.1, center=middle))
    for k in range(bars):
        center = (k + 0.5 * lean, 0.5 * height)
        bar = mech.add(bd.RigidBody(f"bar {k}", 1.0, 0.1, center=center))
        mech.add(bd.Revolute(f"foot {k}", mech.ground.at(k, 0.0), bar.at(k, 0.0)))
        head = (k + lean, height)
        mech.add(bd.Revolute(f"head {k}", bar.at(*head), coupler.at(*head)))
    mech.observe("coupler", coupler.at(*middle))
    return mech


def doubly_welded_bar():
    mech = bd.Mechanism()
    bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, center=(0.5, 0.0)))
    mech.add(bd.Weld("left", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)))
    mech.add(bd.Weld("right", mech.ground.at(1.0, 0.0), bar.at(1.0, 0.0)))
    return mech


def slider_on_two_guides(**settings):
    """Return a slider on two parallel guides with two points each."""
    mech = bd.Mechanism(gravity=(1.0, -9.81), **settings)
    slider = mech.add(bd.RigidBody("slider", 1.0, 0.1, center=(0.5, 0.0)))
    for name, y in (("guide A", 0.2), ("guide B", -0.2)):
        for end, x in ((" left", 0.0), (" right", 1.0)):
            mech.add(bd.PointOnLine(name + end, mech.ground.at(0.0, y), slider.at(x, y)))
    return mech


def doubly_driven_crank(first=3.0, second=3.0, **settings):
    crank = bd.RigidBody("crank", 1.0, 0.1, center=(0.5, 0.0))
    mech, crank = driven(crank, lambda t: first * t, **settings)
    hub = (mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0))
    motor = mech.add(bd.Driver("second motor", *hub, law=lambda t: second * t + t**2 - t**2))
    mech.observe("second motor", motor.reaction)
    return mech


def linkage_without_a_guide():
    """Return a crank with an unguided rod, and a body without joints."""
    mech, crank = driven(bd.RigidBody("crank", 1.0, 0.1, center=(0.5, 0.0)), 0.0, 9.81)
    rod = mech.add(bd.RigidBody("rod", 1.0, 0.1, center=(2.0, 0.0)))
    mech.add(bd.RigidBody("lost", 1.0, 0.1, center=(5.0, 5.0)))
    mech.add(bd.Revolute("pin", crank.at(1.0, 0.0), rod.at(1.0, 0.0)))
    return mech


# Modeling mistakes --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mechanism", "mobility", "sentences"),
    [
        (
            linkage(3),
            1,
            [
                "foot 0, head 0, foot 1, head 1, foot 2 and head 2 all block "
                "the rotation of the coupler"
            ],
        ),
        (
            doubly_welded_bar(),
            0,
            [
                "left and right both block the translation of the bar along (1, 0)",
                "left and right both block the translation of the bar along (0, 1)",
                "left and right both block the rotation of the bar",
            ],
        ),
        (
            slider_on_two_guides(),
            1,
            [
                "guide A left and guide B left both block the rotation of the slider",
                "guide A right and guide B right both block the rotation of the slider",
            ],
        ),
        (doubly_driven_crank(), 0, ["motor and second motor both block the rotation of the crank"]),
    ],
    ids=["parallel bar", "doubly welded", "two guides", "doubly driven"],
)
def test_redundant_constraints_name_the_motion_they_block(mechanism, mobility, sentences):
    findings = bd.check(mechanism)
    assert [str(one) for one in findings.dependent] == sentences
    assert findings.mobility == mobility
    assert not findings.ok
    assert "depend on each other" in findings.problem
    assert all(part in str(findings) for one in findings.dependent for part in one.parts)


def test_missing_joint_shows_in_the_free_motions():
    findings = bd.check(linkage_without_a_guide())
    assert findings.ok
    assert findings.mobility == findings.rigid_mobility == 4
    assert findings.free_motions == (
        "rod can rotate about (1, 0)",
        "lost can translate along (1, 0)",
        "lost can translate along (0, 1)",
        "lost can rotate about (5, 5)",
    )
    assert findings.loose == (("lost",),)


@pytest.mark.parametrize(
    ("add", "is_free"),
    [
        (lambda mech, stage: bd.Force("coil", stage.at(0.0, 0.0), (1.0, 0.0)), True),
        (
            lambda mech, stage: bd.Spring(
                "damper", mech.ground.at(1, 0), stage.at(0, 0), damping=1.0
            ),
            True,
        ),
        (lambda mech, stage: bd.Spring("spring", mech.ground.at(1, 0), stage.at(0, 0), 1.0), False),
        (lambda mech, stage: bd.Weld("clamp", mech.ground.at(0, 0), stage.at(0, 0)), False),
        (
            lambda mech, stage: bd.Contact(
                "floor", stage.at(0.0, 0.0), bd.LineSurface(mech.ground.at(0.0, -1.0)), 1e3
            ),
            False,
        ),
    ],
    ids=["force", "damper", "spring", "weld", "contact"],
)
def test_regression_verdicts_name_parts_that_can_move_away(add, is_free):
    """A stage without its welds, moved by its actuator, was ready to run without a word."""
    mech = bd.Mechanism()
    strip = rectangle(1e-3)
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.0, 0.1)), strip, formulation="exact"))
    mech.add(bd.Weld("foot", mech.ground.at(0.0, 0.0), leaf.start))
    # A free body that a spring connects to the stage does not hold it.
    stage = mech.add(bd.RigidBody("stage", 1.0, 0.1))
    probe = mech.add(bd.PointMass("probe", 0.1, at=(0.0, 0.2)))
    mech.add(bd.Spring("link", stage.at(0.0, 0.1), probe.point, 10.0))
    mech.add(add(mech, stage))
    findings = bd.check(mech, predict=False)
    assert findings.ok
    assert findings.free_groups == ((("stage", "probe"),) if is_free else ())
    free = ", but no joint or spring connects stage, probe to the ground"
    assert findings.verdict == "ready to run" + free * is_free
    assert findings.verdict in str(findings)


def test_regression_verdicts_name_motions_that_grow_from_the_start():
    """The head of a column without its guide was listed as unstable, and ready to run."""
    mech = bd.Mechanism(gravity=EARTH)
    ground, head = mech.ground, mech.add(bd.PointMass("head", 2.0, at=(0.0, 1.0)))
    column = mech.add(bd.RigidBody("column", 1.0, 0.1, center=(0.0, 0.5)))
    mech.add(bd.Revolute("foot", ground.at(0.0, 0.0), column.at(0.0, 0.0)))
    mech.add(bd.Revolute("top", column.at(0.0, 1.0), head.point))
    findings = bd.check(mech, predict=False)
    rate = np.sqrt(9.81 * (0.5 + 2.0) / (0.1 + 0.25 + 2.0))
    growth = f"a motion grows from the start at a rate of {rate:.3g} 1/s"
    assert findings.verdict == f"ready to run, but {growth}"
    assert f"unstable      {growth}" in str(findings)
    mech.add(bd.PointOnLine("guide", ground.at(0.0, 1.0), head.point, direction=(0.0, 1.0)))
    assert bd.check(mech, predict=False).verdict == "ready to run"


def test_contradicting_drivers_are_named_and_rejected_with_minimum_norm():
    mech = doubly_driven_crank(3.0, 2.0, redundant="minimum norm")
    (dependent_set,) = bd.check(mech).dependent
    assert dependent_set.parts == ("motor", "second motor")
    assert_allclose(dependent_set.contradiction, (0.0, 1.0), atol=1e-12)
    assert "contradict each other" in str(dependent_set)
    with pytest.raises(bd.BeamdaeError, match="contradict each other"):
        bd.simulate(mech, t_end=0.1)


def test_singular_position_is_not_redundancy():
    """A flat parallelogram has full rank in all neighboring positions."""
    (dependent_set,) = bd.check(linkage(2, lean=1.0, height=0.0)).dependent
    assert not dependent_set.everywhere
    assert "in this singular position" in str(dependent_set)
    flat = linkage(2, lean=1.0, height=0.0, redundant="minimum norm")
    with pytest.raises(bd.BeamdaeError, match=r"none of these constraints is redundant.*singular"):
        bd.simulate(flat, t_end=0.1)


def test_free_motions_turn_about_instantaneous_centers():
    (motion,) = bd.check(linkage(2)).free_motions
    assert "bar 0 can rotate about (0, 0)" in motion
    assert "bar 1 can rotate about (1, 0)" in motion
    assert "coupler can translate along (0.958, -0.287)" in motion


def free_chain(joint):
    """Return twelve bars in a line that are joined only to each other."""
    mech = bd.Mechanism()
    bars = [
        mech.add(bd.RigidBody.rod(f"bar {k}", a=(k, 0.0), b=(k + 1.0, 0.0), mass=1.0))
        for k in range(12)
    ]
    for k, (one, other) in enumerate(pairwise(bars)):
        mech.add(joint(f"joint {k}", one.at(k + 1.0, 0.0), other.at(k + 1.0, 0.0)))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_parts_with_the_same_motion_are_grouped():
    welded = bd.check(free_chain(bd.Weld)).free_motions
    assert len(welded) == 3
    assert all(motion.startswith("the whole mechanism can ") for motion in welded)
    linked = bd.check(free_chain(bd.Revolute))
    assert len(linked.free_motions) == linked.mobility == 14
    assert "bar 0 and bar 1 can translate along (0, 1), bar 2 can rotate about (3, 0)" in str(
        linked
    )
    assert "; and 6 more" in str(linked)


@pytest.mark.slow(reason="half a second")
def test_sound_mechanism_has_no_findings():
    findings = bd.check(slider_crank)
    assert findings.ok
    assert not findings.dependent
    assert not findings.free_motions
    assert not findings.loose
    assert findings.rigid_mobility == 0
    assert findings.spectrum.highest > 1e3 * findings.spectrum.lowest > 0.0
    # A complete run takes some thousands of steps.
    assert 1e2 < findings.prediction.steps < 1e6
    for topic in ("mobility", "frequencies", "errors", "predicted cost", "verdict"):
        assert f"\n{topic}" in str(findings)


# Minimum norm ------------------------------------------------------------------------------------


@pytest.mark.slow(reason="a fifth of a second")
@integrators(1e-6, 1e-3)
def test_reactions_of_redundant_bars_are_of_minimum_norm(integrator):
    mech = linkage(3, redundant="minimum norm")
    for k in range(3):
        mech.observe(f"foot {k}", mech.part(f"foot {k}").reaction)
    solution = bd.simulate(mech, integrator, 0.1)
    assert solution.status.success
    assert "head 1.y follows from the others" in solution.integrator["redundant"]
    assert not solution.warnings
    # Three bars with the same motion: by symmetry, the outer ones carry the same load.
    assert_allclose(solution.columns["foot 0.Fy [N]"], solution.columns["foot 2.Fy [N]"], rtol=1e-6)
    # By Lagrange, it rotates like one bar with the inertia of all bars and the coupler.
    length = np.hypot(0.3, 1.0)
    inertia = 3.0 * (0.1 + 0.25 * length**2) + length**2
    alpha = -9.81 * 0.3 * (3.0 * 0.5 + 1.0) / inertia
    assert_allclose(solution.a[0, 5], alpha, rtol=1e-9)
    assert solution.quality.max_residual < 1e-4
    assert solution.drift.to_numpy().max() < 1e-3


@pytest.mark.slow(reason="a fifth of a second")
def test_two_drivers_share_their_torque():
    mech = doubly_driven_crank(redundant="minimum norm")
    mech.add(bd.Moment("brake", mech.part("crank").at(0.0, 0.0), -2.0))
    solution = bd.simulate(mech, bd.Radau(), 0.1)
    assert_allclose(solution.columns["second motor.M [N m]"], 1.0, rtol=1e-6)


def test_regression_upright_bars_are_redundant_not_singular():
    """Near the upright position the set has more constraints; it was reported as singular."""
    mech = linkage(3, lean=0.0, redundant="minimum norm")
    (dependent_set,) = bd.check(mech).dependent
    assert dependent_set.everywhere
    solution = bd.simulate(mech, bd.Radau(), 0.05, start={"bar 0.angle": 0.2})
    assert solution.status.success
    angles = [solution.equations.q_names.index(f"bar {k}.angle") for k in range(3)]
    assert_allclose(solution.q[0, angles], 0.2, atol=1e-10)


def test_minimum_norm_rejects_switched_parts():
    mech = linkage(3, redundant="minimum norm")
    mech.when("coupler.x", crosses=5.0, do=bd.deactivate(mech.part("head 2")))
    with pytest.raises(bd.BeamdaeError, match="is not supported with inactive parts"):
        bd.check(mech)


def test_redundant_joint_in_a_singular_position_is_distinguished():
    """Two welds at one point are redundant in every position of the straight chain."""
    mech, last = bd.Mechanism(), None
    for k in range(3):
        link = mech.add(bd.RigidBody(f"link {k}", 1.0, 0.1, center=(k + 0.5, 0.0)))
        before = mech.ground.at(0.0, 0.0) if last is None else last
        mech.add(bd.Revolute(f"pin {k}", before, link.at(k, 0.0)))
        last = link.at(k + 1.0, 0.0)
    mech.add(bd.Weld("first weld", mech.ground.at(3.0, 0.0), last))
    mech.add(bd.Weld("second weld", mech.ground.at(3.0, 0.0), last))
    verdicts = {one.parts: one.everywhere for one in bd.check(mech).dependent}
    assert verdicts.pop(("first weld", "second weld"))
    assert list(verdicts.values()) == [False]


def test_check_of_a_mechanism_without_joints_and_a_constrained_system():
    mech = bd.Mechanism(gravity=EARTH)
    mech.add(bd.PointMass("stone", 1.0, at=(0.0, 0.0)))
    findings = bd.check(mech, t_end=1.0)
    assert (findings.ok, findings.mobility, findings.loose) == (True, 2, (("stone",),))
    t, q, v = symbols(2)
    bob = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1, 1], force=[0, -9.81], q0=[1, 0], v0=[0, 0],
        constraints=ca.dot(q, q) - 1.0,
    )  # fmt: skip
    findings = bd.check(bob, predict=False)
    assert (findings.mobility, findings.free_motions, findings.loose) == (1, ("q1 can move",), ())
    pendulum = bd.simulate(bob, bd.Radau(), 0.1, start="equilibrium")
    assert_allclose(pendulum.q[-1], (0.0, -1.0), atol=1e-9)


def test_starts_of_checks_are_those_of_runs():
    start = {"bar 0.angle_dot": 0.5}
    findings = bd.check(linkage(2), predict=False, start=start)
    assert findings.start.request == "bar 0.angle_dot = 0.5"
    with pytest.raises(bd.BeamdaeError, match="check: start must be"):
        bd.check(linkage(2), start="equilibrum")


@pytest.mark.slow(reason="two runs of a beam")
def test_regression_meshes_are_not_compared_at_rest():
    """Rounding errors of velocities in equilibrium changed by 139 % with halved elements."""
    section = rectangle(1e-3, 0.01, damping=1e-4)
    mech, strip = clamped_beam(section, 3, 0.2, name="strip", gravity=9.81)
    stop = bd.LineSurface(mech.ground.at(0.0, -1e-4))
    mech.add(bd.Contact("tip", strip.end, stop, 1e5, exponent=1))
    mech.observe("end", strip.end)
    findings = bd.check(mech, t_end=0.05, start="equilibrium")
    assert findings.start.request == "equilibrium"
    assert not findings.warnings


def test_regression_states_and_held_values_are_no_degrees_of_freedom():
    """The mobility of a stage with a filter and a sampled controller was 4 instead of 1."""
    mech, stage = mass_on_rail(2.0, name="stage")
    force = mech.input("force")
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    x = mech.sensor("x", stage.point, "x")
    slow = mech.state("slow", lambda slow, t: (x - slow) / 0.1, unit="m")
    servo = bd.Controller("servo", 0.01, [slow], [force], lambda x: -x.reads[0], state=[0.0])
    mech.add(servo)
    findings = bd.check(mech, t_end=0.1)
    assert findings.mobility == findings.rigid_mobility == 1
    assert findings.free_motions == ("stage can translate along (1, 0)",)
    assert "1 = 5 coordinates - 3 states - 1 independent constraints" in str(findings)


@pytest.mark.slow(reason="a fifth of a second")
def test_rigid_mobility_treats_a_beam_of_nodes_as_one_body():
    arc = bd.Arc(radius=1.0, length=1.0, start=(0.2, -0.3), angle=0.4)
    for joints, mobility in (
        ([], 3),
        ([bd.Revolute], 1),
        ([bd.Revolute] * 2, 0),
        ([bd.Weld] * 2, 0),
    ):
        mech = bd.Mechanism()
        beam = mech.add(
            bd.Beam("arch", arc, rectangle(0.01, 0.03), elements=2, formulation="exact")
        )
        for k, (joint, end) in enumerate(zip(joints, (beam.start, beam.end), strict=False)):
            mech.add(joint(f"joint {k}", mech.ground.at(*end.point), end))
        findings = bd.check(mech)
        assert not findings.problem
        assert findings.rigid_mobility == mobility
        if mobility < 3:
            assert findings.free_motions == ("arch can rotate about (0.2, -0.3)",) * mobility


def test_regression_joint_of_the_ground_and_two_bodies_connects_both():
    """A planetary gear on the ground left its wheel and its carrier unconnected."""
    mech = bd.Mechanism()
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.1, (1.0, 0.0)))
    arm = mech.add(bd.RigidBody("arm", 1.0, 0.1, (0.5, 0.0)))
    mech.add(bd.Revolute("pin", arm.at(1.0, 0.0), wheel.at(1.0, 0.0)))
    assert bd.check(mech, predict=False).loose == (("wheel", "arm"),)
    sun = mech.ground.at(0.0, 0.0)
    mech.add(bd.Gear("gear", sun, wheel.at(1.0, 0.0), 0.5, carrier=arm.at(0.0, 0.0)))
    assert bd.check(mech, predict=False).loose == ()


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_sections_higher_than_their_beams_are_long_cause_a_warning():
    """Only `check` warned, not the run."""

    def warnings_of(height, bodies=1):
        mech = bd.Mechanism()
        section = rectangle(height)
        line = bd.Line((0.0, 0.0), (0.3, 0.0))
        beams = bd.welded_beams(mech, "strip", line, section, bodies=bodies, elements=1)
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beams[0].start))
        checked = bd.check(mech, predict=False).warnings
        solution = bd.simulate(mech, t_end=1e-6)
        assert solution.status.kind
        return [[x for x in y if "high" in x] for y in (checked, solution.warnings)]

    sentence = (
        ": the section is 2 m high, but the beam is only 0.3 m long; exchange width and height, "
        "give sizes in meters, or model the part as a rigid body."
    )
    with pytest.warns(bd.BeamdaeWarning, match=sentence):
        of_check, of_run = warnings_of(2.0)
    assert len(of_check) == 1
    assert of_check == of_run
    with pytest.warns(bd.BeamdaeWarning):
        assert all(warnings_of(0.31))
    assert warnings_of(0.29) == [[], []]
    assert warnings_of(0.2, bodies=2) == [[], []]


@pytest.mark.parametrize(
    ("height", "length", "joined"),
    # A short beam may be a piece of a longer bar.
    [(0.02, 0.01, False), (0.02, 0.01, True), (0.05, 0.04, True)],
)
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_flexures_with_width_and_height_exchanged_have_a_warning(height, length, joined):
    """Sections up to three times as high as their beams are long had none in any analysis."""
    section = rectangle(height, 3e-4)
    mech, flexure = clamped_beam(section, 1, length, name="flexure")
    if joined:
        line = bd.Line((length, 0.0), (1.0, 0.0))
        other = mech.add(bd.Beam("bar", line, section, elements=1))
        mech.add(bd.Weld("weld", flexure.end, other.start))
    assert any("m high" in x for x in bd.linearize(mech).warnings) != joined


@pytest.mark.slow(reason="a fifth of a second")
def test_dampings_that_seem_to_be_damping_ratios_cause_a_warning():
    steel, plastic = bd.Material.of("steel"), bd.Material(E=2.4e9, nu=0.35, rho=1240.0)

    def strip(damping, material=steel, length=0.5):
        section = rectangle(0.004, damping=damping, material=material)
        mech, _ = clamped_beam(section, 2, length, name="strip")
        return mech

    with pytest.warns(bd.BeamdaeWarning, match=r"strip: .* 0\.01 s .*\(13\.4 Hz\).* 0\.42\. For"):
        mode = bd.modes(strip(0.01), n=1).table().iloc[0]
    frequency, ratio = mode["frequency [Hz]"], mode["damping ratio [-]"]
    # The stated ratio is that of the computed mode up to its lower, damped frequency.
    assert_allclose((frequency, ratio), (13.4 * np.sqrt(1.0 - 0.42**2), 0.42), rtol=5e-3)

    def warns(model):
        return any("damping ratio" in x for x in bd.check(model, predict=False).warnings)

    assert warns(strip(0.01))
    # The damping ratio 0.02 of a strip with a tip mass at 6.0857 Hz.
    usual = [
        strip(1.0461e-3, length=0.1),
        strip(1e-3),
        strip(1e-4, length=0.05),
        strip(0.01, plastic),
        strip(0.01, length=5.0),
    ]
    assert not any(warns(model) for model in usual)


def bounce(elements, observes=True):
    """A strip that falls on two stops with oblique surfaces."""
    mech = bd.Mechanism(gravity=EARTH)
    strip = rectangle(0.004, damping=1e-6)
    curve = bd.Line((-0.15, 0.001), (0.15, 0.002))
    beam = mech.add(bd.Beam("strip", curve, strip, elements=elements))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    for name, end in (("left", beam.start), ("right", beam.end)):
        mech.add(bd.Contact(name, end, floor, stiffness=1e6))
    if observes:
        mech.observe("acceleration", bd.acceleration(beam.at(0.05)))
    return mech


@pytest.mark.slow(reason="five runs with contacts")
def test_regression_mesh_errors_of_impacts_are_measured():
    """The mesh was good, and the acceleration 16 % off."""
    coarse, fine = (bd.check(bounce(n), t_end=0.02) for n in (1, 4))
    column = "acceleration.ay [m/s^2]"
    errors = [x.errors.table()["total"][column] for x in (coarse, fine)]
    assert errors[0] > 0.1 > 5.0 * errors[1]
    assert any(re.search(r"acceleration\.ay \d+ %", x) for x in coarse.warnings)
    assert f"({column})" in str(fine)
    assert bd.check(bounce(1, False), t_end=0.02).errors is None


@pytest.mark.slow(reason="two runs with a slider")
def test_regression_mesh_errors_of_sliding_points_have_a_warning():
    """The force of a bead on an arch of 4 elements was 23 % off without a word."""
    mech = bd.Mechanism(gravity=EARTH)
    section = rectangle(0.006, damping=2e-4)
    curve = bd.Parabola(span=1.0, rise=0.2, start=(0.0, 0.0))
    arch = mech.add(bd.Beam("arch", curve, section, elements=4))
    for k, end in enumerate((arch.start, arch.end)):
        mech.add(bd.Weld(f"clamp {k}", mech.ground.at(*end.point), end))
    bead = mech.add(bd.PointMass("bead", 2.0, at=arch.at(0.7).point))
    ring = mech.add(bd.SlidingOnBeam("ring", bead.point, arch))
    mech.observe("ring", ring.reaction)
    report = bd.check(mech, t_end=0.1)
    assert any(x.startswith("ring.F") and "the error is" in x for x in report.warnings)
    # The verdict was "ready to run".
    assert re.match(r"ready to run, but \d+ warnings? about its results", report.verdict)
    assert report.verdict in str(report)
