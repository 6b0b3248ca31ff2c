"""Sentences of wrong settings, events, laws and starts of runs, one row a sentence."""

import re

import pytest
from mechanisms import falling_ball, swing

import beamdae as bd


def simulate(integrator=None, t_end=1.0, model=None, **settings):
    return bd.simulate(model or falling_ball(), integrator or bd.Radau(), t_end, **settings)


def fast_law():
    mech = falling_ball()
    mech.add(bd.Force("shaker", mech.part("ball").point, (bd.sine(1.0, 1e9), 0.0)))
    return mech


def event(**settings):
    mech = falling_ball()
    mech.when("ball.y", 0.0, "down", "record", name="impact")
    mech.when(**{"what": "ball.y"} | settings)
    return bd.equations_of_motion(mech)


def motor():
    mech = swing()
    ends = mech.ground.at(0.0, 0.0), mech.part("bob").at(0.0, 0.0)
    return mech, mech.add(bd.Driver("motor", *ends, law=0.0)), mech.part("torque")


def contradiction(name):
    mech, driver, torque = motor()
    mech.when(
        "end.x",
        0.0,
        name="both",
        do={
            "states": [bd.activate(torque), bd.deactivate(torque)],
            "laws": [bd.change_law(driver, 1.0), bd.change_law(driver, lambda t: t)],
        }[name],
    )


def foreign():
    """Return a mechanism, and parts of another one with the same names and numbers."""
    (mech, *_), (_, driver, torque) = motor(), motor()
    return mech, driver, torque


def inactive_body():
    mech = swing()
    mech.deactivate(mech.part("bob"))
    bd.equations_of_motion(mech)


class Undecorated(bd.Integrator):
    step, order = 0.1, 1


Alpha, Ida, Radau = bd.GeneralizedAlpha, bd.Ida, bd.Radau
SENTENCES = [
    (
        lambda: Alpha(family="hht", rho_inf=0.4),
        "GeneralizedAlpha: rho_inf must lie in [0.5, 1] for family 'hht', got 0.4.",
    ),
    (
        lambda: Alpha(family="newmark", rho_inf=1.2),
        "GeneralizedAlpha: rho_inf must lie in [0, 1], got 1.2.",
    ),
    (
        lambda: Alpha(rtol=1e-4, family="newmark"),
        "GeneralizedAlpha: rtol requires a method of second order, but family 'newmark' is of "
        "first order with rho_inf = 0.8; set rho_inf = 1 or another family.",
    ),
    (
        lambda: Alpha(max_steps=100),
        "GeneralizedAlpha: max_steps = 100 requires rtol, because the end time and the step "
        "determine the number of fixed steps; omit max_steps or set rtol.",
    ),
    (
        lambda: simulate(Alpha(step=1e-60)),
        "GeneralizedAlpha: step of 1e-60 s requires 1e+60 steps in 1 s, more than the maximum "
        "of 1e+08; use a longer step or an earlier end time.",
    ),
    (
        lambda: simulate(Ida(max_step=1e-60)),
        "Ida: max_step of 1e-60 s requires 1e+60 steps in 1 s, more than the maximum of 1e+08; "
        "use a longer step or an earlier end time.",
    ),
    (
        lambda: simulate(Alpha(rtol=1e-4), model=fast_law()),
        "GeneralizedAlpha: the longest step (a quarter of the time scale of the laws) of "
        "2.5e-10 s requires 4e+09 steps in 1 s, more than the maximum of 1e+08; use a longer "
        "step or an earlier end time.",
    ),
    (
        lambda: simulate(Ida),
        "simulate: integrator must be Ida(...), Radau(...), GeneralizedAlpha(...) or another "
        "Integrator, got <class",
    ),
    (
        lambda: simulate(Undecorated()),
        "simulate: Undecorated must be a dataclass whose fields are the settings.",
    ),
    (lambda: simulate(t_end=None), "simulate: the model has no end time; pass t_end=."),
    (lambda: simulate(t_end=1e-300), "simulate: t_end must be at least 1e-75, got 1e-300."),
    (
        lambda: simulate(t_end=1e101),
        "simulate: t_end must not exceed 1e+75 in absolute value, got 1e+101.",
    ),
    (
        lambda: simulate(output_step=1e-20),
        "simulate: output_step = 1e-20 s gives more than 1e+07 rows up to t = 1 s; use a longer"
        " output_step.",
    ),
    (
        lambda: simulate(start=3),
        "simulate: start must be 'as drawn', 'equilibrium', bd.rotation(...) or a dict of "
        "positions and velocities by name such as {'crank.angle': 0.3, 'crank.angle_dot': 5.0},"
        " a solution, an equilibrium or the path of a run, got 3.",
    ),
    (
        lambda: simulate(start="none.json"),
        "none.json: the saved run cannot be read: No such file or directory; simulate and save "
        "the run again.",
    ),
    (lambda: simulate().save(3), "save: path must be the path of a file, got 3."),
    (lambda: simulate().followed_by(3), "followed_by: later must be a solution, got 3."),
    (
        lambda: event(what="ball.z"),
        "ball.z crosses 0: the column 'ball.z' is not observed (did you mean 'ball.y'?); "
        "observe the column or pass a quantity.",
    ),
    (
        lambda: event(do="jump"),
        "event: do must be 'stop', 'record', activate(...), deactivate(...), change_law(...) or"
        " impact(...), got 'jump'.",
    ),
    (
        lambda: event(name="impact"),
        "event: the name 'impact' is in use; give every event a different name.",
    ),
    (
        lambda: bd.deactivate(),
        "deactivate: expected joints and forces, got none; pass at least one part.",
    ),
    (
        lambda: bd.activate(motor()[2], as_is=True),
        "torque: as_is=True requires a joint with a gap of positions or angles, got Moment",
    ),
    (
        lambda: bd.impact(
            bd.LineSurface(swing().ground.at(0, 0)).gap(swing().part("bob").at(0, 0)), 1.5
        ),
        "impact: restitution must lie in [0, 1], got 1.5.",
    ),
    (
        inactive_body,
        "bob: a part with coordinates cannot be switched or inactive; switch joints and forces "
        "instead.",
    ),
    (
        lambda: contradiction("states"),
        "both: the event activates and deactivates 'torque' at the same time; keep one of the "
        "two actions.",
    ),
    (
        lambda: contradiction("laws"),
        "both: the event changes the law of 'motor' 2 times; pass one change_law per driver.",
    ),
    (
        lambda: foreign()[0].deactivate(foreign()[2]),
        "Mechanism.deactivate: 'torque' is not part of this mechanism; add this part first, or "
        "use a part of the mechanism.",
    ),
    (
        lambda: foreign()[0].when(foreign()[1].reaction, 1.0, do="record", name="e"),
        "e: the joint 'motor' is not part of this mechanism; add the joint first.",
    ),
]


def test_wrong_calls_are_rejected_with_one_sentence():
    for call, sentence in SENTENCES:
        with pytest.raises(bd.BeamdaeError, match=f"^{re.escape(sentence)}"):
            call()
