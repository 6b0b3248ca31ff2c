"""Warnings about extremes of forces that belong to the vibration after a start as drawn."""

import re

import numpy as np
import pytest

import beamdae as bd

G = 9.81
RATE, PERIOD = 40.0, 2.0 * np.pi / 40.0
EQUILIBRIUM, LOADED, SMOOTH = "use start='equilibrium'", "draw the parts as loaded", "bd.run_up"


def press(speed=6.28):
    """Return a crank with an elastic rod that carries a ram."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    ground = mech.ground
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), (0.0, 0.04), mass=8.0))
    mech.add(bd.Revolute("bearing", ground.at(0.0, 0.0), crank.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", ground.at(0.0, 0.0), crank.at(0.0, 0.0), lambda t: speed * t))
    low = 0.04 - 0.2
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.04, height=0.03, damping=1e-5)
    rod = mech.add(bd.Beam("rod", bd.Line((0.0, 0.04), (0.0, low)), section, elements=1))
    ram = mech.add(bd.PointMass("ram", 30.0, at=(0.0, low)))
    mech.add(bd.Revolute("crank pin", crank.at(0.0, 0.04), rod.start))
    pin = mech.add(bd.Revolute("ram pin", rod.end, ram.point))
    mech.add(bd.PointOnLine("guide", ground.at(0.0, low), ram.point, direction=(0.0, 1.0)))
    mech.observe("ram pin", pin.reaction)
    mech.observe("stress", rod.largest_stress())
    return mech


def strip(damping, height=0.01):
    return bd.Section.rectangle(bd.Material.of("steel"), 0.02, height, damping=damping)


def slider_crank(damping=1e-5, law=None, load=0.0, tip=(0.0, 0.05)):
    """Return a crank that a driver turns, with an elastic rod and a slider."""
    mech = bd.Mechanism()
    end = (tip[0] + np.sqrt(0.25**2 - tip[1] ** 2), 0.0)
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), tip, mass=1.0))
    center = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    mech.add(bd.Revolute("bearing", *center))
    motor = mech.add(bd.Driver("motor", *center, law or (lambda t: RATE * t)))
    line = bd.Line(tip, end)
    rod = mech.add(bd.Beam("rod", line, strip(damping), elements=1))
    slider = mech.add(bd.PointMass("slider", 2.0, at=end))
    pin = mech.add(bd.Revolute("pin", crank.at(*tip), rod.start))
    mech.add(bd.Revolute("slider pin", rod.end, slider.point))
    mech.add(bd.PointOnLine("guide", mech.ground.at(*end), slider.point, direction=(1.0, 0.0)))
    force = bd.table([0.1, 0.25, 0.3, 0.4], [0.0, 0.0, load, load], name="force of the press")
    if load:
        mech.add(bd.ForceLaw("press", slider.point, lambda x, t: (-force(x.position[0]), 0.0)))
    mech.observe("pin", pin.reaction)
    mech.observe("motor", motor.reaction)
    mech.observe("stress", rod.largest_stress())
    return mech


def rotor(speed=30.0, damping=1e-5, formulation="floating frame"):
    """Return a beam with a mass at its tip that a driver turns."""
    mech = bd.Mechanism()
    line = bd.Line((0.1, 0.0), (0.6, 0.0))
    blade = mech.add(
        bd.Beam("blade", line, strip(damping, 0.008), elements=1, formulation=formulation)
    )
    hub = mech.add(bd.Revolute("hub", mech.ground.at(0.1, 0.0), blade.start))
    mech.add(bd.Driver("motor", mech.ground.at(0.1, 0.0), blade.start, lambda t: speed * t))
    mech.add(bd.PointMass("tip", 0.3, on=blade.end))
    mech.observe("hub", hub.reaction)
    return mech


def yoke(turns=4.0):
    """Return an elastic arm with a mass at its tip on a slide that moves for some turns."""
    mech = bd.Mechanism()
    slide = mech.add(bd.RigidBody("yoke", 1.0, 1e-3, center=(0.0, 0.0)))
    center = mech.ground.at(0.0, 0.0), slide.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", *center, direction=(1.0, 0.0)))
    end = turns * 2.0 * np.pi / 18.0
    law = bd.piecewise((end, lambda t: 0.03 * np.cos(18.0 * t) - 0.03), 0.0)
    mech.add(bd.TranslationalDriver("drive", *center, law, direction=(1.0, 0.0)))
    line = bd.Line((0.0, 0.0), (0.0, 0.3))
    arm = mech.add(bd.Beam("arm", line, strip(1e-4, 0.008), elements=1))
    clamp = mech.add(bd.Weld("clamp", slide.at(0.0, 0.0), arm.start))
    mech.add(bd.PointMass("tip", 0.2, on=arm.end))
    mech.observe("clamp", clamp.reaction)
    return mech


def four_bar(speed=10.0 * np.pi):
    """Return a four-bar linkage with an elastic coupler and a crank that a driver turns."""
    mech = bd.Mechanism()
    a = 0.04 * np.cos(0.6), 0.04 * np.sin(0.6)
    span = np.array([0.18, 0.0]) - a
    distance = np.hypot(*span)
    cosine = (0.2**2 + distance**2 - 0.12**2) / (0.4 * distance)
    angle = np.arctan2(span[1], span[0]) + np.arccos(cosine)
    b = a[0] + 0.2 * np.cos(angle), a[1] + 0.2 * np.sin(angle)
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), a, mass=0.0108))
    rocker = mech.add(bd.RigidBody.rod("rocker", (0.18, 0.0), b, mass=0.01296))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.015, 0.001, damping=5e-4)
    coupler = mech.add(bd.Beam("coupler", bd.Line(a, b), section, elements=1))
    center = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    mech.add(bd.Revolute("shaft", *center))
    mech.add(bd.Revolute("crank pin", crank.at(*a), coupler.start))
    mech.add(bd.Revolute("rocker pin", coupler.end, rocker.at(*b)))
    mech.add(bd.Revolute("foot", mech.ground.at(0.18, 0.0), rocker.at(0.18, 0.0)))
    motor = mech.add(bd.Driver("motor", *center, lambda t: speed * t))
    mech.observe("motor", motor.reaction)
    return mech


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


def cantilever_on_a_cart(speed, gravity=G):
    """Return an elastic arm on a cart with a velocity."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.01, damping=1e-4)
    cart = mech.add(bd.RigidBody.plate("cart", (0.0, 0.0), 0.2, 0.05, mass=2.0))
    rail = mech.ground.at(0.0, 0.0), cart.at(0.0, 0.0)
    mech.add(bd.Prismatic("rail", *rail, direction=(1.0, 0.0)))
    arm = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.8, 0.0)), section, elements=2))
    mech.observe("clamp", mech.add(bd.Weld("clamp", cart.at(0.0, 0.0), arm.start)).reaction)
    mech.start = {"cart.x_dot": speed}
    return mech


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


def dropped_strip(speed):
    """Return a beam that falls on a stop, drawn at the touch."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    line = bd.Line((-0.15, 0.0), (0.15, 0.0))
    options = {"elements": 8, "formulation": "exact", "velocity": (0.0, -speed)}
    beam = mech.add(bd.Beam("strip", line, strip(1e-5, 3e-3), **options))
    for name, end in (("left", beam.start), ("right", beam.end)):
        mech.add(bd.PointMass(name, 0.08, on=end))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"restitution": 0.6, "impact_speed": speed}
    mech.observe("stop", mech.add(bd.Contact("stop", beam.at(0.15), floor, 2e6, **law)).force)
    mech.observe("stress", beam.largest_stress())
    return mech


def loaded_cantilever(height=0.01):
    """Return a cantilever on which a force acts suddenly: its vibration is the motion."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (0.5, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip(1e-3, height), elements=2))
    mech.observe("clamp", mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start)).reaction)
    mech.add(bd.Force("load", beam.end, (0.0, -10.0)))
    return mech


def thrown_mass(speed):
    """Return a mass on a spring and a damper, drawn without load, with a velocity."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, -1.0), velocity=(0.0, speed)))
    spring = bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), mass.point, 400.0, 0.5)
    mech.observe("spring", mech.add(spring).force)
    return mech


def hoist(speed=1.0):
    """Return a cabin on an elastic rope, which a winch starts smoothly."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    winch = mech.add(bd.PointMass("winch", 1.0, at=(0.0, 0.0)))
    cabin = mech.add(bd.PointMass("cabin", 500.0, at=(0.0, -20.0)))
    ground = mech.ground.at(0.0, 0.0)
    for body in (winch, cabin):
        mech.add(bd.PointOnLine(f"{body.name} guide", ground, body.point, (0.0, 1.0)))
    law, up = bd.run_up(speed, 3.0), (0.0, 1.0)
    mech.add(bd.TranslationalDriver("drive", ground, winch.point, law, direction=up))
    rope = mech.add(bd.SpringDamper("rope", winch.point, cabin.point, 3e5, 3e3))
    mech.observe("rope", rope.force)
    return mech


def press_beside_a_ball():
    """Return the press with another body, whose velocity an equilibrium would remove."""
    mech = press()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0), velocity=(0.1, 0.0)))
    mech.add(bd.Spring("spring", ball.point, mech.ground.at(2.0, 0.0), 10.0))
    return mech


def beside_an_inactive_rod(mech):
    """Return the mechanism with a mass on a spring beside it, whose rod never acts."""
    mass = mech.add(bd.PointMass("late", 1.0, at=(30.0, 0.0)))
    mech.add(bd.Spring("late spring", mech.ground.at(30.0, 2.0), mass.point, 100.0))
    rod = mech.add(bd.Distance("late rod", mech.ground.at(30.0, 1.0), mass.point))
    mech.deactivate(rod)
    return mech


def start_impact():
    mech = sliding_box(1.0, friction=0.0)
    mech.start = {"box.x_dot": 1.0, "box.y_dot": -1.0}
    return mech


def oscillate(t):
    return 0.03 * (1.0 - np.cos(3.0 * t))


IN_EQUILIBRIUM = {"start": "equilibrium"}
# Model, end of the run, settings, and the remedy of the warning, or "".
CASES = {
    "weight on a press": (press(), 1.0, {}, EQUILIBRIUM),
    "slow press": (press(1.0), 1.0, {}, EQUILIBRIUM),
    "press beside a ball": (press_beside_a_ball(), 1.0, {}, LOADED),
    "box": (sliding_box(0.0), 1.0, {}, EQUILIBRIUM),
    "sliding box": (sliding_box(6.0), 1.0, {}, LOADED),
    "large sliding box": (sliding_box(-6.0, 10.0, exponent=1.5), 1.0, {}, LOADED),
    "cart": (cantilever_on_a_cart(2.0), 2.0, {}, LOADED),
    "wiper": (wiper(oscillate), 2.0, {}, EQUILIBRIUM),
    "wiper at rest": (wiper(lambda t: 1e-9 * oscillate(t)), 2.0, {}, EQUILIBRIUM),
    "hoist": (hoist(), 6.0, {}, EQUILIBRIUM),
    "crank": (slider_crank(), 2.0 * PERIOD, {}, SMOOTH),
    "rotor": (rotor(9.0), 1.0, {}, SMOOTH),
    "exact rotor": (rotor(formulation="exact"), 0.3, {}, SMOOTH),
    "rotor and rod": (beside_an_inactive_rod(rotor(9.0)), 1.0, {}, SMOOTH),
    "wiper and rod": (beside_an_inactive_rod(wiper(oscillate)), 2.0, {}, EQUILIBRIUM),
    "press in equilibrium": (press(), 1.0, IN_EQUILIBRIUM, ""),
    "wiper in equilibrium": (wiper(oscillate), 2.0, IN_EQUILIBRIUM, ""),
    "hoist in equilibrium": (hoist(), 6.0, IN_EQUILIBRIUM, ""),
    "box as loaded": (sliding_box(60.0, depth=0.5 * G / 1e6, friction=0.0), 1.0, {}, ""),
    "cart without weight": (cantilever_on_a_cart(2.0, 0.0), 2.0, {}, ""),
    "rotor in rotation": (rotor(9.0), 1.0, {"start": bd.rotation(9.0, (0.1, 0.0))}, ""),
    "run-up of a crank": (slider_crank(law=bd.run_up(RATE, 2.0 * PERIOD)), 4.0 * PERIOD, {}, ""),
    "larger load later": (slider_crank(1e-4, load=2000.0), 2.0 * PERIOD, {}, ""),
    "larger magnitude later": (four_bar(), 0.4, {}, ""),
    "single stroke": (yoke(turns=1.0), 1.4, {}, ""),
    "step response": (loaded_cantilever(), 1.0, {}, ""),
    "step response of a stiff beam": (loaded_cantilever(0.05), 0.1, {}, ""),
    "vibration by a velocity": (thrown_mass(5.0), 2.0, {}, ""),
    "slow vibration": (thrown_mass(0.1), 2.0, {}, ""),
    "impact": (sliding_box(1.0, depth=-0.02, friction=0.0), 1.0, {}, ""),
    "impact at the start": (start_impact(), 1.0, {}, ""),
    "fall on a stop": (dropped_strip(2.0), 0.05, {}, ""),
}


def find_warning(solution):
    return "".join(x for x in solution.warnings if "the start as drawn causes" in x)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(("mech", "t_end", "settings", "remedy"), CASES.values(), ids=CASES.keys())
def test_largest_forces_of_the_vibration_after_the_start_have_a_warning(
    mech, t_end, settings, remedy
):
    sentence = find_warning(bd.simulate(mech, bd.Radau(1e-5), t_end=t_end, **settings))
    assert bool(sentence) == bool(remedy)
    assert remedy in sentence


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    ("mech", "column", "settings"),
    [(press(), "ram pin.Fy", IN_EQUILIBRIUM), (wiper(oscillate), "glass.N", IN_EQUILIBRIUM)],
)
def test_the_recommended_start_has_the_later_extreme(mech, column, settings):
    """The weight acts suddenly on unstressed parts: up to twice the static force."""
    drawn = bd.simulate(mech, bd.Radau(1e-5), t_end=2.0)
    resting = bd.simulate(mech, bd.Radau(1e-5), t_end=2.0, **settings)
    sentence = find_warning(drawn)
    assert sentence.startswith(f"{column}")
    peak, right = (x.step_extremes[column].max for x in (drawn, resting))
    assert peak > 1.3 * right
    assert f"its largest value, {peak:.4g} N at t" in sentence
    later = float(re.search(r"largest one later: (\S+)", sentence)[1])
    assert later == pytest.approx(right, rel=0.01)
