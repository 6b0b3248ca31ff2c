"""Static equations of a load stage: machine code, load factor, bordered solution."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.statics import bordered_system
from beamdae.analysis.statics.bordered_system import BorderedSystem
from beamdae.analysis.statics.load_scaling import build_loading
from beamdae.linear.factorizations import SingularMatrixError


def loaded_arch(formulation):
    """Return the loaded equations of an arch under its weight, a force and a moment."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    arc = bd.Arc(radius=-0.5, length=1.2, angle=0.9)
    beam = mech.add(bd.Beam("arch", arc, strip, 3, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(*beam.start.point), beam.start))
    mech.add(bd.Revolute("hinge", mech.ground.at(*beam.end.point), beam.end))
    mech.add(bd.Force("force", beam.at(0.4), (3.0, -20.0)))
    mech.add(bd.Force("constant", beam.at(0.4), (1.0, 5.0)))
    loading = build_loading(mech, bd.equations_of_motion(mech), ["gravity", "force"], 0.0)
    return loading.systems[0]


def random_unknowns(e):
    """Return unknowns near the start and the gradient of a control."""
    random = np.random.default_rng(3)
    x = np.append(e.q0, np.zeros(e.m)) + 1e-3 * random.standard_normal(e.n + e.m)
    return x, (random.standard_normal(e.n + e.m), 0.7)


def compile_now(monkeypatch):
    """Let systems compile their kernels at the first iteration."""
    monkeypatch.setenv("BEAMDAE_NATIVE", "on")
    monkeypatch.setattr(bordered_system, "_COORDINATE_SECONDS", np.inf)


FORMULATIONS = pytest.mark.parametrize("formulation", ["exact", "floating frame"])


@FORMULATIONS
def test_forces_and_tangent_are_linear_in_the_load_factor(formulation):
    system, mu = loaded_arch(formulation), 0.3
    e = system.equations
    x, _ = random_unknowns(e)
    q, lam = x[: e.n], x[e.n :]
    ends = [static.residual(q, lam) for static in (system.unloaded, system.loaded)]
    forces, by_factor = system.residual(x, mu)
    size = np.max(np.abs(ends))
    assert_allclose(forces, 0.7 * ends[0] + 0.3 * ends[1], atol=1e-14 * size)
    assert_allclose(by_factor, ends[1] - ends[0], atol=1e-14 * size)
    expected = sum(
        share * static.matrix(q, lam).toarray()
        for share, static in ((0.7, system.unloaded), (0.3, system.loaded))
    )
    tangent = system.matrix(system.tangent(x, mu)).toarray()
    assert_allclose(tangent, expected, atol=1e-14 * np.max(np.abs(expected)))


@FORMULATIONS
def test_only_what_the_loads_change_is_evaluated_twice(formulation):
    bordered = loaded_arch(formulation).bordered
    run = bordered._loop.work
    # Weight and point loads differ; joints do not.
    for part in (run.unloaded, run.loaded):
        assert len(part.residual.batches) == 2
    assert len(run.common.residual.batches) == 2


@FORMULATIONS
def test_machine_code_agrees_with_the_virtual_machine(formulation, monkeypatch):
    system = loaded_arch(formulation)
    e = system.equations
    x, gradient = random_unknowns(e)
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    interpreted = BorderedSystem(system.unloaded.equations, e, np.zeros(2))
    expected = interpreted.newton_change(x, 0.3, gradient, 0.02)
    assert not interpreted.is_native
    matrix = interpreted.tangent(x, 0.3)
    compile_now(monkeypatch)
    native = BorderedSystem(system.unloaded.equations, e, np.zeros(2))
    change = native.newton_change(x, 0.3, gradient, 0.02)
    assert native.is_native
    assert np.array_equal(native.tangent(x, 0.3), matrix)
    # The condition number of the bordered matrix is 1e12.
    assert_allclose(change, expected, rtol=1e-5, atol=1e-9 * np.max(np.abs(expected)))
    forces, by_factor = native.residual(x, 0.3)
    tangent = system.matrix(matrix)
    residual = tangent @ change[:-1] + by_factor * change[-1] + forces
    terms = abs(tangent) @ np.abs(change[:-1]) + np.abs(by_factor * change[-1]) + np.abs(forces)
    assert np.all(np.abs(residual) <= 1e-10 * terms)
    assert gradient[0] @ change[:-1] + gradient[1] * change[-1] == pytest.approx(-0.02)


def cubic_spring(stiffness=1.0):
    """Return the equations stiffness x^3 + x = 1 as a constrained system."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = 1.0 - x - stiffness * x**3
    return bd.ConstrainedSystem(
        t=t, q=x, v=v, mass=ca.SX(1.0), force=force, constraints=ca.SX(0, 1), q0=[0.0], v0=[0.0]
    )


def test_kernels_that_are_not_cached_are_compiled_when_it_pays(monkeypatch, tmp_path):
    compile_now(monkeypatch)
    control = (np.zeros(1), 1.0)
    other = cubic_spring().equations
    # The loop is loaded before the cache is replaced, because compiling it takes seconds.
    BorderedSystem(other, other, np.zeros(2)).newton_change(np.zeros(1), 0.0, control, 0.0)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(bordered_system, "_OTHER_COORDINATES", 9)
    monkeypatch.setattr(bordered_system, "_COORDINATE_SECONDS", 1e-3)
    monkeypatch.setattr(bordered_system, "_INSTRUCTION_SECONDS", 0.0)
    monkeypatch.setattr(bordered_system, "_KERNEL_SECONDS", 0.0525)
    e = cubic_spring(stiffness=0.123456789).equations
    for k in range(1, 16):
        # A new system each time, as in repeated calls of `equilibrium`.
        bordered = BorderedSystem(e, e, np.zeros(2))
        bordered.newton_change(np.array([0.01 * k]), 0.0, control, 0.0)
        # An iteration counts as 0.01 s, and both kernels as 0.105 s.
        assert bordered.is_native == (k > 10)


def test_equilibria_do_not_depend_on_machine_code(monkeypatch):
    compile_now(monkeypatch)
    ends = []
    for native in ("on", "off"):
        monkeypatch.setenv("BEAMDAE_NATIVE", native)
        ends.append(bd.equilibrium(cubic_spring()).q[-1])
    assert_allclose(ends[0] ** 3 + ends[0], 1.0, rtol=1e-15)
    assert_allclose(*ends, rtol=1e-15)


@pytest.mark.parametrize("native", ["on", "off"])
def test_singular_systems_are_reported_and_later_systems_solved(native, monkeypatch):
    compile_now(monkeypatch)
    monkeypatch.setenv("BEAMDAE_NATIVE", native)
    e = cubic_spring().equations
    bordered, x = BorderedSystem(e, e, np.zeros(2)), np.array([0.5])
    with pytest.raises(SingularMatrixError):
        bordered.newton_change(x, 0.0, (np.zeros(1), 0.0), 0.0)
    change = bordered.newton_change(x, 0.0, (np.zeros(1), 1.0), 0.0)
    assert_allclose(change, [(1.0 - 0.5 - 0.125) / (1.0 + 3.0 * 0.25), 0.0], rtol=1e-14)
