"""Warnings about drivers whose laws start with a velocity."""

import warnings

import numpy as np

import beamdae as bd
from beamdae.equations.equations_of_motion import State
from beamdae.equations.failure_diagnosis import diagnose_failure


def leaf_spring(stroke=2e-3, is_smooth=False):
    """Return a platform on a leaf spring that a driver moves sinusoidally at 10 Hz."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.015, height=5e-4)
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.0, 0.05)), section, elements=4))
    platform = mech.add(bd.RigidBody.plate("platform", (0.0, 0.06), 0.08, 0.02, mass=0.1))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), leaf.start))
    mech.add(bd.Weld("screw", leaf.end, platform.at(0.0, 0.05)))

    def law(t):
        phase = 20.0 * np.pi * t
        return stroke * (0.5 * (1.0 - np.cos(phase)) if is_smooth else np.sin(phase))

    center = mech.ground.at(0.0, 0.06), platform.at(0.0, 0.06)
    mech.add(bd.TranslationalDriver("drive", *center, law, direction=(1, 0)))
    return mech


def run(step, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return bd.simulate(leaf_spring(**options), bd.GeneralizedAlpha(step), t_end=0.05)


def test_regression_failures_of_the_first_step_name_the_driver():
    solution = run(2e-3, stroke=0.02)
    assert not solution.status.success
    assert "drive starts with a velocity" in solution.status.sentence


def test_regression_failures_of_long_steps_do_not_blame_laws_that_start_at_rest():
    """The law was evaluated where the run failed, and `run_up` behind its end."""
    sentence = run(2e-3, stroke=0.5, is_smooth=True).status.sentence
    assert "did not converge" in sentence
    assert "starts with a velocity" not in sentence
    mech = bd.Mechanism()
    crank = mech.add(bd.RigidBody("crank", mass=1.0, inertia=0.01))
    center = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    mech.add(bd.Revolute("pivot", *center))
    mech.add(bd.Driver("motor", *center, bd.run_up(30.0, 0.2)))
    equations = bd.equations_of_motion(mech)
    state = State(equations.q0, *(np.zeros(n) for n in (equations.n, equations.n, equations.m)))
    sentence = diagnose_failure(equations, np.array([0.25, 0.3]), state, 0.26, 0.01)
    assert "starts with a velocity" not in sentence
