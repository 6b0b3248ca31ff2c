"""Warnings about columns of runs with few elements, which are repeated with halved ones."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae import verification
from beamdae.results.diagnostics.meshes import refined_runs
from beamdae.results.diagnostics.meshes.coarse_elements import doubt_few_elements
from beamdae.results.run_checks import BEAMS, STEPS, skip_error_estimates

# A filter that matches no message, so that runs are checked although all warnings are ignored.
pytestmark = pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")

STEEL = bd.Material.of("steel")


def strip_of(height, damping=1e-3):
    return bd.Section.rectangle(STEEL, width=0.02, height=height, damping=damping)


def find_sentences(run):
    return [x for x in run.warnings if "with halved elements" in x]


def stated_difference(sentence, name):
    """Return the stated error of a column [-]."""
    match = re.search(rf"\b{re.escape(name)} (?:differs by )?(?:up to )?(\S+) %", sentence)
    assert match is not None
    return float(match[1]) / 100.0


def largest_difference(one, other, name):
    return np.max(np.abs(one[name] - other[name])) / np.ptp(other[name])


def rotor(elements, observed="deflection", speed=120.0):
    """Return a blade of 0.5 m whose speed rises within a second."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    hub = mech.add(bd.RigidBody("hub", mass=2.0, inertia=0.01, center=(0.0, 0.0)))
    bearing = mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)
    mech.add(bd.Revolute("bearing", *bearing))
    line = bd.Line((0.1, 0.0), (0.6, 0.0))
    blade = mech.add(bd.Beam("blade", line, strip_of(3e-3), elements))
    mech.add(bd.Weld("root", hub.at(0.1, 0.0), blade.start))
    mech.add(bd.Driver("motor", *bearing, law=bd.run_up(speed, 1.0)))
    mech.observe("tip", blade.deflection(0.5) if observed == "deflection" else blade.end)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_regression_deflections_of_blades_are_compared():
    """The deflection of the tip was off by 1.6 % without a warning."""
    coarse, fine = (bd.simulate(rotor(n), t_end=1.2) for n in (1, 8))
    (sentence,) = find_sentences(coarse)
    error = largest_difference(coarse, fine, "tip.transverse")
    assert error > 0.015
    assert stated_difference(sentence, "tip.transverse") == pytest.approx(error, rel=0.1)
    # An instant is not compared: the lowest natural frequency changes by more.
    assert "frequency" not in sentence
    assert not find_sentences(bd.simulate(rotor(1, "end"), t_end=1.2))


@pytest.mark.slow(reason="half a second and more")
def test_regression_parasitic_motions_of_flexures_are_compared():
    """The pitch of a platform, a thousandth of its travel, was off by 60 % without a warning."""

    def stage(elements):
        mech = bd.Mechanism()
        platform = mech.add(bd.RigidBody("platform", mass=0.5, inertia=1e-3, center=(0.03, 0.1)))
        for name, x, height in (("left", 0.0, 0.4e-3), ("right", 0.06, 0.45e-3)):
            line = bd.Line((x, 0.0), (x, 0.1))
            leaf = bd.Beam(name, line, strip_of(height), elements, formulation="exact")
            mech.add(leaf)
            mech.add(bd.Weld(f"{name} foot", mech.ground.at(x, 0.0), leaf.start))
            mech.add(bd.Weld(f"{name} head", platform.at(x, 0.1), leaf.end))
        push = bd.table([0.0, 0.5, 1.0], [0.0, 5.0, 5.0], "pchip")
        mech.add(bd.Force("push", platform.at(0.03, 0.1), (push, 0.0)))
        mech.observe("platform", platform.at(0.03, 0.1))
        return mech

    coarse, fine = (bd.simulate(stage(n), t_end=1.0) for n in (1, 8))
    (sentence,) = find_sentences(coarse)
    assert sentence.startswith("left (also right): 1 element is too few: with halved elements, ")
    assert sentence.endswith("use at least four times the elements.")
    ranges = [np.ptp(x["platform.angle"]) for x in (coarse, fine)]
    assert max(ranges) < 0.02 * np.ptp(coarse["platform.x"]) / 0.1
    difference = np.max(np.abs(coarse["platform.angle"] - fine["platform.angle"]))
    stated = stated_difference(sentence, "platform.angle")
    assert stated == pytest.approx(difference / max(ranges), rel=0.1)
    assert stated > 0.5
    assert not find_sentences(fine)


GAP, LEAF, LEAF_HEIGHT = 0.07, 0.07, 0.3e-3


def parallel_stage(elements, force=(0.6, 0.0)):
    """Return a platform on two equal leaves that is pushed, and the middle of a leaf."""
    mech = bd.Mechanism()
    platform = mech.add(bd.RigidBody.plate("platform", (0.0, LEAF + 0.01), 0.09, 0.02, mass=0.4))
    for name, x in (("left", -0.5 * GAP), ("right", 0.5 * GAP)):
        line = bd.Line((x, 0.0), (x, LEAF))
        section = strip_of(LEAF_HEIGHT, damping=1e-5)
        leaf = mech.add(bd.Beam(name, line, section, elements, formulation="exact"))
        mech.add(bd.Weld(f"{name} foot", mech.ground.at(x, 0.0), leaf.start))
        mech.add(bd.Weld(f"{name} head", platform.at(x, LEAF), leaf.end))
        mech.observe(f"{name} middle", leaf.at(0.5 * LEAF))
        mech.observe(f"{name} force", leaf.section_forces(0.5 * LEAF))
    rise = bd.table([0.0, 0.4, 0.5], [0.0, 1.0, 1.0], "pchip")
    force = tuple(lambda t, x=x: x * rise(t) for x in force)
    mech.add(bd.Force("push", platform.at(0.0, LEAF + 0.01), force))
    mech.observe("platform", platform.at(0.0, LEAF + 0.01))
    return mech


@pytest.mark.slow(reason="half a second")
def test_regression_small_parasitic_rotations_beside_large_angles_are_compared():
    """An angle of 3e-5 of that in the middle of the leaves was off by 16 % without a warning.

    The leaf under the compression is shorter by N L / EA + d^2 N L / (700 EI) (Awtar, Slocum and
    Sevincer 2007).
    """
    run = bd.simulate(parallel_stage(1), t_end=0.5)
    section = strip_of(LEAF_HEIGHT)
    farthest = run.observed.loc[run["platform.x"].idxmax()]
    change = abs(farthest["left force.N [N]"] - farthest["right force.N [N]"])
    stiffness = 1.0 / section.EA + farthest["platform.x [m]"] ** 2 / (700.0 * section.EI)
    exact = change * LEAF * stiffness / GAP
    angle = abs(farthest["platform.angle [rad]"])
    assert angle < 1e-4 * np.ptp(run["left middle.angle"])
    assert angle < 0.95 * exact
    (sentence,) = find_sentences(run)
    stated = stated_difference(sentence, "platform.angle")
    assert stated == pytest.approx(1.0 - angle / exact, rel=0.2)
    # The angular velocity is compared, too.
    assert stated_difference(sentence, "platform.angle_dot") > 0.04
    assert not find_sentences(bd.simulate(parallel_stage(4), t_end=0.5))


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("elements", [1, 2])
def test_rotations_that_vanish_by_symmetry_are_not_compared(elements):
    run = bd.simulate(parallel_stage(elements, (0.0, 5.0)), t_end=0.5)
    assert np.ptp(run["platform.angle"]) < 1e-12
    assert not find_sentences(run)


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("error", [1.0, 0.0])
def test_small_changes_within_the_error_of_the_steps_are_not_stated(monkeypatch, error):
    """An estimated error of zero is that of a column that varies by errors only."""
    estimate = verification.estimate_errors

    def change_errors(run):
        columns = estimate(run)
        ratios = np.full(len(run.columns), error)
        return columns | {verification.RELATIVE_ERROR: ratios}

    monkeypatch.setattr(verification, "estimate_errors", change_errors)
    run = bd.simulate(parallel_stage(1), t_end=0.5)
    assert not [x for x in find_sentences(run) if "platform.angle" in x]


def press_rod(elements, length=0.25, share=0.76):
    """Return a hinged rod under a load and a compression, relative to its Euler load, and both.

    A flywheel is accelerated by 400 N m.
    """
    section = strip_of(4e-3, damping=1e-4)
    thrust, load = share * np.pi**2 * section.EI / length**2, 10.0
    rise = bd.table([0.0, 0.2, 0.25], [0.0, 1.0, 1.0], "pchip")
    mech = bd.Mechanism()
    rod = mech.add(bd.Beam("rod", bd.Line((0.0, 0.0), (length, 0.0)), section, elements))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), rod.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), rod.end))
    mech.add(bd.Force("thrust", rod.end, (lambda t: -thrust * rise(t), 0.0)))
    mech.add(bd.DistributedForce("load", rod, (0.0, lambda t: load * rise(t))))
    wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=1.0, center=(0.0, 1.0)))
    bearing = mech.ground.at(0.0, 1.0), wheel.at(0.0, 1.0)
    mech.add(bd.Revolute("bearing", *bearing))
    motor = mech.add(bd.Driver("motor", *bearing, law=bd.run_up(50.0, 0.25)))
    mech.observe("motor", motor.drive)
    mech.observe("middle", rod.section_forces(0.5 * length))
    half = 0.5 * length * np.sqrt(thrust / section.EI)
    return mech, load * section.EI / thrust * (1.0 / np.cos(half) - 1.0)


@pytest.mark.slow(reason="half a second")
def test_regression_moments_of_rods_beside_those_of_motors_are_compared():
    """Near buckling, the moment was off by 2 %, 2e-5 of the torque, without a warning."""
    mech, exact = press_rod(2)
    run = bd.simulate(mech, t_end=0.25)
    moment = abs(run["middle.M"].iloc[-1])
    assert moment < 2e-3 * np.max(np.abs(run["motor.M"]))
    (sentence,) = find_sentences(run)
    assert stated_difference(sentence, "middle.M") == pytest.approx(moment / exact - 1.0, abs=5e-3)
    mech, exact = press_rod(4)
    run = bd.simulate(mech, t_end=0.25)
    assert abs(run["middle.M"].iloc[-1]) == pytest.approx(exact, rel=5e-3)
    assert not run.warnings


def plucked_strip(elements, periods=12):
    """Return a cantilever that is released and vibrates, and the time of these periods [s]."""
    section, length = strip_of(2e-3, damping=1e-6), 0.4
    period = 2.0 * np.pi * length**2 / 1.875**2 * (section.rhoA / section.EI) ** 0.5
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (length, 0.0))
    strip = mech.add(bd.Beam("strip", line, section, elements))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    pull = bd.table(period * np.array([0.0, 2.0, 2.05]), [0.0, 0.3, 0.0], "pchip")
    mech.add(bd.Force("pull", strip.end, (0.0, pull)))
    mech.observe("tip", strip.end)
    return mech, (2.0 + periods) * period


@pytest.mark.slow(reason="half a second and more")
def test_regression_phase_errors_are_not_exaggerated():
    """Of the angle, whose difference is a few percent, 20 % of half the range were stated."""
    coarse, fine = (bd.simulate(mech, t_end=end) for mech, end in map(plucked_strip, (1, 8)))
    (sentence,) = find_sentences(coarse)
    error = largest_difference(coarse, fine, "tip.angle")
    assert 0.02 < error < 0.1
    assert stated_difference(sentence, "tip.angle") == pytest.approx(error, rel=0.2)
    assert re.search(r"by over 1 % from t = \S+ s on, and its range by ", sentence)
    assert not [x for x in coarse.warnings if "too long for its vibration" in x]


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("reason", ["long", "failed", "estimate"])
def test_runs_that_are_not_repeated_have_estimates(monkeypatch, reason):
    if reason == "long":
        monkeypatch.setattr(refined_runs, "_MAX_WORK", 100)
    if reason == "failed":
        monkeypatch.setattr(verification, "run_again", lambda *_: None)
    mech, end = plucked_strip(1)
    with skip_error_estimates(BEAMS if reason == "estimate" else STEPS):
        run = bd.simulate(mech, t_end=end)
    assert not find_sentences(run)
    assert [x for x in run.warnings if "too long for its vibration" in x]


@pytest.mark.slow(reason="a quarter of a second")
def test_runs_with_sampled_controllers_are_repeated():
    """Laws of controllers have no memory outside their state."""

    def stage(elements):
        mech = bd.Mechanism()
        line = bd.Line((0.0, 0.0), (0.3, 0.0))
        section = bd.taper(
            bd.Section.rectangle, STEEL, width=0.02, height=(3e-3, 1e-3), damping=1e-3
        )
        arm = mech.add(bd.Beam("arm", line, section, elements))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), arm.start))
        push = mech.input("push", unit="N")
        mech.add(bd.Force("coil", arm.end, (0.0, push)))
        height = mech.sensor("height", arm.end, "y")
        mech.add(bd.Controller("servo", 5e-3, [height], [push], lambda x: 2.0 - 20.0 * x.reads[0]))
        mech.observe("tip", arm.end)
        return mech

    coarse, fine = (bd.simulate(stage(n), t_end=0.5) for n in (1, 8))
    (sentence,) = find_sentences(coarse)
    error = largest_difference(coarse, fine, "tip.x")
    assert error > 0.015
    assert stated_difference(sentence, "tip.x") == pytest.approx(error, rel=0.2)


@pytest.mark.slow(reason="half a second")
def test_runs_of_enough_elements_are_not_repeated(monkeypatch):
    runs = []
    run_again = verification.run_again
    monkeypatch.setattr(verification, "run_again", lambda *x: runs.append(x) or run_again(*x))
    for elements, count in ((3, 0), (2, 1)):
        mech, end = plucked_strip(elements, periods=1)
        bd.simulate(mech, t_end=end)
        assert len(runs) == count


@pytest.mark.slow(reason="a third of a second")
def test_regression_rounding_errors_beside_compared_columns_have_no_estimates():
    """The height of the guided end, 1e-24 m, was wrong by 100 %."""
    mech = bd.Mechanism()
    section = strip_of(2e-3, damping=1e-4)
    rod = mech.add(bd.Beam("rod", bd.Line((0.0, 0.0), (0.5, 0.0)), section, 2))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), rod.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), rod.end))
    mech.add(bd.DistributedForce("load", rod, (0.0, bd.sine(0.5, 25.0))))
    mech.observe("middle", rod.at(0.25))
    mech.observe("end", rod.end)
    run = bd.simulate(mech, t_end=0.4)
    assert not [x for x in run.warnings if "too long for its vibration" in x]


@pytest.mark.slow(reason="compiles the checks of a mechanism with a beam")
@pytest.mark.parametrize("settings", [{}, {"strain": "exact"}])
def test_regression_moments_in_hinges_are_not_compared(settings):
    """Of a moment in a hinge, 1.5 % of that of the rod, a change of 87 % was stated."""
    mech = bd.Mechanism()
    rod = mech.add(
        bd.Beam("rod", bd.Line((0.0, 0.0), (0.5, 0.0)), strip_of(5e-3, damping=1e-4), 2, **settings)
    )
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), rod.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), rod.end))
    mech.add(bd.DistributedForce("load", rod, (0.0, bd.sine(5.0, 10.0))))
    mech.observe("hinge", rod.section_forces(0.0))
    run = bd.simulate(mech, t_end=0.3)
    along = run.section_forces("rod").M
    assert 0.0 < np.max(np.abs(run["hinge.M"])) < 0.05 * np.max(np.abs(along))
    assert not [x for x in run.warnings if "hinge.M" in x]


def dropped_bar(elements, stiffness, exponent=1.0, damping=2e-5):
    """Return a bar with end masses whose middle falls on a soft pad at 2 m/s."""
    mech, velocity = bd.Mechanism(gravity=(0.0, -9.81)), (0.0, -2.0)
    line = bd.Line((-0.15, 0.0), (0.15, 0.0))
    settings = {"elements": elements, "velocity": velocity, "formulation": "exact"}
    bar = mech.add(bd.Beam("bar", line, strip_of(4e-3, damping), **settings))
    mech.add(bd.PointMass("left", 0.2, on=bar.start))
    mech.add(bd.PointMass("right", 0.2, on=bar.end))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"exponent": exponent, "restitution": 0.5, "impact_speed": 2.0}
    mech.add(bd.Contact("pad", bar.at(0.15), floor, stiffness, **law))
    mech.observe("middle", bd.acceleration(bar.at(0.15)))
    mech.observe("end", bd.acceleration(bar.end))
    mech.observe("quarter", bar.section_forces(0.1))
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    ("stiffness", "name", "smallest"),
    [
        (5e4, "middle.ay", 0.03),
        (5e4, "end.angle_ddot", 0.05),
        # The mesh errors of moments do not hide those of axial forces.
        (2e5, "quarter.N", 0.04),
        # The force rises within 0.3 ms, and the estimate was half the error.
        (2e5, "middle.ay", 0.1),
        (2e5, "end.angle_ddot", 0.12),
    ],
)
def test_regression_peaks_of_accelerations_are_compared(stiffness, name, smallest):
    """Peaks of drops with 2 elements were off by up to 16 % without a warning."""
    coarse, fine = (bd.simulate(dropped_bar(n, stiffness), t_end=0.02) for n in (2, 16))
    peaks = [np.abs([y.min, y.max]).max() for y in (x.step_extremes[name] for x in (coarse, fine))]
    error = abs(peaks[1] - peaks[0]) / max(peaks)
    assert error > smallest
    (sentence,) = find_sentences(coarse)
    assert stated_difference(sentence, name) == pytest.approx(error, rel=0.3)
    assert not [x for x in coarse.warnings if "faster than waves" in x]
    assert not find_sentences(fine)


@pytest.mark.slow(reason="half a second")
def test_accelerations_without_errors_have_no_warning():
    run = bd.simulate(dropped_bar(2, 2e4, damping=1e-3), t_end=0.02)
    assert not find_sentences(run)


@pytest.mark.slow(reason="half a second")
def test_regression_recommended_elements_resolve_rises():
    """With the recommended 8 elements, 10 were recommended."""
    coarse = bd.simulate(dropped_bar(2, 1e7, damping=1e-6), t_end=0.01)
    (sentence,) = (x for x in coarse.warnings if "faster than waves" in x)
    elements = int(sentence.split("use about ")[1].split()[0])
    fine = bd.simulate(dropped_bar(elements, 1e7, damping=1e-6), t_end=0.01)
    assert 8 < elements <= 12
    assert not [x for x in fine.warnings if "faster than waves" in x]


@pytest.mark.parametrize(
    ("errors", "rate_errors", "remedy"),
    [
        ({"tip.x [m]": 0.1}, {}, "use elements=4"),
        ({"tip.x [m]": 0.2}, {}, "use at least elements=8"),
        ({"tip.x [m]": 0.02}, {"tip.x_dot [m/s]": 0.05}, "use elements=4"),
        # With one element, 15 % were stated of a wiper; with 2, 8 % remained, and with 4, 2 %.
        ({"tip.x [m]": 0.02}, {"tip.x_dot [m/s]": 0.15}, "use at least elements=8"),
    ],
)
def test_regression_recommended_elements_reduce_errors_of_rates(errors, rate_errors, remedy):
    """Errors of rates decrease with a lower power of the length of elements."""
    beam = bd.Beam("strip", bd.Line((0.0, 0.0), (0.4, 0.0)), strip_of(2e-3), 2)
    largest = refined_runs.find_largest_change(errors, rate_errors)
    assert doubt_few_elements([beam]).remedy(largest) == remedy
