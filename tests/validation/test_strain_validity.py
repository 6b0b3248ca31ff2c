"""Range of validity of floating-frame strains: orders and predictions stated in the README."""

import numpy as np
import pytest
from strain_validity.run import EI, TIMES, create_curve
from strain_validity.statics import cantilever, solve_exact_tips, solve_tips_and_rotations

from beamdae.beams.floating_frame.strain_validity import strain_error_coefficients

FORCE, HALF_CIRCLE = ((0.0, 6.0 * EI), 0.0), ((0.0, 0.0), np.pi * EI)


def tip_errors(degrees, load, times, **settings):
    """Return the tip errors relative to the displacement, and the largest rotations [rad]."""
    axis = create_curve(degrees)
    exact = solve_exact_tips(axis, *load, times)
    tip, rotation = solve_tips_and_rotations(cantilever(axis, *load, **settings), times)
    return np.linalg.norm(tip - exact, axis=1) / np.linalg.norm(
        exact - axis.point(1.0), axis=1
    ), rotation


@pytest.mark.slow(reason="equilibria of eight cantilevers")
@pytest.mark.parametrize(
    ("frame", "order", "at_eight"), [("chord", 4.0, 3e-5), ("tangent", 3.0, 2e-3)]
)
def test_error_of_half_a_roll_up_falls_at_the_stated_order(frame, order, at_eight):
    errors = [tip_errors(0, HALF_CIRCLE, TIMES, bodies=n, frame=frame)[0][-1] for n in (2, 4, 8)]
    orders = -np.diff(np.log2(errors))
    assert np.all(orders > order)
    assert errors[-1] < at_eight


@pytest.mark.slow(reason="equilibria of eight cantilevers")
@pytest.mark.parametrize("degrees", [0, 60, 120])
@pytest.mark.parametrize("frame", ["chord", "tangent"])
@pytest.mark.parametrize("strain", ["green", "nonlinear"])
@pytest.mark.parametrize("load", [FORCE, HALF_CIRCLE], ids=["force", "moment"])
def test_errors_agree_with_their_prediction(degrees, frame, strain, load):
    times = np.array([0.003, 0.02, 0.08, 0.12])
    errors, rotation = tip_errors(degrees, load, times, bodies=1, frame=frame, strain=strain)
    first, second = strain_error_coefficients(strain, frame, np.radians(degrees))
    predicted = first * rotation + second * rotation**2
    # Smaller errors are dominated by the mesh and the reference.
    in_range = (predicted > 3e-3) & (predicted < 0.3)
    assert np.all(errors[in_range] < 3.0 * predicted[in_range])
    assert np.all(errors[in_range] > predicted[in_range] / 30.0)
