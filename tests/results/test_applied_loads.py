"""The loads on a beam, from any part, balance its inertia."""

import numpy as np
import pytest
from conformance import JOINTS, KINEMATICS, LOADS
from support import ARC, SOFT_MATERIAL

import beamdae as bd
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.results.section_forces.applied_loads import collect_applied_loads

SECTION = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05, damping=0.03)
PARTS = JOINTS | LOADS
FRAME, NODES = "chord frame, Green's strain", "nodes"
# One part per distribution of loads: at points, per length, over nodes, on elements.
KINDS = ("slider on a beam", "spring within a beam", "pressure", "sliding in the span", "AirDrag")


def collect_loads(make, kind, shape="curved", nodes=4):
    """Return a beam and the loads on it at random positions and velocities."""
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    kinematics = KINEMATICS[kind]
    settings = {"elements_shape": shape, "nodes": nodes}
    beam = bd.Beam("beam", ARC, SECTION, 2, kinematics=kinematics, **settings)
    mech.add(beam)
    if make is not None:
        mech.add(make(mech, disk, beam))
    e = bd.equations_of_motion(mech)
    rng = np.random.default_rng(0)
    q, v = e.q0 + 0.05 * rng.standard_normal(e.n), rng.standard_normal(e.n)
    time = np.array([0.7, 0.7])
    a, lam = ConsistencySolver(e).acceleration(time, q, v)
    state = State(q[None], v[None], a[None], lam[None])
    return beam, collect_applied_loads(beam, e, time[None], state)


def assert_balanced(make, kind, shape="curved", off=1e-11, nodes=4):
    beam, loads = collect_loads(make, kind, shape, nodes)
    line_loads = np.einsum("rekc,k->rec", loads.line_loads, gauss_points(beam.mesh.nodes)[1])
    parts = np.concatenate([line_loads, loads.wrenches], axis=1)[0]
    np.testing.assert_allclose(parts.sum(axis=0), 0.0, atol=off * np.max(np.abs(parts)))
    return loads


@pytest.mark.parametrize(
    ("kind", "shape"),
    [*((kind, "curved") for kind in KINEMATICS), (FRAME, "straight"), (NODES, "straight")],
)
def test_weight_balances_inertia(kind, shape):
    loads = assert_balanced(None, kind, shape)
    assert not loads.wrenches.size


@pytest.mark.parametrize("kind", [FRAME, NODES])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in KINDS else [pytest.mark.slow])
        for name in PARTS
        if name not in ("Rayleigh", "RayleighDamping")
    ],
)
def test_loads_of_each_part_balance_inertia(name, kind):
    assert_balanced(PARTS[name], kind)


@pytest.mark.slow
def test_rayleigh_damping_balances_inertia():
    assert_balanced(LOADS["Rayleigh"], NODES)
    # In a floating frame its strain rates are linear, so that its moments do not balance exactly.
    assert_balanced(LOADS["Rayleigh"], FRAME, off=1e-2)


@pytest.mark.parametrize("kind", [FRAME, NODES])
@pytest.mark.parametrize("nodes", [3, 5])
def test_loads_on_elements_with_a_gauss_point_at_a_node(nodes, kind):
    """Regression: loads on elements of an odd number of nodes were errors in a floating frame."""
    for name in ("AirDrag", "pressure"):
        assert_balanced(PARTS[name], kind, nodes=nodes)
