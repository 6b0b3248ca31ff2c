"""Pan & Liu (2012): printed appendix and eq. (22) against their derivation and beamdae."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pan_liu_2012 import appendix, run


@cache
def terms():
    return appendix.compare_terms()["appendix"].set_index("term")


def test_the_table_is_the_stored_one():
    stored = run.read_tables()["appendix"].set_index("term")
    assert list(terms().index) == list(stored.index)
    for header in stored:
        if stored[header].dtype.kind == "f":
            # Rounding, 1e-13, beside misprints of a tenth and more.
            assert_allclose(terms()[header], stored[header], rtol=1e-6, atol=1e-9, err_msg=header)
        else:
            assert list(terms()[header]) == list(stored[header].fillna("")), header


def test_corrected_terms_follow_from_the_papers_kinematics():
    assert terms()[appendix.CORRECTED_COLUMN].max() < appendix.ROUNDING_TOLERANCE
    wrong = terms().index[terms()[appendix.PRINTED_COLUMN] > appendix.ROUNDING_TOLERANCE]
    assert list(wrong) == ["Q_r", "Q_p", "f_theta", "f_p", "f_s"]
    assert list(terms().index[terms()[appendix.MISPRINT_COLUMN] != ""]) == list(wrong)


def test_beamdae_differs_from_the_appendix_by_consistent_rotary_inertia_alone():
    assert terms()[appendix.CODE_COLUMN].max() < appendix.ROUNDING_TOLERANCE
    rotary = terms().index[terms()[appendix.ROTARY_COLUMN] > appendix.ROUNDING_TOLERANCE]
    assert list(rotary) == ["M_thetatheta", "M_thetap", "Q_theta", "Q_p"]


@pytest.mark.parametrize("offset", [False, True], ids=["eq-8", "consistent"])
def test_kinetic_energy_of_moving_points(offset):
    """Rotary part: rho I (phi'^2 + phi^2 theta'^2)/2; consistent: rho I (theta' + phi')^2/2."""
    state = appendix.random_state()
    A, omega, p, p_dot = state.motion
    rho, section = appendix.SECTION.material.rho, appendix.SECTION
    expected = 0.0
    for x in appendix.gauss_points():
        s = x.s0 + x.A_alpha @ x.N[:2] @ p
        relative = A @ x.A_alpha @ x.N[:2] @ p_dot
        velocity = state.v[:2] + omega * appendix.QUARTER_TURN @ A @ s + relative
        phi, phi_dot = x.N[2] @ p, x.N[2] @ p_dot
        spin2 = (omega + phi_dot) ** 2 if offset else phi_dot**2 + phi**2 * omega**2
        per_length = section.area * velocity @ velocity + section.second_moment * spin2
        expected += 0.5 * rho * x.weight * x.J * per_length
    m = appendix.derived_terms(state, np.zeros(2), offset)
    r = state.v[:2]
    energy = 0.5 * (r @ m["M_rr"] @ r + m["M_thetatheta"] * omega**2 + p_dot @ m["M_pp"] @ p_dot)
    energy += r @ m["M_rtheta"] * omega + r @ m["M_rp"] @ p_dot + omega * m["M_thetap"] @ p_dot
    # The same sum in another order, so only rounding differs.
    assert_allclose(energy, expected, rtol=1e-12)
