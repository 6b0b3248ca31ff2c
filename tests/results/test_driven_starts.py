"""Warnings about drivers whose laws start with a velocity."""

import warnings

import numpy as np

import beamdae as bd


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
    """The law was evaluated where the run failed."""
    sentence = run(2e-3, stroke=0.5, is_smooth=True).status.sentence
    assert "did not converge" in sentence
    assert "starts with a velocity" not in sentence
