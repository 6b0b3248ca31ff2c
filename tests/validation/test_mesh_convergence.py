"""Mesh convergence of the hub beam, 60 degrees: the orders stated in the README."""

import numpy as np
import pytest
from formulations.mesh_convergence import ELEMENTS, compute_mesh_errors, compute_orders


@pytest.mark.slow(reason="eight runs of the hub beam a variant")
@pytest.mark.parametrize(
    ("parameters", "order", "at_eight"),
    [
        # Interpolation by cubic elements is of order 4; reduced integration of the membrane terms
        # gains more than one order until time errors dominate.
        ({"quadrature": "reduced"}, 5.0, 1e-5),
        ({"quadrature": "full"}, 4.5, 1e-3),
        # "local" continuity ignores the kink between interpolated axes: O(h^3) per node, O(h^2) in
        # total.
        ({"quadrature": "reduced", "continuity": "local"}, 1.8, 1.5e-3),
        ({"quadrature": "reduced", "elements_shape": "straight"}, 1.9, 4e-2),
    ],
    ids=["reduced", "full", "local", "straight"],
)
def test_error_of_the_tip_falls_at_the_stated_order(parameters, order, at_eight):
    errors = compute_mesh_errors(ELEMENTS, **parameters)
    assert np.all(np.diff(errors) < 0.0)
    orders = compute_orders(ELEMENTS, errors)
    assert np.mean(orders[-3:]) > order - 0.3
    assert errors[ELEMENTS.index(8)] < at_eight


@pytest.mark.slow(reason="eight runs of the hub beam a variant")
def test_curved_elements_need_a_third_of_the_straight_ones():
    curved = compute_mesh_errors((4,), quadrature="reduced")
    straight = compute_mesh_errors((12,), quadrature="reduced", elements_shape="straight")
    assert curved[0] < straight[0]
