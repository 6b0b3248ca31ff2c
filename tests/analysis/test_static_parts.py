"""Parts of the static analysis: exact tangents, path controls, stability of large matrices."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.statics import stability
from beamdae.analysis.statics.load_scaling import build_loading
from beamdae.analysis.statics.path_controls import DisplacementControl, PathDirection, StepNorm
from beamdae.analysis.statics.stability import assess_stability
from beamdae.equations.assembly.building import remove_forces

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)


def mechanism_with_all_forces():
    """Return a leaf of welded beams with all kinds of forces: loads, contact, friction, springs."""
    mech = bd.Mechanism(gravity=(1.0, lambda t: -9.81 - t))
    strip = bd.Section.rectangle(STEEL, width=0.02, height=0.002, damping=1e-4)
    leaf = bd.welded_beams(mech, "leaf", bd.Arc(1.0, 1.0), strip, bodies=2, elements=1)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), leaf[0].start))
    end, low = leaf[-1].end, mech.ground.at(0.47, -0.3)
    mass = mech.add(bd.RigidBody("mass", 1.0, 0.1, (0.9, 0.6)))
    ball = mech.add(bd.PointMass("ball", 0.1, at=(0.5, -0.2)))
    mech.add(bd.Revolute("pin", end, mass.at(*end.point)))
    guide = mech.add(bd.PointOnLine("guide", low, ball.point, (0.3, 1.0)))
    mech.add(bd.Friction("rub", guide, 0.3, 1e-3))
    mech.add(bd.Contact("floor", ball.point, bd.LineSurface(mech.ground.at(0.0, 0.0)), 1e4))
    mech.add(bd.Spring("rope", ball.point, mass.at(0.9, 0.6), 30.0, free_length=0.2))
    mech.add(bd.TorsionSpring("knee", end, mass.at(0.9, 0.6), 2.0))
    mech.add(bd.Force("follower", end, (2.0, 3.0), axes="body"))
    mech.add(bd.DistributedForce("wind", leaf[0], (0.4, 1.0), axes="section"))
    mech.observe("mass", mass.at(1.0, 0.6))
    mech.observe("ball", ball.point)
    mech.observe("bent", leaf[1].strain(s=0.2, offset=1e-3))
    return mech


@pytest.fixture(scope="module")
def loading():
    mech = mechanism_with_all_forces()
    equations = bd.equations_of_motion(mech)
    return build_loading(mech, equations, [["gravity"], ["follower", "wind"]], 0.2)


@pytest.fixture(scope="module")
def state(loading):
    e = loading.full_equations
    rng = np.random.default_rng(3)
    q = e.q0 + 0.02 * rng.standard_normal(e.n) * e.position_scales
    return np.append(q, rng.standard_normal(e.m))


def central_differences(function, x, step=1e-6):
    """Return the derivative of a function of x, one column per entry of x."""
    columns = []
    for k in range(len(x)):
        change = np.zeros_like(x)
        change[k] = step
        columns.append((function(x + change) - function(x - change)) / (2.0 * step))
    return np.array(columns).T


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("stage", [0, 1])
def test_tangent_matches_differences_of_the_residual(loading, state, stage):
    system, mu = loading.systems[stage], 0.7
    by_difference = central_differences(lambda x: system.residual(x, mu)[0], state)
    exact = system.matrix(system.tangent(state, mu)).toarray()
    # Central differences of a residual of 1e6 N in steps of 1e-6.
    assert_allclose(exact, by_difference, atol=1e-7 * np.max(np.abs(exact)))
    before, after = (system.residual(state, mu + d)[0] for d in (-0.5, 0.5))
    assert_allclose(
        system.residual(state, mu)[1], after - before, atol=1e-9 * np.max(np.abs(after))
    )


@pytest.mark.slow(reason="a second")
def test_stage_begins_where_the_previous_one_ends(loading, state):
    first, second = (
        s.residual(state, mu)[0] for s, mu in zip(loading.systems, (1, 0), strict=True)
    )
    assert_allclose(first, second, rtol=1e-14)


@pytest.mark.parametrize("name", ["mass.x", "mass.angle", "bent [-]"])
def test_gradient_of_displacement_control_matches_differences(loading, state, name):
    control = DisplacementControl.from_name(loading.full_equations, name, np.array([0.2, 0.5]))
    by_difference = central_differences(lambda x: np.array([control.value(x, 0.0)]), state)
    assert_allclose(control.gradient(state, 0.0)[0], by_difference[0], atol=1e-7)


def test_columns_are_linear_controls_if_they_are_linear_in_the_coordinates(loading):
    for name, is_linear in (("ball.x", True), ("mass.x", False), ("bent [-]", False)):
        control = DisplacementControl.from_name(loading.full_equations, name, np.zeros(2))
        assert control.is_linear == is_linear, name


@pytest.mark.slow(reason="a fifth of a second")
def test_linear_columns_control_paths_as_other_columns_do(monkeypatch):
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(STEEL, width=0.02, height=0.003)
    arc = bd.Arc(radius=-1.0, length=1.0, angle=0.5)
    beam = mech.add(bd.Beam("arch", arc, strip, 2, formulation="exact"))
    for end in (beam.start, beam.end):
        mech.add(bd.Revolute(f"hinge {end.point[0]:.1f}", mech.ground.at(*end.point), end))
    mech.add(bd.Force("press", beam.at(0.5), (0.0, -1.0)))
    mech.observe("crown", beam.at(0.5))
    options = {"to": {"crown.y": 0.03}, "step": 0.05}
    path = bd.equilibrium(mech, **options)
    assert path.columns["crown.y [m]"][-1] == pytest.approx(0.03, abs=1e-15)
    monkeypatch.setattr(DisplacementControl, "is_linear", False)
    other = bd.equilibrium(mech, **options)
    assert_allclose(path.q, other.q, rtol=0.0, atol=1e-7)
    assert_allclose(path.factors, other.factors, rtol=1e-6, atol=1e-6)
    assert [one.kind for one in path.critical] == [one.kind for one in other.critical]
    assert path.critical


@pytest.mark.slow(reason="a fifth of a second")
def test_loads_that_share_a_kernel_with_other_loads_are_removed_by_assembly():
    mech = mechanism_with_all_forces()
    mech.add(bd.Force("second", mech.parts["leaf 2"].end, (1.0, 0.0), axes="body"))
    equations = bd.equations_of_motion(mech)
    assert remove_forces(equations, {"follower"}) is None
    rest = remove_forces(equations, {"follower", "second"})
    assert len(rest.structure.forces) == len(equations.structure.forces) - 1
    (system,) = build_loading(mech, equations, ["follower"], 0.2).systems
    assert "second" in system.unloaded.equations.mechanism.parts
    assert "follower" not in system.unloaded.equations.mechanism.parts


def test_arc_length_along_its_own_direction_is_one():
    norm = StepNorm(np.array([1.0, 2.0]), 4.0)
    direction = PathDirection(np.array([0.5, 1.0, 7.0]), 0.3)
    control = norm.arc_length_control(np.zeros(3), 0.0, direction)
    assert control.value(direction.x, direction.mu) == pytest.approx(1.0)
    assert norm.max_norm(direction.x, 3.2) == pytest.approx(0.8)
    other = norm.orthogonal_part(PathDirection(np.array([0.3, -2.0, 1.0]), 0.7), direction)
    assert norm.inner_product(direction, other) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("factor", [0.5, 1.5, 12.0])
def test_inertia_count_by_pivots_matches_eigenvalues(factor, monkeypatch):
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(STEEL, width=0.02, height=0.005)
    column = bd.welded_beams(mech, "column", bd.Line((0, 0), (0, 1)), strip, bodies=3, elements=1)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), column[0].start))
    mech.add(bd.Force("press", column[-1].end, (0.0, -0.25 * np.pi**2 * strip.EI)))
    equations = bd.equations_of_motion(mech)
    (system,) = build_loading(mech, equations, None, 0.0).systems
    path = bd.equilibrium(mech, to=factor)
    state = np.append(path.q[-1], path.lam[-1])
    dense = assess_stability(system, state, factor)
    monkeypatch.setattr(stability, "MAX_DENSE_STIFFNESS", 0)
    sparse = assess_stability(system, state, factor)
    assert sparse.negative_count == dense.negative_count == {0.5: 0, 1.5: 1, 12.0: 2}[factor]
    for index in range(dense.negative_count, dense.negative_count + 2):
        assert sparse.eigenvalue(index) == pytest.approx(dense.eigenvalue(index), rel=1e-6)
    mode, other = (s.mode(dense.negative_count) for s in (dense, sparse))
    assert_allclose(np.abs(other), np.abs(mode), atol=1e-6)


def count_by_pivots(clamped, height, elements, angle):
    """Return the number of negative eigenvalues of a straight beam that pivots determine."""
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(STEEL, width=0.02, height=height)
    line = bd.Line((0.3, 0.2), (0.3 + np.cos(angle), 0.2 + np.sin(angle)))
    beam = mech.add(bd.Beam("beam", line, strip, elements, formulation="exact"))
    if clamped:
        mech.add(bd.Weld("clamp", mech.ground.at(*beam.start.point), beam.start))
    mech.add(bd.Force("tip force", beam.end, (0.0, -1.0)))
    equations = bd.equations_of_motion(mech)
    (system,) = build_loading(mech, equations, None, 0.0).systems
    x = np.append(equations.q0, np.zeros(equations.m))
    return system.bordered.count_negative_eigenvalues(x, 0.0)


def test_regression_signs_of_pivots_of_thin_beams_with_fine_meshes_are_certain():
    """Shifts exceeded the smallest eigenvalue, and eigenvalues took 95 % of the time of paths."""
    assert count_by_pivots(clamped=True, height=1e-4, elements=128, angle=0.0) == 0


@pytest.mark.parametrize("angle", [0.0, 0.7, -2.1])
@pytest.mark.parametrize(("height", "elements"), [(1e-2, 2), (1e-3, 32), (1e-2, 64)])
def test_signs_of_pivots_of_free_beams_are_not_certain(height, elements, angle):
    assert count_by_pivots(clamped=False, height=height, elements=elements, angle=angle) is None


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_fine_mesh_is_free_only_without_a_clamp(formulation):
    """The lowest stiffness of a fine mesh is 1e-11 of the largest; rounding errors are 1e-16."""
    strip = bd.Section.rectangle(STEEL, width=0.02, height=0.002)

    def find_equilibrium(clamped):
        mech = bd.Mechanism()
        arc = bd.Arc(2.0, 1.0)
        beam = mech.add(bd.Beam("beam", arc, strip, 64, formulation=formulation))
        kind = bd.Weld if clamped else bd.Revolute
        mech.add(kind("foot", mech.ground.at(0.0, 0.0), beam.start))
        return bd.equilibrium(mech)

    cantilever = find_equilibrium(clamped=True)
    assert cantilever.stable
    assert not cantilever.free
    with pytest.warns(bd.BeamdaeWarning, match="this coordinate can move without stiffness"):
        pendulum = find_equilibrium(clamped=False)
    assert pendulum.free.startswith("beam.")
    assert not pendulum.stable
    assert pendulum.unstable[-1] == 0


def test_regression_states_without_steady_value_are_not_told_to_add_a_spring():
    """A work integrator was a coordinate without stiffness that needs a spring or a joint."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    for k in range(2):
        mech.add(bd.Spring(f"spring {k}", mech.ground.at(0.0, k), mass.point, 10.0))
    mech.state("work", rate=0.0)
    with pytest.warns(bd.BeamdaeWarning, match=r"work\.value: the rate of this state"):
        bd.equilibrium(mech)
