"""Equilibria of slender structures: very soft in bending, but not free to move."""

import numpy as np
import pytest

import beamdae as bd


def strip(elements, height, joint=bd.Weld, **options):
    """Return a horizontal steel strip of 1 m on a joint, under its weight."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=height)
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements, **options))
    mech.add(joint("support", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


FORMULATIONS = pytest.mark.parametrize(
    "options", [{"formulation": "exact"}, {"strain": "exact"}], ids=["exact", "floating frame"]
)


@FORMULATIONS
@pytest.mark.filterwarnings("error::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(("elements", "height"), [(10, 5e-5), (20, 1e-4)])
def test_thin_strip_is_not_free(options, elements, height):
    # Its bending stiffness is at most 1e-12 of the axial stiffness of an element.
    path = bd.equilibrium(strip(elements, height, **options), to=1e-4)
    assert path.status.success
    assert path.stable
    # rho A g L^4 / (8 EI) under 1e-4 of the weight.
    steel = bd.Material.of("steel")
    expected = -1e-4 * 9.81 * steel.rho / (8.0 * steel.E * height**2 / 12.0)
    assert path.columns["tip.y [m]"][-1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow(reason="half a second and more")
@FORMULATIONS
def test_hinged_strip_hangs_down(options):
    # The model exceeds the limit for dense matrices; the frame rotates without stiffness.
    path = bd.equilibrium(strip(20, 1e-2, joint=bd.Revolute, **options))
    assert path.stable
    assert path.columns["tip.y [m]"][-1] == pytest.approx(-1.0, abs=1e-5)


def flutter_column(height, damping=0.0, **options):
    """Return a cantilever of 1 m under a follower load of EI / L^2 that compresses it."""
    mech, steel = bd.Mechanism(), bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=height, damping=damping)
    line = bd.Line((0.0, 0.0), (0.0, 1.0))
    beam = mech.add(bd.Beam("column", line, section, 8, **options))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("press", beam.end, (0.0, -section.EI), axes="body"))
    return mech


@pytest.mark.slow(reason="half a second each")
@FORMULATIONS
@pytest.mark.parametrize(("height", "damping"), [(1e-4, 0.0), (1e-5, 0.0), (1e-5, 1.0)])
def test_flutter_load_of_thin_column(options, height, damping):
    steel = bd.Material.of("steel")
    # Retardation time over the time sqrt(m L^4 / EI) of the column.
    time = np.sqrt(12.0 * steel.rho / steel.E) / height
    mech = flutter_column(height, damping * 1e-3 * time, **options)
    path = bd.equilibrium(mech, loads=["press"], to=21.0 - 9.0 * damping)
    (point,) = path.critical
    assert point.kind == "flutter point"
    # Beck (1952), and Bolotin and Zhinzher (1969) with these numbers of the characteristic
    # equation; 2e-6 for the mesh, and rounding of the axial force.
    expected = 10.93912199 if damping else 20.0509536
    assert point.factor == pytest.approx(expected, rel=3e-6 + 5e-15 / height**2)


@pytest.mark.slow(reason="half a second each")
@FORMULATIONS
@pytest.mark.parametrize("height", [1e-4, 1e-5])
def test_fluid_pressure_of_thin_quarter_ring(options, height):
    # M. Levy (1884): 3 EI / R^3.
    mech, steel = bd.Mechanism(), bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=height)
    arc = bd.Arc(1.0, 0.5 * np.pi, start=(1.0, 0.0), angle=0.5 * np.pi)
    ring = mech.add(bd.Beam("ring", arc, section, 8, **options))
    mech.add(bd.Prismatic("side", mech.ground.at(1.0, 0.0), ring.start, (1.0, 0.0)))
    mech.add(bd.Prismatic("top", mech.ground.at(0.0, 1.0), ring.end, (0.0, 1.0)))
    mech.add(bd.DistributedForce("pressure", ring, (0.0, section.EI), axes="section"))
    path = bd.equilibrium(mech, to=4.0)
    (point,) = path.critical
    assert point.kind == "branch point"
    assert point.factor == pytest.approx(3.0, rel=1e-5 + 5e-15 / height**2)
    assert path.unstable[-1] == 1


@pytest.mark.slow(reason="half a second")
def test_follower_loads_do_not_make_a_free_rotation_grow():
    # Rounding of its stiffness, which is zero, must not be taken for an instability.
    mech, steel = bd.Mechanism(), bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=1e-4)
    line = bd.Line((0.0, 0.0), (0.0, 1.0))
    beam = mech.add(bd.Beam("rocket", line, section, 8, formulation="exact"))
    for name, end, sign in (("thrust", beam.start, 1.0), ("drag", beam.end, -1.0)):
        mech.add(bd.Force(name, end, (0.0, sign * section.EI), axes="body"))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    path = bd.equilibrium(mech, to=1.0)
    assert path.status.success
    assert path.unstable[-1] == 0
