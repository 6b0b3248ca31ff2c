"""Flexible inverted pendulum on a cart, balanced by an LQR, continuous or sampled with noise."""

import numpy as np

import beamdae as bd

EVERY = 0.01  # sampling interval [s]
# LQR gains of position [m], velocity [m/s], angle [rad] and rate [rad/s]: `control.lqr` of
# python-control with Q = diag(100, 1, 100, 1) and R = 1, for `bd.linearize` of the rigid strip.
GAINS = (-10.0, -8.8330, 46.9861, 9.4685)
# Standard deviations of the sampled position [m], angle [rad], velocity [m/s] and rate [rad/s].
NOISE = (2e-4, 1e-3, 5e-3, 2e-2)


@bd.model(t_end=2.0)
def inverted_pendulum(
    control="continuous",
    tilt=0.1,
    gains=GAINS,
    rigid=False,
    height=1e-3,
    noise=1.0,
    seed=1,
    elements=3,
    formulation="exact",
):
    """Balance a strip of spring steel with a mass of 60 g on top, which starts at `tilt` [rad].

    The strip, 20 mm x `height` [m] and 0.5 m long and optionally `rigid`, stands on a cart of
    0.8 kg. The cart returns to the center of its rail. The `control` is
    "continuous", "sampled" (at 100 Hz with `noise` [-] times the noise of the sensors) or "none",
    with the force on the cart as an input.
    """
    length = 0.5
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=height, damping=1e-4)

    mech = bd.Mechanism(gravity=(0.0, -9.81))
    cart = mech.add(bd.RigidBody.plate("cart", (0.0, 0.0), 0.16, 0.06, mass=0.8))
    hinge = cart.at(0.0, 0.0)
    top = (length * np.sin(tilt), length * np.cos(tilt))
    if rigid:
        mass = section.rhoA * length
        strip = mech.add(bd.RigidBody.rod("strip", (0.0, 0.0), top, mass=mass))
        start, end = strip.at(0.0, 0.0), strip.at(*top)
        upright = tilt  # angles of rigid bodies are zero in the drawing
    else:
        curve = bd.Line((0.0, 0.0), top)
        strip = bd.Beam("strip", curve, section, elements=elements, formulation=formulation)
        mech.add(strip)
        start, end = strip.start, strip.end
        upright = 0.5 * np.pi
    bob = mech.add(bd.RigidBody.disk("bob", top, radius=0.02, mass=0.06))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, -0.03), cart.at(0.0, -0.03)))
    mech.add(bd.Revolute("hinge", hinge, start))
    mech.add(bd.Weld("clamp", end, bob.at(*top)))

    position, velocity, angle, rate = (
        mech.sensor(name, point, column)
        for name, point, column in (
            ("position", hinge, "x"),
            ("velocity", hinge, "x_dot"),
            ("angle", start, "angle"),
            ("rate", start, "angle_dot"),
        )
    )
    if control == "continuous":
        errors = (position, velocity, angle - upright, rate)
        force = -sum(gain * error for gain, error in zip(gains, errors, strict=True))
    else:
        force = mech.input("force", unit="N")

    def law(sample):
        measured = sample.reads + noise * np.array(NOISE) * sample.random.normal(size=4)
        return -np.dot(gains, measured - [0.0, 0.0, upright, 0.0])

    if control == "sampled":
        reads = [position, velocity, angle, rate]
        mech.add(bd.Controller("regulator", EVERY, reads, [force], law, seed=seed))
    motor = mech.add(bd.Force("motor", cart.at(-0.08, 0.0), (force, 0.0)))

    mech.observe("cart", hinge)
    mech.observe("bob", bob.at(*top))
    if not rigid:
        mech.observe("deflection", strip.deflection(length))
    mech.observe("motor", motor.force)
    return mech
