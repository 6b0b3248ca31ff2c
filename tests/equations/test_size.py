"""Sizes, shapes and laws that are none are refused before anything is built of them."""

import math
import time

import casadi as ca
import numpy as np
import pytest
from spin_up import spin_up

import beamdae as bd
from beamdae import memory
from beamdae.beams.mesh import Mesh
from beamdae.equations.singular_laws import collect_varying_laws, require_no_pole

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
STRIP = bd.Section.rectangle(ALLOY, width=0.03, height=0.0025)
LINE = bd.Line((0.0, 0.0), (0.8, 0.0))


@pytest.mark.parametrize("elements", [10**7, 10**9, 10**15])
def test_regression_more_elements_than_there_is_memory_for_are_refused_at_once(elements):
    """Ten million died after 25 s, with the memory of the machine."""
    begin = time.perf_counter()
    with pytest.raises(
        bd.BeamdaeError,
        match=rf"^beam: a run of elements={elements} needs about .* GB of memory, .* GB are left; "
        r"take at most elements=\d+\.$",
    ):
        bd.Beam("beam", LINE, STRIP, elements=elements)
    assert time.perf_counter() - begin < 1.0


def test_what_is_said_to_fit_does(monkeypatch):
    monkeypatch.setattr(memory, "_free_physical_memory", lambda: 1e7)
    with pytest.raises(bd.BeamdaeError, match=r"take at most elements=37\.$"):
        bd.Beam("beam", LINE, STRIP, elements=38)
    assert bd.Beam("beam", LINE, STRIP, elements=37).mesh.elements == 37


def test_the_memory_there_is_is_known_or_has_no_bound():
    assert memory.available_memory() > 1e6


def test_a_limit_of_memory_is_heeded(monkeypatch):
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (10**15, 10**15))
    assert 1e14 < memory._free_address_space() < 1e15
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (1, 1))
    assert memory._free_address_space() in (0.0, math.inf)


@pytest.mark.parametrize("section", [STRIP, bd.Section.circle(ALLOY, 0.001)], ids=["strip", "wire"])
def test_regression_a_circle_of_one_chord_is_refused(section):
    """Its two nodes are one, and its length is nothing."""
    ring = bd.Arc(radius=0.3, length=2.0 * np.pi * 0.3)
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^ring: elements=1 of 2 nodes are too few for its curve, nodes \S+ m apart stand "
        r"for 1\.88 m of it; take more elements",
    ):
        bd.Beam("ring", ring, section, elements=1, nodes=2)


@pytest.mark.parametrize(("nodes", "elements"), [(2, 2), (2, 3), (3, 1), (4, 1)])
def test_a_circle_of_a_few_nodes_is_none_of_these(nodes, elements):
    ring = bd.Arc(radius=0.3, length=2.0 * np.pi * 0.3)
    assert bd.Beam("ring", ring, STRIP, elements=elements, nodes=nodes).mesh.nodes == nodes


def test_three_quarters_of_a_circle_in_one_chord_are_refused():
    arc = bd.Arc(radius=0.3, length=1.5 * np.pi * 0.3)
    with pytest.raises(bd.BeamdaeError, match="are too few for its curve"):
        Mesh(arc, 1, 2, "curved").require_resolved_curve("arc")


@pytest.mark.parametrize(
    ("second_moment", "area"), [(1e-70, 7.5e-5), (4e-11, 1e-70), (1e30, 1e-4), (1e-60, 1.0)]
)
def test_regression_a_section_that_is_none_beside_the_length_is_refused(second_moment, area):
    """Columns were no numbers."""
    section = bd.Section(ALLOY, area, second_moment)
    with pytest.raises(bd.BeamdaeError, match=r"^beam: second_moment .* and area .* radius of gyr"):
        bd.Beam("beam", LINE, section)


@pytest.mark.parametrize("angle", [1e50, -1e50, 1e20])
def test_regression_an_angle_of_nothing_but_rounding_is_refused(angle):
    with pytest.raises(bd.BeamdaeError, match=r"^Arc: angle must lie within 1e\+06 rad"):
        bd.Arc(radius=1.0, length=1.0, angle=angle)


class Pushed(bd.Part):
    """Nothing but a law."""

    name = "ball"

    def __init__(self, law):
        self.law = law

    @property
    def laws(self):
        return (self.law,)


@pytest.mark.parametrize("time_of_it", [math.nan, math.inf])
def test_regression_breakpoints_that_are_no_times_are_refused(time_of_it):
    def build():
        law = bd.Law((lambda t: 1.0, lambda t: 2.0), (time_of_it,))
        mech = bd.Mechanism()
        ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
        mech.add(bd.Force("push", ball.point, (law, 0.0)))
        return bd.equations_of_motion(mech)

    with pytest.raises(bd.BeamdaeError, match="breakpoints"):
        build()


@pytest.mark.parametrize("mass", [[-1.0, 1.0], [1.0, -1e-3], [[1.0, 0.0], [0.0, -1.0]]])
def test_a_negative_mass_is_refused(mass):
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    system = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=mass, force=[0.0, 1.0], q0=[0.0, 0.0], v0=[0.0, 0.0]
    )
    with pytest.raises(bd.BeamdaeError, match="mass matrix is negative"):
        bd.simulate(system, bd.GeneralizedAlpha(), 1.0)


def poles_of(law, intervals=((0.0, 1.0),)):
    require_no_pole(collect_varying_laws([Pushed(law)]), intervals)


def test_poles_are_found_wherever_they_are():
    for pole in np.random.default_rng(0).uniform(0.0, 1.0, 100):
        with pytest.raises(bd.BeamdaeError, match="ball: its law becomes infinite near t = 0"):
            poles_of(bd.Law((lambda t, pole=pole: 3.0 + 1.0 / (t - pole),)))


@pytest.mark.parametrize("pole", [0.0, 0.5, 1.0, 1.0 / 3.0])
@pytest.mark.parametrize("power", [1, 2, 3])
def test_poles_of_all_orders_are_found_at_looks_and_between(pole, power):
    with pytest.raises(bd.BeamdaeError, match=rf"near t = {pole:g}"):
        poles_of(bd.Law((lambda t: 1.0 / (t - pole) ** power,)))


@pytest.mark.parametrize(
    "law",
    [
        lambda t: 1.0 / ((t - 0.3) ** 2 + 1e-10),
        lambda t: np.exp(-(((t - 0.3) / 1e-6) ** 2)),
        lambda t: np.sqrt(0.2 - t),
        lambda t: t**0.5,
        lambda t: np.exp(500.0 * t),
        lambda t: 0.0 * t,
    ],
)
def test_peaks_roots_and_growth_are_no_poles(law):
    poles_of(bd.Law((law,)))


def test_regression_rounding_of_next_to_nothing_is_no_pole():
    """The spin-up of the published beam was refused for runs of less than a millisecond."""
    laws = bd.equations_of_motion(spin_up()).laws
    for end in (1e-6, 1e-5, 3e-4, 1e-2):
        require_no_pole(laws, ((0.0, end),))


def test_a_pole_on_a_piece_that_is_over_is_none():
    law = bd.Law((lambda t: 1.0 / (t - 0.6), lambda t: 1.0 / (t - 0.3)), (0.5,))
    poles_of(law, ((0.0, 0.5), (0.5, 1.0)))
    with pytest.raises(bd.BeamdaeError, match=r"near t = 0\.3 s; .* from t = 0 s to 1 s"):
        poles_of(law, ((0.0, 0.1), (0.1, 0.2), (0.2, 1.0)))
