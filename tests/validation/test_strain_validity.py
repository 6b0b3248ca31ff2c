"""Errors of moderate strains in floating frames fall with the number of frames as stated."""

import numpy as np
import pytest
from strain_validity.statics import SECTION, cantilever, solve_exact_tips, solve_tips

import beamdae as bd

HALF_CIRCLE = (0.0, 0.0), np.pi * SECTION.EI


@pytest.mark.slow(reason="equilibria of eight cantilevers")
@pytest.mark.parametrize(
    ("frame", "order", "at_eight"), [("chord", 4.0, 3e-5), ("tangent", 3.0, 2e-3)]
)
def test_error_of_half_a_roll_up_falls_at_the_stated_order(frame, order, at_eight):
    axis, times = bd.Line((0.0, 0.0), (1.0, 0.0)), np.linspace(0.1, 1.0, 10)
    exact = solve_exact_tips(axis, *HALF_CIRCLE, times)[-1]
    tips = [
        solve_tips(cantilever(axis, *HALF_CIRCLE, bodies=n, frame=frame), times)[-1]
        for n in (2, 4, 8)
    ]
    errors = np.linalg.norm(tips - exact, axis=1) / np.linalg.norm(exact - axis.point(1.0))
    assert np.all(-np.diff(np.log2(errors)) > order)
    assert errors[-1] < at_eight
