"""Model of a rotating arm, and sweeps of its parameters."""

import warnings

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=0.02)
STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
THIN, THICK = (bd.Section.rectangle(STEEL, width=0.02, height=h) for h in (0.001, 0.002))


@bd.model(t_end=0.4)
def turning(speed=1.0, radius=1.0, section=THIN, color="red", turns=1):
    """Return an arm driven at `speed` [rad/s], whose tip moves as x = r cos(w t)."""
    if radius <= 0.0:
        raise bd.BeamdaeError(f"turning: radius must be positive, got {radius}.")
    mech = bd.Mechanism()
    arm = mech.add(bd.RigidBody("arm", section.area * 1e4, inertia=0.1))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0), lambda t: speed * t))
    mech.observe("tip", arm.at(radius, 0.0))
    return mech


def run_sweep(over, **settings):
    """Return a sweep of the model over these parameters, without warnings."""
    arguments = {"of": "tip.x", "integrator": ALPHA} | settings
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return bd.sweep(turning, over, **arguments)
