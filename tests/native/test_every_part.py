"""Every public part runs in machine code: its kernels and the loops are compiled."""

from __future__ import annotations

from functools import partial

import pytest
from conformance import JOINTS, KINEMATICS, LOADS, NONHOLONOMIC
from support import ARC, SOFT_MATERIAL, VARIANTS

import beamdae as bd
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.integrators.compiled_run import StepLoop
from beamdae.integrators.ida.python_solver import SksundaeIda
from beamdae.native.lane_code import write_lane_module
from beamdae.native.object_code import is_native_enabled
from beamdae.parts.part import Part


def friction_in_guide(m, d, b):
    joint = m.add(bd.Prismatic("guide", m.ground.at(0.0, 0.0), d.at(0.5, 0.4)))
    return bd.Friction("j", joint, 0.3, friction_speed=1e-2, radius=0.1)


def lag_of_disk(m, d, b):
    x = m.sensor("x", d.at(0.5, 0.4), "x")
    return bd.State("lag", lambda lag, t: (x - lag) / 0.1)


def sampled_thrust(m, d, b):
    thrust = m.input("thrust", 0.3)
    m.add(bd.Force("jet", d.at(0.5, 0.4), (thrust, 0.0)))
    return bd.Controller("pilot", 1e-3, d.at(0.5, 0.4), thrust, lambda sample: -sample.reads[0])


PARTS = (
    JOINTS
    | NONHOLONOMIC
    | LOADS
    | {"friction": friction_in_guide, "state": lag_of_disk, "controller": sampled_thrust}
)


def with_part(make):
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(VARIANTS[2].beam(ARC, elements=1))
    mech.add(make(mech, disk, beam))
    return mech


def with_beam(kinematics):
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    section = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05, damping=0.03)
    mech.add(bd.Beam("beam", ARC, section, elements=1, kinematics=kinematics))
    return mech


def with_switch():
    """Disk and beam fall together for two thirds of a millisecond, and then apart."""
    mech = with_part(JOINTS["Revolute"])
    mech.observe("disk", mech.part("disk").at(0.5, 0.4))
    mech.when("disk.y_dot", -1e-3, "down", bd.deactivate(mech.part("j")), "cut")
    return mech


MODELS = {
    **{name: partial(with_part, make) for name, make in PARTS.items()},
    **{name: partial(with_beam, kinematics) for name, kinematics in KINEMATICS.items()},
}
# Kernels are shared between models; those of the beam take long.
CHECKED_FUNCTIONS: set = set()
# They have the kernels of others, with other numbers.
SHARED_KERNELS = {name for name in KINEMATICS if "section by a law" in name or "free shape" in name}
every_model = pytest.mark.parametrize(
    "model",
    [
        pytest.param(model, id=name, marks=[pytest.mark.slow] if name in SHARED_KERNELS else [])
        for name, model in MODELS.items()
    ],
)


def test_every_public_part_is_tested():
    tested = {type(part) for make in PARTS.values() for part in with_part(make).parts.values()}
    public = [getattr(bd, name) for name in bd.__all__]
    parts = {x for x in public if isinstance(x, type) and issubclass(x, Part)}
    base_classes = {Part, bd.Joint}
    assert parts - base_classes <= tested


@pytest.mark.slow(reason="a fifth of a second")
@every_model
def test_all_kernels_can_be_compiled(model):
    equations = bd.equations_of_motion(model())
    for form in (
        formulate_step(equations, False),
        formulate_first_order(equations, "stabilized-index1"),
    ):
        functions = {call.kernel.function for total in form.sums for call in total.batches}
        for function in functions - CHECKED_FUNCTIONS:
            # Raises if an operation is not supported.
            assert write_lane_module(function)
        CHECKED_FUNCTIONS.update(functions)


@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
def test_native_off_applies_only_while_it_is_set(monkeypatch):
    """Kernels belong to the structure of the equations, which similar models share."""
    form = formulate_first_order(bd.equations_of_motion(with_part(JOINTS["Revolute"])), "index3")
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    assert not form.is_native
    monkeypatch.delenv("BEAMDAE_NATIVE")
    assert form.is_native


@pytest.mark.slow(reason="kernels of all parts for all integrators are compiled")
@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(
    "model",
    [pytest.param(model, id=name) for name, model in {**MODELS, "switched": with_switch}.items()],
)
def test_runs_consist_of_compiled_loops(model, monkeypatch):
    runs, begin = [], StepLoop.__init__

    def record(self, *arguments):
        begin(self, *arguments)
        runs.append(self.is_native)

    def refuse(self, *_):
        raise AssertionError("IDA calls Python")

    monkeypatch.setattr(StepLoop, "__init__", record)
    monkeypatch.setattr(SksundaeIda, "__init__", refuse)
    equations = bd.equations_of_motion(model())
    for integrator in (bd.GeneralizedAlpha(1e-3), bd.Radau(), bd.Ida()):
        solution = bd.simulate(equations, integrator, 2e-3, output_step=1e-3)
        assert solution.status.success
    # Generalized-alpha and Radau; Ida would have warned.
    assert len(runs) >= 2
    assert all(runs)
