"""Stability of structures of different sizes in one model, which only the ground connects."""

import pytest
from mechanisms import rectangle
from numpy.testing import assert_allclose

import beamdae as bd


@pytest.mark.parametrize("damping", [0.0, 1e-5])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize("ratio", [10.0, 1e4, 1e-4])
def test_regression_flutter_of_a_column_does_not_depend_on_another_one(ratio, formulation, damping):
    """From 1:1000 on, the twelve slowest modes were those of the other column."""

    def beck(lengths):
        mech = bd.Mechanism()
        for k, length in enumerate(lengths):
            section = rectangle(length / 100, length / 20, damping=damping)
            foot = 2.0 * k * max(lengths)
            line = bd.Line((foot, 0.0), (foot, length))
            column = mech.add(bd.Beam(f"column {k}", line, section, 4, formulation=formulation))
            mech.add(bd.Weld(f"clamp {k}", mech.ground.at(foot, 0.0), column.start))
            if k == 0:
                force = (0.0, -section.EI / length**2)
                mech.add(bd.Force("push", column.end, force, axes="body"))
        return mech

    alone, beside = (bd.equilibrium(beck(lengths), to=25.0) for lengths in ([1.0], [1.0, ratio]))
    assert [point.kind for point in beside.critical] == ["flutter point"]
    # The load of Beck's column is 20.05 EI / l^2 without damping; material damping halves it.
    assert_allclose(beside.critical[0].factor, 20.05 if not damping else 10.93, rtol=2e-3)
    assert_allclose(beside.critical[0].factor, alone.critical[0].factor, rtol=1e-5)
    assert beside.unstable[-1] == 2
