"""Every public part runs in machine code: its kernels are compiled, and so are the loops."""

from __future__ import annotations

import pytest
from conformance import JOINTS, LOADS, NONHOLONOMIC
from support import ARC, VARIANTS

import beamdae as bd
from beamdae.equations.formulations import first_order
from beamdae.equations.step_equations import step_equations
from beamdae.integrators.looping import Running
from beamdae.native.lane_code import lane_source
from beamdae.native.objects import is_on
from beamdae.parts.part import Part


def rubbing(m, d, b):
    joint = m.add(bd.Prismatic("guide", m.ground.at(0.0, 0.0), d.at(0.5, 0.4)))
    return bd.Friction("j", joint, 0.3, regularization=1e-2, radius=0.1)


PARTS = JOINTS | NONHOLONOMIC | LOADS | {"friction": rubbing}
# Kernels are shared; those of the beam are long.
TRIED: set = set()
every_part = pytest.mark.parametrize("make", PARTS.values(), ids=list(PARTS))


def with_part(make):
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(VARIANTS[2].beam(ARC, elements=1))
    mech.add(make(mech, disk, beam))
    return mech


def test_every_public_part_is_among_them():
    tried = {type(part) for make in PARTS.values() for part in with_part(make).parts.values()}
    public = [getattr(bd, name) for name in bd.__all__]
    parts = {x for x in public if isinstance(x, type) and issubclass(x, Part)}
    assert parts - {Part} <= tried


@every_part
def test_all_kernels_of_a_part_can_be_compiled(make):
    equations = bd.equations_of_motion(with_part(make))
    for form in (step_equations(equations, False), first_order(equations, "stabilized-index1")):
        functions = {call.kernel.function for total in form.sums for call in total.calls}
        for function in functions - TRIED:
            # It raises where there is an operation that cannot.
            assert lane_source(function)
        TRIED.update(functions)


@pytest.mark.slow(reason="kernels of all parts for all integrators are compiled")
@pytest.mark.skipif(not is_on(), reason="without machine code")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@every_part
def test_a_run_with_a_part_is_compiled_loops_alone(make, monkeypatch):
    runs, begin = [], Running.__init__

    def seen(self, *arguments):
        begin(self, *arguments)
        runs.append(self.is_native)

    monkeypatch.setattr(Running, "__init__", seen)
    equations = bd.equations_of_motion(with_part(make))
    for integrator in (bd.GeneralizedAlpha(1e-3), bd.Radau(), bd.Ida()):
        runs.clear()
        bd.simulate(equations, integrator, 2e-3, output_step=1e-3)
        assert runs, "there is no loop"
        assert all(runs)
