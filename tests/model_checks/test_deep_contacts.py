"""Warnings about contacts whose penetration exceeds the size of a touching part."""

import warnings

import pytest

import beamdae as bd


def cantilever(stiffness, height=2e-3, start=None):
    """Cantilever of 0.2 m that a force of 10 N presses on a surface below its tip."""
    rubber = bd.Material(E=6e6, nu=0.45, rho=1150.0)
    section = bd.Section.rectangle(rubber, width=0.03, height=height, damping=3e-3)
    settings = {} if start is None else {"start": start}
    mech = bd.Mechanism(**settings)
    lip = mech.add(bd.Beam("lip", bd.Line((0, 0), (0.2, 0)), section, 2, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0, 0), lip.start))
    mech.add(bd.Force("press", lip.end, (0.0, -10.0)))
    surface = bd.LineSurface(mech.ground.at(0.0, -1e-4))
    law = {"restitution": 0.1, "impact_speed": 0.1}
    mech.add(bd.Contact("glass", lip.end, surface, stiffness, exponent=1.0, **law))
    mech.observe("lip", lip.end)
    return mech


def deep_warnings(call, *arguments, **settings):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return [x for x in call(*arguments, **settings).warnings if "deep, more than" in x]


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_soft_contacts_let_parts_pass_in_silence():
    """A lip of 2 mm sank 22 mm into a surface, without a word."""
    (text,) = deep_warnings(bd.simulate, cantilever(1e3), t_end=0.2)
    assert text.startswith("glass: the contact sinks 0.0")
    assert "more than lip is thick (0.002 m)" in text
    # 10 N / (1e3 N/m) are 10 mm.
    (text,) = deep_warnings(bd.check, cantilever(1e3, start="equilibrium"))
    depth = float(text.split("sinks ")[1].split(" m deep")[0])
    assert 0.008 < depth <= 0.01  # the beam carries the rest


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("start", [None, "equilibrium"])
def test_contacts_less_deep_than_the_beam_have_no_warning(start):
    assert deep_warnings(bd.simulate, cantilever(1e5, start=start), t_end=0.05) == []
    assert deep_warnings(bd.check, cantilever(1e5, start=start)) == []
    assert deep_warnings(bd.simulate, cantilever(1e3, 0.05, start), t_end=0.05) == []


def dropped_bar(stiffness, is_guided=False):
    """Return a bar of 0.3 m and 4 mm that falls flat on a layer of foam at 2 m/s."""
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=0.004, damping=2e-5)
    line, start = bd.Line((-0.15, 0.0), (0.15, 0.0)), {"velocity": (0.0, -2.0)}
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bar = mech.add(bd.Beam("bar", line, section, elements=2, formulation="exact", **start))
    for name, point in (("left", bar.start), ("right", bar.end)):
        mech.add(bd.PointMass(name, 0.2, on=point))
    if is_guided:
        mech.add(bd.PointOnLine("guide", mech.ground.at(-0.15, 0.0), bar.start, (0.0, 1.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"exponent": 1.0, "restitution": 0.5, "impact_speed": 2.0}
    mech.add(bd.Contact("foam", bar.at(0.15), floor, stiffness, **law))
    mech.observe("bar", bar.at(0.15))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_free_beams_may_sink_into_foam_deeper_than_they_are_thick():
    """Each drop on foam had a warning, because the bar is thinner than the foam is compressed."""
    assert deep_warnings(bd.simulate, dropped_bar(2e4), t_end=0.03) == []
    (text,) = deep_warnings(bd.simulate, dropped_bar(1.0), t_end=0.4)
    assert "more than bar is long (0.3 m)" in text
    # A joint to the ground leaves it open whether the bar should bend.
    (text,) = deep_warnings(bd.simulate, dropped_bar(2e4, is_guided=True), t_end=0.03)
    assert "more than bar is thick (0.004 m)" in text


def falling_crate(stiffness, height=0.1, has_shape=True):
    """Crate of 5 kg that falls by 0.25 m on two of its corners."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    outline = [
        (x, 0.3 + y * height) for x, y in ((-0.1, -0.5), (0.1, -0.5), (0.1, 0.5), (-0.1, 0.5))
    ]
    body = bd.RigidBody("crate", 5.0, 0.02, (0.0, 0.3), shape=outline if has_shape else ())
    crate, floor = mech.add(body), bd.LineSurface(mech.ground.at(0.0, 0.05 - height / 2.0))
    law = {"exponent": 1.0, "restitution": 0.3, "impact_speed": 2.2}
    for name, x in (("left", -0.1), ("right", 0.1)):
        point = crate.at(x, 0.3 - height / 2.0)
        mech.add(bd.Contact(name, point, floor, stiffness, **law))
    mech.observe("crate", crate.at(0.0, 0.3))
    return mech


def colliding_balls(stiffness, side="outside"):
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(5.0, 0.0)))
    other = mech.add(bd.PointMass("other", 1.0, at=(0.0 if side == "inside" else 0.5, 0.0)))
    circle = bd.CircleSurface(other.point, 0.1, side)
    law = {"exponent": 1.0, "restitution": 0.5, "impact_speed": 5.0}
    mech.add(bd.Contact("hit", ball.point, circle, stiffness, **law))
    mech.observe("ball", ball.point)
    return mech


def test_regression_rigid_bodies_and_circles_passed_through_each_other_in_silence():
    """A crate 0.1 m high sank 0.3 m into the floor, and balls passed through each other."""
    (text,) = deep_warnings(bd.simulate, falling_crate(100.0), t_end=0.8)
    assert "(also " in text
    assert ": the contact sinks 0.301 m deep" in text
    assert "more than crate is thick in this direction (0.1 m)" in text
    (text,) = deep_warnings(bd.simulate, falling_crate(100.0, has_shape=False), t_end=0.8)
    assert "more than the largest distance between points of crate (0.2 m)" in text
    (text,) = deep_warnings(bd.simulate, colliding_balls(100.0), t_end=0.3)
    assert text.startswith("hit: the contact sinks 0.1 m deep")
    assert "more than half the radius of the circle (0.05 m)" in text


@pytest.mark.parametrize(
    "model",
    [
        falling_crate(1e4),
        falling_crate(100.0, height=0.4),  # as soft, but not as deep as the crate is high
        falling_crate(1e4, has_shape=False),
        colliding_balls(1e4),
        # The clearance of a bore says nothing about the thickness of its wall.
        colliding_balls(100.0, side="inside"),
    ],
)
def test_stiff_contacts_of_rigid_bodies_and_clearances_have_no_warning(model):
    assert deep_warnings(bd.simulate, model, t_end=0.5) == []


def pressed_leaf(softness, contacts=1, exponent=1.0):
    """Return a leaf of 0.1 m whose tip overlaps a surface by 1 mm, in equilibrium.

    The linear contact is `softness` times as soft as the leaf.
    """
    steel = bd.Material(E=2e11, nu=0.3, rho=7850.0)
    section = bd.Section.rectangle(steel, width=0.01, height=2e-3, damping=1e-4)
    mech = bd.Mechanism(start="equilibrium")
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.1, 0.0)), section, 2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), leaf.start))
    stiffness = 3.0 * 2e11 * (0.01 * 2e-3**3 / 12.0) / 0.1**3 / softness
    surface = bd.LineSurface(mech.ground.at(0.0, 1e-3))
    for k in range(contacts):
        mech.add(
            bd.Contact(f"pad {k}", leaf.end, surface, stiffness * 1e3 ** (exponent - 1), exponent)
        )
    mech.observe("tip", leaf.end)
    return mech


def soft_warnings(mech, t_end=0.1):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return [x for x in bd.simulate(mech, t_end=t_end).warnings if "soft layer" in x]


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_contacts_softer_than_the_beam_have_a_warning():
    """A contact took 99 % of the stroke that should bend the lip of a wiper."""
    (text,) = soft_warnings(pressed_leaf(4.0))
    assert text == (
        "pad 0: the contact sinks 0.0008 m deep on average, but its force deflects the parts that "
        "it touches by only 0.0002 m; raise the stiffness if it does not stand for a soft layer."
    )
    # Sqrt(1e3 d) of the tangent at 1 mm.
    (text,) = soft_warnings(pressed_leaf(4.0, exponent=1.5))
    assert "sinks 0.0008" in text


@pytest.mark.slow(reason="a fifth of a second")
def test_stiff_contacts_foundations_and_free_beams_on_soft_floors_have_no_warning():
    assert soft_warnings(pressed_leaf(0.25)) == []
    assert soft_warnings(pressed_leaf(8.0, contacts=2)) == []
    mech = bd.Mechanism(gravity=(0.0, -9.81), start="equilibrium")
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.01, 2e-3)
    beam = mech.add(bd.Beam("board", bd.Line((0.0, 0.0), (0.1, 0.0)), section, 2))
    mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), beam.start, direction=(0.0, 1.0)))
    mech.add(bd.Contact("foam", beam.end, bd.LineSurface(mech.ground.at(0.0, 0.0)), 200.0, 1.0))
    assert soft_warnings(mech) == []
