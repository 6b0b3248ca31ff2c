"""Bent beams with closed forms or published answers, by the exact formulation.

Numbers are those of the sources named at each test.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from reach.statics import path
from support import Numeric

import beamdae as bd
from beamdae.equations import measures

pytestmark = pytest.mark.filterwarnings("ignore")


def section(EI, EA=None, GA=None):
    """A section by its stiffnesses; stiff in what is not given."""
    EA, GA = EA or 1e6 * EI, GA or 1e6 * EI
    material = bd.Material(E=EA, nu=0.0, rho=1.0)
    return bd.Section(material, 1.0, second_moment=EI / EA, shear_coefficient=2.0 * GA / EA)


def cantilever(length, own, force=(0.0, 0.0), moment=0.0, elements=8, **settings):
    """A straight beam clamped at the origin; its end loads grow with time."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (length, 0.0))
    settings = {"formulation": "exact"} | settings
    beam = mech.add(bd.Beam("beam", line, own, elements, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    fx, fy = force
    mech.add(bd.Force("force", beam.end, (lambda t: fx * t, lambda t: fy * t)))
    mech.add(bd.Moment("moment", beam.end, lambda t: moment * t))
    mech.observe("tip", beam.end)
    mech.observe("root", beam.section_forces(0.0))
    return mech


def equilibria(mech, times):
    """Observed rows of equilibrium at these load parameters."""
    equations = bd.equations_of_motion(mech)
    q = path(equations, np.asarray(times, float))
    assert len(q) == len(times)
    zeros = np.zeros((len(q), 2)), np.zeros_like(q), np.zeros((len(q), equations.m))
    return measures.ObservedRows(equations)(zeros[0], q, zeros[1], zeros[1], zeros[2])


# B1 ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strain", [None, "exact"], ids=["exact beam", "exact strain in a frame"])
@pytest.mark.parametrize("turns", [1, 2])
def test_a_moment_rolls_a_beam_up_to_circles(turns, strain):
    """M = 2 pi n EI / L: the tip comes back to the clamp."""
    words = (
        {}
        if strain is None
        else {
            "formulation": "floating frame",
            "strain": strain,
            "frame": "tangent",
        }
    )
    own = section(EI=1.0, EA=1e4, GA=4e3)
    mech = cantilever(1.0, own, moment=2.0 * np.pi * turns, elements=8 * turns, **words)
    tip = equilibria(mech, np.linspace(0.0, 1.0, 8 * turns + 1)[1:])[-1]
    assert_allclose(tip[:2], 0.0, atol=2e-5)
    assert_allclose(tip[2], 2.0 * np.pi * turns, rtol=1e-12)


# B2 ---------------------------------------------------------------------------------------------

# P L^2 / EI: shortening and deflection of the tip over L, its slope [rad], M L / EI at the clamp.
# K. Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145, by elliptic integrals.
ELASTICA = {
    1: (0.05643, 0.30172, 0.461352, 0.94356676),
    2: (0.16064, 0.49346, 0.781750, 1.67871656),
    3: (0.25442, 0.60325, 0.986017, 2.23673945),
    4: (0.32894, 0.66996, 1.121239, 2.68423503),
    5: (0.38763, 0.71379, 1.215368, 3.06185820),
    6: (0.43459, 0.74457, 1.283697, 3.39246703),
    7: (0.47293, 0.76737, 1.334960, 3.68950800),
    8: (0.50483, 0.78498, 1.374432, 3.96137814),
    9: (0.53182, 0.79906, 1.405465, 4.21361494),
    10: (0.55500, 0.81061, 1.430286, 4.45004402),
}


def test_the_elastica_under_a_dead_load_to_the_digits_of_the_table():
    # Inextensible and stiff in shear to 1e-8 of the load.
    mech = cantilever(1.0, section(1.0, 1e8, 1e8), force=(0.0, 10.0))
    found = equilibria(mech, np.arange(1, 11) / 10.0)
    x, y, angle = found[:, :3].T
    table = np.array(list(ELASTICA.values()))
    # Half a unit of the last digit of the table, and 5e-6 of the mesh.
    assert_allclose(1.0 - x, table[:, 0], atol=1e-5)
    assert_allclose(y, table[:, 1], atol=1e-5)
    assert_allclose(angle, table[:, 2], atol=1e-5)
    # Positive M lengthens the left side, the upper one. At an end it is extrapolated from the
    # quadrature points, of order 3; the equilibrium of the beam gives it as the lever of the tip.
    assert_allclose(-found[:, -1], table[:, 3], rtol=5e-4)
    assert_allclose(np.arange(1, 11) * x, table[:, 3], rtol=1e-5)


# B3 ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("GA", "tip"),
    [
        # Exudyn, pythonDev/Examples/ANCFcantileverTest.py, converged; the same by shooting.
        (np.inf, (-0.508537304326, -1.207239854550)),
        # With the shear of a square, by shooting.
        (
            2.07e11 / 2.6 * 0.01 * (10.0 * 1.3) / (12.0 + 11.0 * 0.3),
            (-0.509464717745, -1.208822829560),
        ),
    ],
    ids=["Bernoulli-Euler", "Timoshenko"],
)
def test_a_cantilever_of_exudyn(GA, tip):
    EI, EA = 2.07e11 * 0.1**4 / 12.0, 2.07e11 * 0.01
    own = section(EI, EA, min(GA, 1e6 * EA))
    mech = cantilever(2.0, own, force=(0.0, -3.0 * EI / 4.0), elements=16)
    x, y = equilibria(mech, np.linspace(0.0, 1.0, 5)[1:])[-1, :2]
    assert_allclose((x - 2.0, y), tip, rtol=1e-6)


# B6 ---------------------------------------------------------------------------------------------


def test_a_cantilever_of_geradin_and_cardona():
    """M. Geradin, A. Cardona, Flexible Multibody Dynamics (Wiley 2001); SHARPy, tests/xbeam."""
    mech = cantilever(5.0, section(9.346e6, 4.8e8, 3.231e8), force=(0.0, -600e3))
    x, y, angle = equilibria(mech, np.linspace(0.0, 1.0, 5)[1:])[-1, :3]
    # Published: -2.159, 0.596, 0.6720; more digits by shooting.
    assert_allclose((y, 5.0 - x, -angle), (-2.1596938945, 0.5964712722, 0.6720060638), rtol=2e-6)


# B13 --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slenderness", [4, 100, 2500])
def test_a_pinched_ring(slenderness):
    """Castigliano's theorem on a quarter of it, small displacements."""
    radius = 2.0
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7800.0)
    x = bd.Section.rectangle(steel, width=radius / slenderness, height=radius / slenderness)
    quarter = bd.Arc(radius, 0.5 * np.pi * radius, start=(radius, 0.0), angle=0.5 * np.pi)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("ring", quarter, x, 8, formulation="exact"))
    side, top = beam.start, beam.end
    mech.add(bd.Prismatic("side", mech.ground.at(radius, 0.0), side, (1.0, 0.0)))
    mech.add(bd.Prismatic("top", mech.ground.at(0.0, radius), top, (0.0, 1.0)))
    load = 1e-3 * x.EI / radius**2
    mech.add(bd.Force("load", top, (0.0, -0.5 * load)))
    numeric = Numeric(mech)
    moved = small_displacement(numeric)
    first, last = moved.reshape(-1, 3)[[0, -1]]
    flexible = load * radius**3 / x.EI, 0.5 * load * radius / x.EA, 0.5 * load * radius / x.GA
    approach = flexible[0] * (np.pi / 4.0 - 2.0 / np.pi) + 0.5 * np.pi * (flexible[1] + flexible[2])
    growth = flexible[0] * (2.0 / np.pi - 0.5) - flexible[1] + flexible[2]
    # Half of each on either side; the mesh leaves 2e-6.
    assert_allclose((-2.0 * last[1], 2.0 * first[0]), (approach, growth), rtol=5e-6)


def small_displacement(numeric):
    """Change of the coordinates under the loads, to first order."""
    stiffness, joint = numeric.stiffness(), numeric.constraint_matrix()
    saddle = np.block([[stiffness, joint.T], [joint, np.zeros((numeric.m, numeric.m))]])
    diagonal = np.sqrt(np.abs(np.diag(saddle)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    right = np.concatenate([-numeric.force(), np.zeros(numeric.m)]) / scale
    return (np.linalg.solve(saddle / np.outer(scale, scale), right) / scale)[: numeric.n]
