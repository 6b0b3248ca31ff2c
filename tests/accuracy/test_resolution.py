"""Tails of strains measure the resolution of beams, and determine the next mesh."""

from itertools import pairwise

import pytest

import beamdae as bd
from beamdae.beams.mesh import Mesh
from beamdae.beams.resolution import measure_tail, next_mesh

ALLOY = bd.Material(E=7e10, nu=0.33, rho=2700.0)
STRIP = bd.Section.rectangle(ALLOY, width=0.02, height=0.004)
ARC = bd.Arc(radius=0.5, length=0.9)


def sag(nodes, formulation, gravity=9.81):
    """Return the kinematics of a clamped arc of one element, and its equilibria under weight."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    mesh = {"elements": 1, "nodes": nodes, "formulation": formulation}
    beam = mech.add(bd.Beam("arm", ARC, STRIP, **mesh))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    return beam.kinematics, bd.equilibrium(mech).q


@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_tails_decrease_with_the_degree(formulation):
    tails = [measure_tail(*sag(nodes, formulation)) for nodes in (4, 6, 8, 10)]
    assert [x.degree for x in tails] == [3, 5, 7, 9]
    assert all(b.fiber < 0.3 * a.fiber for a, b in pairwise(tails))
    assert all(b.shear < 0.3 * a.shear for a, b in pairwise(tails))


@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_tails_of_small_displacements_need_a_state(formulation):
    kinematics, q = sag(8, formulation, gravity=1e-2)
    about = kinematics.initial_position
    # Like mode shapes, displacements have any size. Without initial strains, nothing is subtracted.
    tail = measure_tail(kinematics, q[-1:], about)
    assert tail.fiber == pytest.approx(measure_tail(kinematics, q[-1:]).fiber, rel=1e-6)
    assert measure_tail(kinematics, about[None], about).fiber == 0.0


def test_the_next_mesh_has_a_higher_degree_or_more_elements():
    kinematics, q = sag(6, "exact")
    tail, mesh = measure_tail(kinematics, q), Mesh(ARC, 1, 6, "curved")
    assert next_mesh(mesh, tail, 1.1 * tail.force_error) is mesh
    assert next_mesh(mesh, tail, 1.1 * tail.motion_error, forces=False) is mesh
    finer = next_mesh(mesh, tail, 0.1 * tail.force_error)
    assert finer.elements == 1
    assert 6 < finer.nodes <= 13
    split = next_mesh(mesh, tail, 1e-12)
    assert split.nodes == 9
    assert split.elements > 1
