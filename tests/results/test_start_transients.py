"""Warnings about extremes of forces that belong to the vibration after a start as drawn."""

import pytest

import beamdae as bd

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
    assert f"its largest value, {peak:.4g} N" in sentence
    assert peak > 1.3 * peak_at_rest
    later = float(sentence.partition("value later: ")[2].split()[0])
    assert later == pytest.approx(peak_at_rest, rel=0.01)
    assert not find_warnings(resting)


def test_larger_forces_of_the_motion_have_no_warning():
    assert not find_warnings(bd.simulate(press(62.8), bd.Radau(1e-5), t_end=0.5))


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


def test_given_velocities_have_no_warning():
    """A start in equilibrium would remove them."""
    mech = press()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0), velocity=(0.1, 0.0)))
    mech.add(bd.Spring("spring", ball.point, mech.ground.at(2.0, 0.0), 10.0))
    assert not find_warnings(bd.simulate(mech, bd.Radau(1e-5), t_end=1.0))
