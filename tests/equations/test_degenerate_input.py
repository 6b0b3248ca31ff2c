"""Degenerate sizes and shapes, and models larger than memory, are rejected before assembly."""

import time

import numpy as np
import pytest
from mechanisms import rectangle, symbols

import beamdae as bd

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
STRIP = rectangle(0.0025, 0.03, material=ALLOY)
LINE = bd.Line((0.0, 0.0), (0.8, 0.0))


@pytest.mark.parametrize("elements", [10**7, 10**9, 10**15])
def test_regression_more_elements_than_fit_into_memory_are_rejected_at_once(elements):
    """Previously, ten million elements exhausted the memory of the machine after 25 s."""
    begin = time.process_time()
    with pytest.raises(
        bd.BeamdaeError,
        match=rf"^beam: a run with elements={elements} needs about .* GB of memory, but .*; "
        r"use at most elements=\d+\.$",
    ):
        bd.Beam("beam", LINE, STRIP, elements=elements)
    assert time.process_time() - begin < 1.0


@pytest.mark.parametrize("section", [STRIP, bd.Section.circle(ALLOY, 0.001)], ids=["strip", "wire"])
def test_regression_a_circle_of_one_chord_is_rejected(section):
    """Its two nodes coincide: the chord has length zero."""
    ring = bd.Arc(radius=0.3, length=2.0 * np.pi * 0.3)
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^ring: elements=1 with 2 nodes each are too few for the curve, where a polygon of "
        r"\S+ m through the nodes replaces an arc of 1\.88 m; use more elements",
    ):
        bd.Beam("ring", ring, section, elements=1, nodes=2)


@pytest.mark.parametrize(("nodes", "elements"), [(2, 2), (2, 3), (3, 1), (4, 1)])
def test_a_circle_of_a_few_nodes_is_accepted(nodes, elements):
    ring = bd.Arc(radius=0.3, length=2.0 * np.pi * 0.3)
    assert bd.Beam("ring", ring, STRIP, elements=elements, nodes=nodes).mesh.nodes == nodes


@pytest.mark.parametrize(
    ("second_moment", "area"), [(1e-70, 7.5e-5), (4e-11, 1e-70), (1e30, 1e-4), (1e-60, 1.0)]
)
def test_regression_a_degenerate_section_is_rejected(second_moment, area):
    """Previously, all columns of the run were nan."""
    section = bd.Section(ALLOY, area, second_moment)
    with pytest.raises(bd.BeamdaeError, match=r"^beam: second_moment .* and area .* radius of gyr"):
        bd.Beam("beam", LINE, section)


@pytest.mark.parametrize("angle", [1e50, -1e50, 1e20])
def test_regression_an_angle_lost_in_rounding_is_rejected(angle):
    with pytest.raises(
        bd.BeamdaeError, match=r"^Arc: angle must not exceed 1e\+06 rad in absolute value"
    ):
        bd.Arc(radius=1.0, length=1.0, angle=angle)


@pytest.mark.parametrize("mass", [[-1.0, 1.0], [1.0, -1e-3], [[1.0, 0.0], [0.0, -1.0]]])
def test_a_negative_mass_is_rejected(mass):
    t, q, v = symbols(2)
    system = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=mass, force=[0.0, 1.0], q0=[0.0, 0.0], v0=[0.0, 0.0]
    )
    with pytest.raises(bd.BeamdaeError, match="mass matrix has a negative eigenvalue"):
        bd.simulate(system, bd.GeneralizedAlpha(), 1.0)
