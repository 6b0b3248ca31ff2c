"""Pan & Liu (2012): the printed appendix and eq. (22) against their derivation and beamdae."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from pan_liu_2012 import appendix, appendix_claims

RESULTS = Path(__file__).parents[2] / "validation" / "pan_liu_2012" / "results"


@cache
def terms():
    return appendix_claims.table()["appendix"].set_index("term")


def test_the_table_is_the_stored_one():
    known = pd.read_csv(RESULTS / "appendix.csv").set_index("term")
    assert list(terms().index) == list(known.index)
    for header in known:
        if known[header].dtype.kind == "f":
            # Rounding, 1e-13, beside misprints of a tenth and more.
            assert_allclose(terms()[header], known[header], rtol=1e-6, atol=1e-9, err_msg=header)
        else:
            assert list(terms()[header]) == list(known[header].fillna("")), header


def test_corrected_it_is_the_papers_kinematics():
    assert terms()[appendix_claims.CORRECTED].max() < appendix_claims.SAME
    wrong = terms().index[terms()[appendix_claims.PRINTED] > appendix_claims.SAME]
    assert list(wrong) == ["Q_r", "Q_p", "f_theta", "f_p", "f_s"]
    assert list(terms().index[terms()[appendix_claims.LACKS] != ""]) == list(wrong)


def test_beamdae_has_the_consistent_rotary_inertia_and_all_else_of_the_appendix():
    assert terms()[appendix_claims.CODE_APART].max() < appendix_claims.SAME
    rotary = terms().index[terms()[appendix_claims.ROTARY_APART] > appendix_claims.SAME]
    assert list(rotary) == ["M_thetatheta", "M_thetap", "Q_theta", "Q_p"]


@pytest.mark.parametrize("offset", [False, True], ids=["eq-8", "consistent"])
def test_moving_points_have_the_kinetic_energy_they_are_said_to_have(offset):
    """rho I (phi'^2 + phi^2 theta'^2)/2 by eq. (8), rho I (theta' + phi')^2/2 consistently."""
    state = appendix_claims.random_state()
    A, omega, p, p_dot = state.motion
    rho, section = appendix.SECTION.material.rho, appendix.SECTION
    expected = 0.0
    for x in appendix.points():
        s = x.s0 + x.A_alpha @ x.N[:2] @ p
        moved = A @ x.A_alpha @ x.N[:2] @ p_dot
        velocity = state.v[:2] + omega * appendix.QUARTER @ A @ s + moved
        phi, phi_dot = x.N[2] @ p, x.N[2] @ p_dot
        spin2 = (omega + phi_dot) ** 2 if offset else phi_dot**2 + phi**2 * omega**2
        per_length = section.area * velocity @ velocity + section.second_moment * spin2
        expected += 0.5 * rho * x.weight * x.J * per_length
    m = appendix.derived(state, np.zeros(2), offset)
    r = state.v[:2]
    found = 0.5 * (r @ m["M_rr"] @ r + m["M_thetatheta"] * omega**2 + p_dot @ m["M_pp"] @ p_dot)
    found += r @ m["M_rtheta"] * omega + r @ m["M_rp"] @ p_dot + omega * m["M_thetap"] @ p_dot
    # The same sum in another order: rounding.
    assert_allclose(found, expected, rtol=1e-12)
