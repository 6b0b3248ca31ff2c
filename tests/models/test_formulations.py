"""Every model with a beam has a parameter for the formulation of the beam."""

import numpy as np
import pytest
from test_models import MODELS

import beamdae as bd

# Model: column to compare, end time [s].
COMPARED = {
    "hub_beam": ("tip.y [m]", 0.1),
    "slider_crank": ("slider.x [m]", 0.1),
    "pendulum": ("tip.y [m]", 0.1),
    "spin_up": ("tip.y [m]", 0.2),
    "four_bar": ("rocker.x [m]", 0.1),
    "leaf_spring_vehicle": ("axle.y [m]", 0.25),
    "sliding_mass": ("tip.y [m]", 0.1),
    "ring_mount": ("motor.y [m]", 0.05),
    "shallow_arch": ("crown.y [m]", 0.01),
    "active_damping": ("end.y [m]", 0.05),
    "inverted_pendulum": ("bob.x [m]", 0.1),
    "voice_coil_stage": ("platform.x [m]", 0.02),
}
WITHOUT_BEAMS = {"quick_return", "governor", "press"}


def test_every_model_with_a_beam_is_compared():
    assert set(COMPARED) == set(MODELS) - WITHOUT_BEAMS


def slow_beyond(count):
    marks = pytest.mark.slow
    return [
        pytest.param(name, marks=[marks] if k >= count else []) for k, name in enumerate(COMPARED)
    ]


@pytest.mark.parametrize("name", slow_beyond(2))
def test_exact_and_floating_frame_beams_agree(name):
    model, (column, t_end) = MODELS[name], COMPARED[name]
    floating, exact = (
        bd.simulate(model(formulation=formulation), bd.GeneralizedAlpha(1e-3), t_end).columns[
            column
        ]
        for formulation in ("floating frame", "exact")
    )
    travel = np.max(np.abs(exact - exact[0]))
    # Rotations relative to the frame change the strains: 1.4 % of this short motion for the hub
    # beam, at most 0.5 % for the others.
    assert 0.0 < np.max(np.abs(exact - floating)) < 0.02 * travel
