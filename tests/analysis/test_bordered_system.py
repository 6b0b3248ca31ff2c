"""Static equations of a load stage: machine code, load factor, bordered solution."""

import warnings
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
from beamdae.analysis.statics.newton_loop import CORRECT, EXTEND_SPACE, FOLLOW_LOAD
from beamdae.analysis.statics.path_controls import (
    DisplacementControl,
    LoadControl,
    PathDirection,
    StepNorm,
)
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
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


def test_kernels_that_are_not_cached_are_compiled_when_it_pays(monkeypatch, tmp_path):
    compile_now(monkeypatch)
    other = cubic_spring().equations
    # The loop is loaded before the cache is replaced, because compiling it takes seconds.
    BorderedSystem(other, other, np.zeros(2)).correct(LoadControl(), 0.0, np.zeros(1), 0.0)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(bordered_system, "_OTHER_COORDINATES", 9)
    monkeypatch.setattr(bordered_system, "_COORDINATE_SECONDS", 1e-3)
    monkeypatch.setattr(bordered_system, "_INSTRUCTION_SECONDS", 0.0)
    monkeypatch.setattr(bordered_system, "_KERNEL_SECONDS", 0.0525)
    e = cubic_spring(stiffness=0.123456789).equations
    iterations = 0
    while iterations < 20:
        # A new system each time, as in repeated calls of `equilibrium`.
        bordered = BorderedSystem(e, e, np.zeros(2))
        iterations += bordered.correct(LoadControl(), 0.0, np.array([0.6]), 0.0).iterations
        # An iteration counts as 0.01 s, and both kernels as 0.105 s.
        assert bordered.is_native == (iterations > 10)


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


def test_joints_that_permit_rest_are_not_evaluated_to_find_rotations(monkeypatch):
    monkeypatch.setattr(ConsistencySolver, "constraint_levels", lambda *_: pytest.fail("evaluated"))
    assert bd.equilibrium(bent_cantilever(0.004, 3.0)).status.success


def test_paths_of_load_control_take_three_calls_of_the_loop(monkeypatch):
    """The factors of the last point also serve its modes; each call takes 0.01 to 0.1 ms."""
    compile_now(monkeypatch)
    mech, tasks, call = bent_cantilever(0.004, 3.0), [], StepLoop.__call__
    bd.equilibrium(mech)

    def count(loop):
        tasks.append(loop.work.task)
        return call(loop)

    monkeypatch.setattr(StepLoop, "__call__", count)
    bd.equilibrium(mech)
    assert tasks == [CORRECT, FOLLOW_LOAD, EXTEND_SPACE]


@pytest.mark.parametrize(
    "options", [{"to": 4.0}, {"to": [0.6, 2.0, 0.1], "step": 0.3}, {"step": 0.9, "max_points": 2}]
)
def test_load_steps_in_one_call_are_those_of_single_calls(options, monkeypatch):
    compile_now(monkeypatch)
    mech = bent_cantilever(0.003, 2.0)
    with warnings.catch_warnings():
        # One of the paths ends early.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        in_one_call = bd.equilibrium(mech, **options)
        monkeypatch.setattr(BorderedSystem, "follow_load", lambda *_: None)
        one_by_one = bd.equilibrium(mech, **options)
    # Predictions differ: only those in one call extrapolate the curvature of the path.
    assert np.array_equal(in_one_call.factors, one_by_one.factors)
    assert_allclose(in_one_call.q, one_by_one.q, rtol=0.0, atol=1e-14)
    scale = np.max(np.abs(one_by_one.lam))
    assert_allclose(in_one_call.lam, one_by_one.lam, rtol=0.0, atol=1e-12 * scale)
    assert in_one_call.settings["iterations"] <= one_by_one.settings["iterations"]
    assert in_one_call.status == one_by_one.status


def test_curvature_of_the_path_saves_iterations(monkeypatch):
    compile_now(monkeypatch)
    path = bd.equilibrium(bent_cantilever(0.003, 2.0), step=0.05)
    steps = len(path.factors) - 1
    # Along the tangent alone, most steps take three iterations.
    assert path.settings["iterations"] <= 2.2 * steps
    monkeypatch.setattr(BorderedSystem, "follow_load", lambda *_: None)
    one_by_one = bd.equilibrium(bent_cantilever(0.003, 2.0), step=0.05)
    assert one_by_one.settings["iterations"] >= 2.7 * steps


def test_regression_pivots_of_thin_beams_with_fine_meshes_are_not_renewed(monkeypatch):
    """The shift for signs of pivots made their solutions inaccurate: 50 % of the time."""
    compile_now(monkeypatch)
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.02, height=1e-4)
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    beam = mech.add(bd.Beam("b", bd.Line((0.0, 0.0), (1.0, 0.0)), strip, 32, formulation="exact"))
    mech.add(bd.Weld("w", mech.ground.at(0.0, 0.0), beam.start))
    monkeypatch.setattr(FactorizedMatrix, "renew_pivots", lambda *_: pytest.fail("new pivots"))
    path = bd.equilibrium(mech)
    assert path.status.success
    assert path.stable


@pytest.mark.slow(reason="a fifth of a second")
def test_load_steps_in_one_call_find_the_same_critical_points(monkeypatch):
    compile_now(monkeypatch)
    mech = bd.Mechanism()
    steel = bd.Material.of("steel")
    strip = bd.Section.rectangle(steel, width=0.02, height=0.002)
    column = mech.add(bd.Beam("b", bd.Line((0.0, 0.0), (1.0, 0.0)), strip, 3, formulation="exact"))
    mech.add(bd.Weld("w", mech.ground.at(0.0, 0.0), column.start))
    mech.add(bd.Force("f", column.end, (-steel.E * 0.02 * 0.002**3 / 12.0, 0.0)))
    in_one_call = bd.equilibrium(mech, to=30.0)
    monkeypatch.setattr(BorderedSystem, "follow_load", lambda *_: None)
    one_by_one = bd.equilibrium(mech, to=30.0)
    assert [x.kind for x in in_one_call.critical] == ["branch point", "branch point"]
    assert in_one_call.critical == one_by_one.critical
    assert equal_paths(in_one_call, one_by_one)
