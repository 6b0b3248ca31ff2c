"""Load control from positions in which only the stretched structure carries the loads."""

import numpy as np
import pytest
from mechanisms import hinged_beam
from scipy.optimize import brentq

import beamdae as bd

AXIAL_STIFFNESS, WEIGHT, LENGTH = 4.45e5, 1.46, 30.0  # N, N/m, m


def straight_cable(second_moment, angle=0.0, elements=20):
    """Return a cable drawn straight between two hinges."""
    area = 1e-5
    material = bd.Material(E=AXIAL_STIFFNESS / area, nu=0.3, rho=WEIGHT / 9.81 / area)
    end = (LENGTH * np.cos(angle), LENGTH * np.sin(angle))
    section = bd.Section(material, area, second_moment)
    mech, beam = hinged_beam(section, elements, end, name="cable", gravity=9.81, strain="exact")
    mech.add(bd.Revolute("B", mech.ground.at(*end), beam.end))
    mech.observe("middle", beam.at(LENGTH / 2))
    return mech


def sag(weight):
    """Return the sag of the elastic catenary between level supports (Irvine 1981)."""
    v = weight * LENGTH / 2

    def stretch(h):
        return h * LENGTH / AXIAL_STIFFNESS + 2 * h / weight * np.arcsinh(v / h) - LENGTH

    h = brentq(stretch, 1.0, 1e6)
    return v * LENGTH / (4 * AXIAL_STIFFNESS) + h / weight * (np.hypot(1.0, v / h) - 1.0)


# The smallest bending stiffness is 1e-15 of the axial one, beyond double precision.
@pytest.mark.parametrize("second_moment", [1e-11, 1e-12, 1e-14, 1e-20])
def test_straight_cable_hangs_in_a_catenary(second_moment):
    path = bd.equilibrium(straight_cable(second_moment))
    assert path.status.success
    assert path.unstable[-1] == 0
    # The interpolation of 20 elements, and the bending stiffness at the hinges, leave 4e-7.
    assert path["middle.y"].iloc[-1] == pytest.approx(-sag(WEIGHT), rel=2e-6)


@pytest.mark.slow(reason="several runs")
def test_path_of_a_straight_cable_is_continuous_through_each_target():
    path = bd.equilibrium(straight_cable(1e-12), to=[1e-3, 0.5, 1.0])
    middle = path["middle.y"]
    for factor in (0.5, 1.0):
        assert middle.loc[factor] == pytest.approx(-sag(factor * WEIGHT), rel=2e-6)
    assert np.all(np.diff(middle) < 0.0)
    assert np.max(np.abs(np.diff(middle))) < 0.1 * sag(WEIGHT)


@pytest.mark.slow(reason="several runs")
def test_inclined_cable_is_where_a_run_in_equilibrium_starts():
    mech = straight_cable(1e-12, angle=np.pi / 6)
    path = bd.equilibrium(mech)
    run = bd.simulate(mech, t_end=1e-4, start="equilibrium")
    assert path["middle.y"].iloc[-1] == pytest.approx(run["middle.y"].iloc[0], abs=1e-9)
