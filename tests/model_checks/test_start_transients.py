"""Warnings about extremes of forces that belong to the vibration after a start as drawn."""

import numpy as np
import pytest

import beamdae as bd
from beamdae.model_checks import start_transients

MASS, G, RADIUS, ROD = 30.0, 9.81, 0.04, 0.2


def press(speed=6.28):
    """Return a crank with an elastic rod that carries a ram."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    ground = mech.ground
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), (0.0, RADIUS), mass=8.0))
    mech.add(bd.Revolute("bearing", ground.at(0.0, 0.0), crank.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", ground.at(0.0, 0.0), crank.at(0.0, 0.0), lambda t: speed * t))
    low = RADIUS - ROD
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.04, height=0.03, damping=1e-5)
    rod = mech.add(bd.Beam("rod", bd.Line((0.0, RADIUS), (0.0, low)), section, elements=1))
    ram = mech.add(bd.PointMass("ram", MASS, at=(0.0, low)))
    mech.add(bd.Revolute("crank pin", crank.at(0.0, RADIUS), rod.start))
    pin = mech.add(bd.Revolute("ram pin", rod.end, ram.point))
    mech.add(bd.PointOnLine("guide", ground.at(0.0, low), ram.point, direction=(0.0, 1.0)))
    mech.observe("ram pin", pin.reaction)
    mech.observe("stress", rod.largest_stress())
    return mech


def find_warnings(solution):
    return [x for x in solution.warnings if "the drawing is not in" in x]


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("speed", [1.0, 6.28])
def test_regression_peaks_of_the_start_are_named(speed):
    """The weight of the ram acts suddenly on the unstressed rod: twice the static force."""
    with pytest.warns(bd.BeamdaeWarning, match="the drawing is not in"):
        drawn = bd.simulate(press(speed), bd.Radau(1e-5), t_end=1.0)
    resting = bd.simulate(press(speed), bd.Radau(1e-5), t_end=1.0, start="equilibrium")
    (sentence,) = find_warnings(drawn)
    assert sentence.startswith("ram pin.Fy")
    assert sentence.endswith("use start='equilibrium'.")
    peak, peak_at_rest = (x.step_extremes["ram pin.Fy"].max for x in (drawn, resting))
    assert f"its value of largest magnitude, {peak:.4g} N" in sentence
    assert peak > 1.3 * peak_at_rest
    later = float(sentence.partition("magnitude later: ")[2].split()[0])
    assert later == pytest.approx(peak_at_rest, rel=0.01)
    assert not find_warnings(resting)


@pytest.mark.slow(reason="a fifth of a second")
def test_larger_forces_of_the_motion_have_no_warning():
    assert not find_warnings(bd.simulate(press(62.8), bd.Radau(1e-5), t_end=0.5))


@pytest.mark.slow(reason="half a second")
def test_step_responses_have_no_warning():
    """The vibration after a load that jumps at the start is the motion of interest."""
    mech = bd.Mechanism()
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=0.01, damping=1e-3)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.5, 0.0)), section, elements=2))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("load", beam.end, (0.0, -10.0)))
    mech.observe("clamp", clamp.reaction)
    solution = bd.simulate(mech, bd.Radau(1e-5), t_end=1.0)
    extremes = solution.step_extremes["clamp.M"]
    assert max(abs(extremes.min), abs(extremes.max)) > 1.3 * 5.0
    assert not find_warnings(solution)


def sliding_box(speed, size=1.0, depth=0.0, friction=0.5, **laws):
    """Return a box on two contacts with a floor, drawn at a depth."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    side, velocity = 0.1 * size, (speed, 0.0) if speed else None
    center = (0.0, 0.5 * side - depth)
    box = mech.add(bd.RigidBody.plate("box", center, side, side, mass=1.0, velocity=velocity))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), (1.0, 0.0))
    laws = {"exponent": 1.0, "restitution": 0.3, "impact_speed": 0.1, **laws}
    if friction:
        laws["friction"] = friction
    for name, x in (("left", -0.5 * side), ("right", 0.5 * side)):
        contact = mech.add(bd.Contact(name, box.at(x, -depth), floor, 1e6, **laws))
        mech.observe(name, contact.force)
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("size", [1.0, 10.0])
@pytest.mark.parametrize("speed", [0.0, 0.1, 1.0, 6.0, -6.0, 60.0])
def test_regression_weight_acts_suddenly_on_contacts_that_slide(speed, size, exponent):
    """Nothing was said of the doubled forces of a box with a velocity, nor of one at rest."""
    run = bd.simulate(sliding_box(speed, size, exponent=exponent), t_end=1.0)
    # The height of the center is half the distance of the contacts: friction shifts the weight.
    shift = 0.5 * np.sign(speed)
    for name, share in (("left", 1.0 - shift), ("right", 1.0 + shift)):
        peak, static = run.step_extremes[f"{name}.N"].max, 0.5 * G * share
        if share >= 1.0:
            assert peak > 1.5 * static
    (sentence,) = [x for x in run.warnings if "belongs to a vibration" in x]
    assert ("right.N" if speed >= 0.0 else "left.N") in sentence
    assert ("because box starts with a velocity" in sentence) == bool(speed)
    assert sentence.endswith("use start='equilibrium'.") == (not speed)


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("speed", [1.0, 60.0])
def test_moving_bodies_that_are_drawn_as_loaded_have_no_warning(speed):
    box = sliding_box(speed, depth=0.5 * G / 1e6, friction=0.0)
    run = bd.simulate(box, t_end=1.0)
    assert run.step_extremes["left.N"].max == pytest.approx(0.5 * G, rel=1e-6)
    assert not [x for x in run.warnings if "belongs to a vibration" in x]


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("height", [0.0, 0.02])
def test_impacts_of_moving_bodies_are_no_vibrations_of_the_start(height):
    box = sliding_box(1.0, depth=-height, friction=0.0)
    if not height:
        box.start = {"box.x_dot": 1.0, "box.y_dot": -1.0}
    run = bd.simulate(box, t_end=1.0)
    assert run.step_extremes["left.N"].max > 2.0 * G
    assert not [x for x in run.warnings if "belongs to a vibration" in x]


def cantilever_on_a_cart(speed, gravity=G):
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.01, damping=1e-4)
    cart = mech.add(bd.RigidBody.plate("cart", (0.0, 0.0), 0.2, 0.05, mass=2.0))
    rail = mech.ground.at(0.0, 0.0), cart.at(0.0, 0.0)
    mech.add(bd.Prismatic("rail", *rail, direction=(1.0, 0.0)))
    arm = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.8, 0.0)), section, elements=2))
    mech.observe("clamp", mech.add(bd.Weld("clamp", cart.at(0.0, 0.0), arm.start)).reaction)
    mech.start = {"cart.x_dot": speed}
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(("speed", "gravity"), [(2.0, G), (0.01, G), (2.0, 0.0)])
def test_regression_weight_acts_suddenly_on_beams_that_move(speed, gravity):
    run = bd.simulate(cantilever_on_a_cart(speed, gravity), t_end=2.0)
    sentences = [x for x in run.warnings if "belongs to a vibration" in x]
    assert len(sentences) == (gravity > 0.0)
    assert all("clamp.M" in x and "start with a velocity" in x for x in sentences)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_other_bodies_with_velocities_do_not_hide_the_warning():
    """A start in equilibrium would remove their velocities."""
    mech = press()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0), velocity=(0.1, 0.0)))
    mech.add(bd.Spring("spring", ball.point, mech.ground.at(2.0, 0.0), 10.0))
    (sentence,) = find_warnings(bd.simulate(mech, bd.Radau(1e-5), t_end=1.0))
    assert sentence.startswith("ram pin.Fy")
    assert "start='equilibrium'" not in sentence


def wiper(law):
    """Return a lip of rubber, drawn at a glass, that a spring presses down and a crank moves."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    rubber = bd.Material(E=8e6, nu=0.48, rho=1150.0)
    section = bd.Section.rectangle(rubber, width=0.4, height=1.6e-3, damping=2e-3)
    carriage = mech.add(bd.RigidBody("carriage", mass=0.3, inertia=1e-3, center=(0.0, 0.03)))
    holder = mech.add(bd.RigidBody("holder", mass=0.2, inertia=1e-4, center=(0.0, 0.02)))
    rail = mech.ground.at(0.0, 0.03), carriage.at(0.0, 0.03)
    mech.add(bd.Prismatic("rail", *rail, direction=(1.0, 0.0)))
    plunger = carriage.at(0.0, 0.02), holder.at(0.0, 0.02)
    mech.add(bd.Prismatic("plunger", *plunger, direction=(0.0, 1.0)))
    mech.add(bd.Force("press", holder.at(0.0, 0.02), (0.0, -6.0)))
    lip = mech.add(bd.Beam("lip", bd.Line((0.0, 0.012), (0.0, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", holder.at(0.0, 0.012), lip.start))
    mech.add(bd.TranslationalDriver("crank", *rail, law, direction=(1.0, 0.0)))
    surface = bd.LineSurface(mech.ground.at(0.0, 0.0))
    rest = {"restitution": 0.3, "impact_speed": 0.05}
    glass = bd.Contact("glass", lip.end, surface, 5e6, **rest, friction=0.6, friction_speed=1e-3)
    mech.observe("glass", mech.add(glass).force)
    return mech


WIPER_LAWS = {
    "crank": lambda t: 0.03 * (1.0 - np.cos(3.0 * t)),
    "hardly moving": lambda t: 1e-9 * (1.0 - np.cos(3.0 * t)),
    "run-up": bd.run_up(0.06, 1.0),
}


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("law", WIPER_LAWS.values(), ids=WIPER_LAWS)
def test_regression_loads_on_an_unloaded_contact_are_the_cause_beside_a_driver(law):
    """The acceleration of the crank was named, or nothing; the press doubled the force."""
    drawn = bd.simulate(wiper(law), bd.Radau(1e-5), t_end=2.0)
    (sentence,) = [x for x in drawn.warnings if "belongs to a vibration" in x]
    assert sentence.startswith("glass.N")
    assert "begins because the drawing is not in equilibrium (" in sentence
    assert sentence.endswith("use start='equilibrium'.")
    resting = bd.simulate(wiper(law), bd.Radau(1e-5), t_end=2.0, start="equilibrium")
    assert not [x for x in resting.warnings if "belongs to a vibration" in x]
    later = float(sentence.partition("magnitude later: ")[2].split()[0])
    assert resting.step_extremes["glass.N"].max == pytest.approx(later, rel=0.01)
    assert drawn.step_extremes["glass.N"].max > 1.5 * later


@pytest.mark.parametrize(("share", "count"), [(0.01, 0), (0.45, 0), (0.55, 1)])
def test_regression_extremes_of_a_smaller_magnitude_are_no_early_peaks(share, count):
    """The extreme of the unloaded side of a stress, 0.1 % of its range, was named."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0)))
    decay = bd.table(
        [0.0, 0.01, 0.02, 1.0], [0.0, -100.0 * share, 0.0, 100.0 * (1.0 - share)], kind="linear"
    )
    load = mech.add(bd.Force("load", mass.point, (decay, 0.0)))
    mech.observe("load", load.force)
    run = bd.simulate(mech, bd.Radau(1e-5), t_end=1.0)
    extremes = run.step_extremes
    assert extremes["load.Fx"].min == pytest.approx(-100.0 * share)
    peaks = start_transients._find_early_peaks(
        run.equations, run.trajectory, extremes, run._observe, 0.05, 0.1
    )
    assert len(peaks) == count


def belt(speed, force):
    """Return a block that a force presses on a belt, and that a spring holds against friction."""
    mech = bd.Mechanism()
    ground = mech.ground
    block = mech.add(bd.RigidBody.plate("block", (0.0, 0.01), 0.03, 0.02, mass=0.3))
    band = mech.add(bd.RigidBody.plate("belt", (0.0, -0.005), 1.0, 0.01, mass=1.0))
    rail = ground.at(0.0, -0.005), band.at(0.0, -0.005)
    mech.add(bd.Prismatic("rail", *rail, direction=(1.0, 0.0)))
    law = bd.TranslationalDriver("drive", *rail, lambda t: speed * t, direction=(1.0, 0.0))
    mech.observe("drive", mech.add(law).drive)
    mech.add(bd.Driver("level", ground.at(0.0, 0.0), block.at(0.0, 0.01), 0.0))
    spring = bd.SpringDamper("spring", ground.at(-0.2, 0.01), block.at(0.0, 0.01), 3e3, 0.6)
    mech.add(spring)
    mech.add(bd.Force("press", block.at(0.0, 0.01), (0.0, -force)))
    surface = bd.LineSurface(band.at(0.0, 0.0), direction=(1.0, 0.0))
    laws = {"restitution": 0.3, "impact_speed": 0.1, "friction": 0.25}
    pad = bd.Contact("pad", block.at(0.0, 0.0), surface, 1e6, exponent=1, **laws)
    mech.observe("pad", mech.add(pad).force)
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(("speed", "force"), [(0.02, 20.0), (0.2, 20.0), (1.0, 2.0)])
def test_regression_drivers_along_a_contact_are_no_cause_of_its_vibration(speed, force):
    """The drive of the belt was named, although it does not move along the normal."""
    solution = bd.simulate(belt(speed, force), t_end=0.2)
    sentences = [x for x in solution.warnings if "belongs to a vibration" in x]
    (sentence,) = [x for x in sentences if "pad.N" in x.partition(":")[0]]
    assert "begins because the drawing is not in equilibrium (" in sentence
    assert not [x for x in sentences if "drive" in x.partition(":")[2]]
