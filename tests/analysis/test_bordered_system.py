"""Static equations of a load stage: machine code, load factor, bordered solution."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.statics import bordered_system
from beamdae.analysis.statics.bordered_system import BorderedSystem
from beamdae.analysis.statics.corrector import Corrector
from beamdae.analysis.statics.load_scaling import build_loading
from beamdae.analysis.statics.path_controls import (
    DisplacementControl,
    LoadControl,
    PathDirection,
    StepNorm,
)
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


def newton_change(bordered, x, mu, gradient, deviation):
    """Return the change of Newton's method for a control with this gradient and deviation."""
    forces, by_factor = bordered.residual(x, mu)
    return bordered.solve(x, mu, gradient, by_factor, -np.append(forces, deviation))


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
def test_regression_forces_follow_the_load_factor(formulation, monkeypatch):
    compile_now(monkeypatch)
    system = loaded_arch(formulation)
    x, _ = random_unknowns(system.equations)
    system.tangent(x, 0.3)
    # A count evaluates no forces if the tangent is known.
    system.bordered.count_negative_eigenvalues(x, 0.3)
    system.bordered.has_follower_loads(x, 0.8)
    for result, expected in zip(
        system.residual(x, 0.8), loaded_arch(formulation).residual(x, 0.8), strict=True
    ):
        assert_allclose(result, expected, atol=1e-14 * np.max(np.abs(expected)))


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
    expected = newton_change(interpreted, x, 0.3, gradient, 0.02)
    assert not interpreted.is_native
    matrix = interpreted.tangent(x, 0.3)
    compile_now(monkeypatch)
    native = BorderedSystem(system.unloaded.equations, e, np.zeros(2))
    native.correct(LoadControl(), 0.3, x, 0.3)
    assert native.is_native
    change = newton_change(native, x, 0.3, gradient, 0.02)
    assert np.array_equal(native.tangent(x, 0.3), matrix)
    # The condition number of the bordered matrix is 1e12.
    assert_allclose(change, expected, rtol=1e-5, atol=1e-9 * np.max(np.abs(expected)))
    forces, by_factor = native.residual(x, 0.3)
    tangent = system.matrix(matrix)
    residual = tangent @ change[:-1] + by_factor * change[-1] + forces
    terms = abs(tangent) @ np.abs(change[:-1]) + np.abs(by_factor * change[-1]) + np.abs(forces)
    assert np.all(np.abs(residual) <= 1e-10 * terms)
    assert gradient[0] @ change[:-1] + gradient[1] * change[-1] == pytest.approx(-0.02)


def controls(system, begin):
    """Return a control of each kind, with a target near `begin` and a step towards it."""
    e = system.equations
    n, random = e.n, np.random.default_rng(5)
    step = PathDirection(np.append(1e-3 * random.standard_normal(n), np.zeros(e.m)), 0.01)
    arc = StepNorm(e.position_scales, 1.0).arc_length_control(begin.x, begin.mu, step)
    tip = DisplacementControl.from_name(e, "tip.y", np.zeros(2))
    near_tip = tip.value(begin.x, begin.mu) - 1e-3
    return {
        "load": (LoadControl(), begin.mu + 0.01, step),
        "arc length": (arc, 1.0, step),
        "displacement": (tip, near_tip, step),
    }


@pytest.mark.parametrize("control", ["load", "arc length", "displacement"])
@pytest.mark.parametrize("kind", [{"formulation": "exact"}, {"strain": "exact"}, {}])
def test_compiled_corrections_agree_with_interpreted_ones(kind, control, monkeypatch):
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    beam = mech.add(bd.Beam("strip", bd.Arc(0.5, 0.4), strip, 2, **kind))
    mech.add(bd.Weld("clamp", mech.ground.at(*beam.start.point), beam.start))
    mech.add(bd.Force("force", beam.end, (3.0, -20.0)))
    mech.observe("tip", beam.end)
    (system,) = build_loading(mech, bd.equations_of_motion(mech), None, 0.0).systems
    e = system.equations
    compile_now(monkeypatch)
    results, directions = [], []
    for native in ("on", "off"):
        monkeypatch.setenv("BEAMDAE_NATIVE", native)
        corrector = Corrector(replace(system))
        x = np.append(e.q0, np.zeros(e.m))
        begin = corrector.correct(LoadControl(), 0.3, x, 0.3)
        prescribed, target, step = controls(system, begin)[control]
        point, details = corrector.follow(prescribed, target, begin, step)
        assert prescribed.value(point.x, point.mu) == pytest.approx(target, abs=1e-10)
        results.append(np.array([*point.x[: e.n], point.mu, details.motion, details.correction]))
        direction = details.direction or corrector.path_tangent(point, prescribed)
        directions.append(np.append(direction.x[: e.n], direction.mu))
        assert point.system.bordered.is_native == (native == "on")
    assert_allclose(*results, rtol=1e-8, atol=1e-9)
    assert_allclose(*directions, rtol=1e-6, atol=1e-8 * np.max(np.abs(directions)))


def cubic_spring(stiffness=1.0):
    """Return the equations stiffness x^3 + x = 1 as a constrained system."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = 1.0 - x - stiffness * x**3
    return bd.ConstrainedSystem(
        t=t, q=x, v=v, mass=ca.SX(1.0), force=force, constraints=ca.SX(0, 1), q0=[0.0], v0=[0.0]
    )


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
        newton_change(bordered, x, 0.0, (np.zeros(1), 0.0), 0.0)
    change = newton_change(bordered, x, 0.0, (np.zeros(1), 1.0), 0.0)
    assert_allclose(change, [(1.0 - 0.5 - 0.125) / (1.0 + 3.0 * 0.25), 0.0], rtol=1e-14)


def bent_cantilever(height, force, length=1.0):
    """Return a cantilever with a force [EI / length^2] at its end."""
    mech = bd.Mechanism()
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.02, height=height)
    beam = mech.add(bd.Beam("b", bd.Line((0.0, 0.0), (length, 0.0)), strip, 3, formulation="exact"))
    mech.add(bd.Weld("w", mech.ground.at(0.0, 0.0), beam.start))
    load = force * steel.E * 0.02 * height**3 / 12.0 / length**2
    mech.add(bd.Force("f", beam.end, (-0.6 * load, -load)))
    return mech


def equal_paths(one, other):
    """Return True if the rows of two paths have equal bits."""
    numbers = zip((one.factors, one.q, one.lam), (other.factors, other.q, other.lam), strict=True)
    return all(map(np.array_equal, *zip(*numbers, strict=True)))


def test_workspaces_of_earlier_paths_do_not_change_results(monkeypatch):
    compile_now(monkeypatch)
    first = bd.equilibrium(bent_cantilever(0.004, 3.0), step=0.25)
    # The same equations with other numbers, natural sizes and load steps, also at the same time.
    bd.equilibrium(bent_cantilever(0.002, 8.0, length=2.0), step=0.1)
    bd.equilibrium(bent_cantilever(0.001, -5.0), control="arc length")
    again = bd.equilibrium(bent_cantilever(0.004, 3.0), step=0.25)
    assert equal_paths(first, again)


def bar_on_springs(stiffness):
    """Return a bent cantilever beside a rigid bar on springs of this stiffness [N/m]."""
    mech = bent_cantilever(0.004, 3.0)
    bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, (3.0, 0.0)))
    for x in (2.5, 3.5):
        mech.add(bd.Spring(f"s{x}", mech.ground.at(x, -1.0), bar.at(x, 0.0), stiffness))
    return mech


def test_scales_make_all_parts_equally_stiff():
    mech = bar_on_springs(1e-3)
    e = bd.equations_of_motion(mech)
    (system,) = build_loading(mech, e, None, 0.0).systems
    stiffness = system.unloaded.matrix(e.q0, np.zeros(e.m)).toarray()[: e.n, : e.n]
    energies = np.abs(stiffness) * system.scales * system.scales[:, None]
    beam, bar = (np.max(energies[:, part.rows]) for part in e.parts)
    assert bar == pytest.approx(beam, rel=1e-12)
    # The stiffest part keeps its size.
    assert_allclose(system.scales[e.parts[0].rows], e.part_scales[e.parts[0].rows], rtol=1e-15)


@pytest.mark.slow(reason="a quarter of a second")
def test_workspaces_are_used_again_for_other_stiffnesses(monkeypatch):
    """Creating the workspace takes as long as several load steps."""
    compile_now(monkeypatch)
    first = bd.equilibrium(bar_on_springs(1e3), step=0.25)
    with monkeypatch.context() as context:
        context.setattr(BorderedSystem, "_make_loop", lambda *_, **__: pytest.fail("new loop"))
        bd.equilibrium(bar_on_springs(2e-2), step=0.25)
        again = bd.equilibrium(bar_on_springs(1e3), step=0.25)
    assert equal_paths(first, again)
