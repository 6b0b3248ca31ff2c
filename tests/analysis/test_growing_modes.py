"""Flutter points of slender columns under follower loads."""

import numpy as np
import pytest

import beamdae as bd
from beamdae.analysis.statics.stability import Stability


@pytest.mark.slow(reason="two seconds")
def test_regression_flutter_of_slender_columns_is_not_found_late():
    # Growth that rounding does not explain began at 2e-5 of the load beyond flutter (L/h = 1e5).
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 1e-5)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), (1.0, 0.0)), section, 16, strain="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))

    def drag(s, x, y, t):
        return -section.EI * (1.0 - s), 0.0 * s

    mech.add(bd.DistributedForce("drag", beam, drag, axes="section"))
    (point,) = bd.equilibrium(mech, to=166.0).critical
    assert point.kind == "flutter point"
    # W. Hauger, Ing.-Arch. 35 (1966) 221.
    assert point.factor == pytest.approx(150.64160, rel=5e-6)


def test_discriminant_of_two_vibrations_changes_its_sign_where_they_coincide():
    def stability(*squares):
        none = np.zeros((2, 0))
        return Stability(np.zeros(0), none, 0, squares=np.array(squares, complex))

    assert stability(-4.0, -1.0, -9.0).discriminant(-2.0) == pytest.approx(9.0)
    assert stability(-2.5 + 0.5j, -9.0, -2.5 - 0.5j).discriminant(-2.5) == pytest.approx(-1.0)
    assert np.isnan(stability(-4.0).discriminant(-4.0))
