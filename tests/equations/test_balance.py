"""Energies of the rows of a run."""

import pytest
from mechanisms import G, swing
from numpy.testing import assert_allclose

import beamdae as bd


def test_regression_rates_of_states_are_no_forces():
    """Rates of states counted as forces: they caused false warnings, or hid residuals of bodies."""
    mech = bd.Mechanism()
    x, y = (mech.state(name, start=2.0) for name in "xy")
    x.follows(y)
    y.follows(10.0 * (1.0 - x * x) * y - x)
    assert bd.simulate(mech, bd.Radau(), t_end=5.0).warnings == ()


@pytest.mark.parametrize("method", [bd.GeneralizedAlpha(0.01), bd.Radau(1e-8), bd.Ida(1e-8)])
def test_energies_do_not_depend_on_the_other_rows(method):
    """Rows at steps, between them and at breakpoints have the energies of their states."""
    mech = swing()
    mech.add(bd.Force("push", mech.part("bob").at(1.0, 0.0), (bd.piecewise((0.05, 3.0), 0.0), 0)))
    few, many = (bd.simulate(mech, method, 0.4, output_step=x) for x in (0.1, 0.005))
    for name, values in few.energies.items():
        assert_allclose(values, many.energies[name][::20], rtol=1e-9, atol=1e-9)
    kinetic = 2.0 * (few.v[:, :2] ** 2).sum(axis=1) / 2.0 + 0.1 * few.v[:, 2] ** 2 / 2.0
    # Energies between steps are interpolated.
    assert_allclose(few.energies["energy.kinetic [J]"], kinetic, rtol=1e-7, atol=1e-14)
    gravity = few.energies["energy.gravity [J]"].to_numpy()
    assert_allclose(gravity - gravity[0], 2.0 * G * few.q[:, 1], rtol=1e-7, atol=1e-12)
