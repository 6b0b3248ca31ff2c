"""Model of a rotating arm, and sweeps of its parameters."""

from mechanisms import hinged_body, rectangle

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=0.02)
THIN, THICK = (rectangle(h) for h in (0.001, 0.002))


@bd.model(t_end=0.4)
def turning(speed=1.0, radius=1.0, section=THIN, color="red", turns=1):
    """Return an arm driven at `speed` [rad/s], whose tip moves as x = r cos(w t)."""
    if radius <= 0.0:
        raise bd.BeamdaeError(f"turning: radius must be positive, got {radius}.")
    mech, arm = hinged_body(section.area * 1e4, 0.1, name="arm")
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0), lambda t: speed * t))
    mech.observe("tip", arm.at(radius, 0.0))
    return mech


def run_sweep(over, **settings):
    """Return a sweep of the model over these parameters, without warnings."""
    arguments = {"of": "tip.x", "integrator": ALPHA} | settings
    return bd.sweep(turning, over, **arguments)
