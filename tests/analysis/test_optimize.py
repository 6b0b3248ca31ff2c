"""Optimization: closed forms, gradients against differences, failures, limits and interrupts."""

import math
import signal
import warnings
from dataclasses import replace

import mechanisms
import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, free_ball, mass_on_rail
from scipy.optimize import OptimizeResult

import beamdae as bd
from beamdae import quantities
from beamdae.analysis.fit.problem import FitProblem, Scaling
from beamdae.analysis.gradients.flat_model import FlatModel
from beamdae.analysis.optimization import solvers
from beamdae.analysis.optimization.analyses import DesignModel, RunSettings, create_analysis
from beamdae.analysis.optimization.problem import DesignProblem, create_problem
from beamdae.analysis.optimization.result import Constraint
from beamdae.analysis.optimization.solvers import METHODS

truss = bd.model(t_end=1.0)(mechanisms.truss)

STEEL = bd.Material(E=210e9, nu=0.3, rho=7850.0)
LENGTH, WIDTH, LOAD, SAG = 1.0, 0.02, 50.0, 0.01
ALPHA = bd.GeneralizedAlpha(step=2e-3)


@bd.model(t_end=0.1)
def cantilever(
    height=bd.param((0.02,) * 3, "m"), width=WIDTH, load=LOAD, length=LENGTH, strain="exact"
):
    """Cantilever of constant height between element ends, with a force at its tip."""
    count = len(height)

    def section(s):
        number = min(int(count * s / length), count - 1)
        return bd.Section.rectangle(STEEL, width=width, height=height[number], damping=1e-3)

    mech, beam = clamped_beam(section, count, length, strain=strain)
    mech.add(bd.Force("load", beam.end, (0.0, -load)))
    mech.observe("tip", beam.end)
    for k in range(count):
        mech.observe(f"stress {k}", beam.stress((k + 0.1) * length / count, "top"))
    return mech


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("height", [0.005, 0.0005, 0.05])
def test_regression_designs_differentiate_equilibria_of_slender_steel_beams(height):
    """The condition number of unscaled static equations looked like a motion without stiffness."""

    @bd.model(t_end=1.0)
    def leaf(height=height, tip=0.6 * height):
        section = bd.taper(bd.Section.rectangle, STEEL, width=0.05, height=(height, tip))
        mech, beam = clamped_beam(section, 16, 0.4, name="leaf", formulation="exact")
        load = 300.0 * (leaf.parameters["height"] / 0.005) ** 3
        mech.add(bd.Force("load", beam.end, (0.0, -load)))
        mech.observe("tip", beam.end)
        return mech

    entries = {name: (name, None) for name in ("height", "tip")}
    tip, settings = quantities.EquilibriumValue("tip.y"), RunSettings(None, None, None)

    def analyze(**changes):
        model = DesignModel(
            FlatModel(replace(leaf, parameters={**leaf.parameters, **changes}), entries)
        )
        return create_analysis(model, [tip], settings)

    gradient = analyze().gradient({tip: 1.0})
    for k, name in enumerate(entries):
        step = 1e-5 * leaf.parameters[name]
        ahead, behind = (
            analyze(**{name: leaf.parameters[name] + x}).values[tip] for x in (step, -step)
        )
        assert gradient[k] == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-6)


@pytest.mark.slow(reason="a third of a second")
def test_regression_designs_include_the_operators_of_observed_columns():
    """The shape functions of a curved beam in a floating frame depend on its radius."""

    @bd.model(t_end=1.0)
    def arc(radius=1.0):
        mech = bd.Mechanism()
        curve, section = bd.Arc(radius, 0.9), bd.Section.rectangle(STEEL, 0.02, 0.02)
        beam = bd.Beam("arc", curve, section, elements=3, formulation="floating frame")
        mech.add(beam)
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Force("load", beam.end, (0.0, -50.0)))
        mech.observe("gauge", beam.strain(s=0.53, offset=0.01))
        return mech

    gauge, settings = quantities.EquilibriumValue("gauge"), RunSettings(None, None, None)

    def analyze(radius):
        model = FlatModel(replace(arc, parameters={"radius": radius}), {"radius": ("radius", None)})
        return create_analysis(DesignModel(model), [gauge], settings)

    ahead, behind = (analyze(1.0 + x).values[gauge] for x in (1e-4, -1e-4))
    (gradient,) = analyze(1.0).gradient({gauge: 1.0})
    assert gradient == pytest.approx((ahead - behind) / 2e-4, rel=1e-5)


@bd.model(t_end=1.0)
def tapered_leaf(height=(0.008,) * 5, load=500.0, length=0.4):
    """Steel cantilever of piecewise linear height, with a force at its tip."""
    section = bd.taper(bd.Section.rectangle, STEEL, width=0.05, height=height)
    mech, beam = clamped_beam(section, 8, length, name="leaf", formulation="exact")
    mech.add(bd.Force("load", beam.end, (0.0, -load)))
    mech.observe("stress", beam.largest_stress(exponent=150))
    return mech


STRESS = quantities.EquilibriumValue("stress.bound")
LEAF_BOUNDS = {"height": (0.001, 0.03)}


@pytest.mark.slow(reason="dozens of equilibria")
@pytest.mark.parametrize(("method", "most"), [("SLSQP", 60), ("IPOPT", 100)])
@pytest.mark.parametrize("first", [0.006, 0.012])
def test_regression_lightest_tapered_leaf_under_a_stress_limit(first, method, most):
    """The stress bound jumped with the number of its sections, and the search never ended."""
    limit = quantities.at_most(STRESS, 5e8)
    heights = {"height": (first,) * 5}
    design = bd.optimize(
        tapered_leaf,
        quantities.Mass(),
        "height",
        limit,
        LEAF_BOUNDS,
        parameters=heights,
        method=method,
    )
    assert design.status.success
    assert design.evaluations < most
    # Without shortening of the lever by large deflections, the linear program of full stress has
    # 0.7327 kg; the bound exceeds the largest stress of about 100 sections by up to 2 %.
    assert design.objective == pytest.approx(0.7272, rel=2e-4)
    # The limit is that of the model, with its own stress sections.
    path = bd.equilibrium(tapered_leaf(**design.parameters))
    assert path["stress.bound"].iloc[-1] == pytest.approx(5e8, rel=2e-6)


@pytest.mark.slow(reason="one second")
def test_regression_gradients_of_runs_from_equilibrium_are_those_of_the_stress_bound():
    """A ValueError about sizes of matrices ended the search: the gradient had other sections."""
    first = {"height": (0.008, 0.008, 0.008, 0.006, 0.003)}
    settings = RunSettings(bd.GeneralizedAlpha(1e-3), 2e-3, "equilibrium")
    limit = quantities.at_most(quantities.SmoothMaximum("stress.bound"), 5e8)
    problem = create_problem(
        tapered_leaf, quantities.Mass(), "height", limit, None, first, settings
    )
    other, step = problem.first * [1.0, 0.6, 1.0, 1.0, 0.5], 1e-5 * problem.first
    gradient = problem.design(other).gradients[1]
    after, before = (problem.design(other + sign * step).values[1] for sign in (1.0, -1.0))
    # Errors of the difference are of second order in the step.
    assert gradient @ (2.0 * step) == pytest.approx(after - before, rel=1e-5)


@bd.model(t_end=1.0)
def column(tip=0.02, root=0.02):
    """Half of a pinned column, with a parabolic width, under the Euler load of a constant width."""
    height, mean = 0.005, 0.02

    def section(s):
        return bd.Section.rectangle(STEEL, width=root + (tip - root) * s**2, height=height)

    mech, beam = clamped_beam(section, 4, name="half", formulation="exact")
    euler = np.pi**2 / 4.0 * STEEL.E * mean * height**3 / 12.0
    mech.add(bd.Force("push", beam.end, (-euler, 0.0)))
    return mech


@bd.model(t_end=1.0)
def pair(soft=2.0, stiff=3.0):
    """Two masses on a line between walls, with springs of which one can become too soft."""
    if soft < 0.5:
        raise bd.BeamdaeError("pair: soft must be at least 0.5.")
    mech, mass = mass_on_rail(x=1.0, spring=(soft,))
    mech.add(bd.Force("push", mass.point, (1.0, 0.0)))
    mech.observe("mass", mass.point)
    return mech


@pytest.mark.parametrize(
    ("goal", "note"),
    [
        (0.5, ("stiff is at its lower limit 1",)),
        (1.0007, ("stiff is at its lower limit 1",)),
        (1.003, ()),
        (5.0, ("stiff is at its upper limit 4",)),
    ],
)
def test_numbers_within_a_thousandth_of_a_limit_have_a_note(goal, note):
    distance = quantities.ParameterFunction(lambda stiff: (stiff - goal) ** 2, "distance")
    design = bd.optimize(pair, distance, "stiff", bounds={"stiff": (1.0, 4.0)}, tolerance=1e-10)
    assert design.bound_notes == note
    assert all(x in repr(design) for x in note)
    assert design.at_bounds == (("stiff",) if note else ())


def light_heights(count):
    """Return the heights of the lightest cantilever with the deflection SAG, without shear.

    With the distances x from the tip, the deflection is the sum of 4 P (x1^3 - x0^3) / (E b h^3),
    so that h^4 is proportional to (x1^3 - x0^3) / (x1 - x0); h ~ sqrt(x) in the limit.
    """
    ends = np.linspace(LENGTH, 0.0, count + 1)
    cubes = ends[:-1] ** 3 - ends[1:] ** 3
    shape = (cubes * count) ** 0.25
    return shape * (np.sum(4.0 * LOAD * cubes / shape**3) / (STEEL.E * WIDTH * SAG)) ** (1.0 / 3.0)


@pytest.mark.slow(reason="twenty designs")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("first", [0.02, 0.035])
def test_lightest_cantilever_has_the_heights_of_the_closed_form(first, method):
    result = bd.optimize(
        cantilever,
        quantities.Mass(),
        "height",
        quantities.at_least(quantities.EquilibriumValue("tip.y", step=1.0), -SAG),
        {"height": (0.002, 0.05)},
        parameters={"height": (first,) * 2},
        tolerance=1e-9,
        method=method,
    )
    assert result.status.success
    # Shear adds 1e-4 of the deflection.
    np.testing.assert_allclose(result.parameters["height"], light_heights(2), rtol=2e-4)
    # The design can be built.
    cantilever(**result.parameters)
    (limit,) = result.constraints
    assert limit.margin == pytest.approx(0.0, abs=1e-6 * SAG)
    # The mass is proportional to SAG^(-1/3).
    assert limit.multiplier == pytest.approx(result.objective / (3.0 * SAG), rel=1e-3)
    assert result.residual < 1e-3
    assert not result.at_bounds
    assert result.table()["unit"].to_dict() == {"height[0]": "m", "height[1]": "m"}


@pytest.mark.slow(reason="one second")
def test_strongest_column_of_given_volume_carries_12_over_pi_squared_times_the_euler_load():
    """If I is proportional to A, the bending moment of the best column is constant times A.

    Its deflection is a parabola, as its area, which vanishes at the pins: P = 12 E I_mean / L^2.
    Keller, Arch. Ration. Mech. Anal. 5 (1960) 275, treats I proportional to A^2.
    """
    width = quantities.ParameterFunction(lambda tip, root: (tip + 2.0 * root) / 3.0, "mean width")
    load = quantities.CriticalLoad(to=1.6, step=0.5)
    bounds = {"tip": (1e-4, 0.05), "root": (0.01, 0.05)}
    result = bd.optimize(column, -load, ["tip", "root"], quantities.at_most(width, 0.02), bounds)
    assert result.status.success
    assert result.at_bounds == ("tip",)
    # The smallest width at the tip and shear cost 1e-4 of the load.
    assert -result.objective == pytest.approx(12.0 / np.pi**2, rel=2e-4)
    # The path ends beyond the critical load.
    (path,) = result.analyses
    assert "unstable" in path.instability
    assert result.warnings == ()


@bd.model(t_end=1.0)
def loaded_spring(stiffness=100.0):
    """Mass on a spring that a sudden load of 1 N deflects by up to 2 / `stiffness`."""
    mech, mass = free_ball(name="mass")
    ground = mech.ground.at(-1.0, 0.0)
    mech.add(bd.PointOnLine("rail", ground, mass.point))
    mech.add(bd.Spring("spring", ground, mass.point, stiffness))
    mech.add(bd.Force("load", mass.point, (1.0, 0.0)))
    return mech


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("exponent", [10.0, 50.0])
@pytest.mark.parametrize("is_negative", [False, True])
def test_regression_limits_of_smooth_maxima_are_those_of_the_maxima(exponent, is_negative, method):
    """A maximum was 6 % above the limit of its smooth maximum."""
    travel = quantities.SmoothMaximum("mass.x", exponent)
    limit = (
        quantities.at_least(-1.0 * travel, -0.02)
        if is_negative
        else quantities.at_most(travel, 0.02)
    )
    size = quantities.ParameterFunction(lambda stiffness: stiffness, "stiffness")
    calls = (loaded_spring, size, "stiffness", limit, {"stiffness": (20.0, 500.0)})
    design = bd.optimize(*calls, method=method)
    assert design.status.success
    assert design.warnings == ()
    # The search continues until the ratio of maximum and smooth maximum is constant to 0.1 %.
    assert design.parameters["stiffness"] == pytest.approx(100.0, rel=1e-3)
    (constraint,) = design.constraints
    assert abs(constraint.value) == pytest.approx(0.02, rel=1e-5)
    assert constraint.comparison == "at its limit"
    # So does a search that ends before.
    with pytest.warns(
        bd.BeamdaeWarning, match=r"is -?0\.02062 m, but the limit is at \w+ -?0\.02 m; stopped"
    ):
        ended = bd.optimize(*calls, parameters={"stiffness": 97.0}, max_evaluations=1)
    assert abs(ended.constraints[0].value) == pytest.approx(2.0 / 97.0, rel=1e-3)


@pytest.mark.slow(reason="half a second and more")
def test_regression_violations_of_infeasible_designs_are_those_of_the_maxima():
    """Tables, files and warnings stated three violations, of which none was that of the maximum."""
    limit = quantities.at_most(quantities.SmoothMaximum("mass.x"), 0.003)
    size = quantities.ParameterFunction(lambda stiffness: stiffness, "stiffness")
    with pytest.warns(bd.BeamdaeWarning, match=r"is 0\.00\d+ m, but the limit"):
        design = bd.optimize(loaded_spring, size, "stiffness", limit, {"stiffness": (20.0, 500.0)})
    (constraint,), (run,) = design.constraints, design.analyses
    assert constraint.value == pytest.approx(run["mass.x"].max(), rel=1e-3)
    row = design.history().iloc[design.best_number - 1]
    column = "1: SmoothMaximum of mass.x"
    assert (row[column], row["violation"]) == pytest.approx(
        (constraint.value, constraint.value / 0.003 - 1.0)
    )
    assert design.warnings == ()


@pytest.mark.parametrize("method", METHODS)
def test_regression_searches_end_at_local_minima_of_the_violation(method):
    """Of 200 evaluated designs, 173 had the same parameter to eight digits."""
    size = quantities.ParameterFunction(lambda stiffness: 1.0 + 1e-5 * stiffness, "size")
    limited = quantities.ParameterFunction(
        lambda stiffness: 1.0 + (stiffness / 100.0 - 1.0) ** 2, "c"
    )
    arguments = (loaded_spring, size, "stiffness", quantities.at_most(limited, 0.97))
    settings = {"bounds": {"stiffness": (20.0, 500.0)}, "parameters": {"stiffness": 150.0}}
    with pytest.warns(bd.BeamdaeWarning, match="c <= 0.97 cannot be satisfied by small changes"):
        design = bd.optimize(*arguments, **settings, method=method)
    assert design.evaluations < 100
    assert design.parameters["stiffness"] == pytest.approx(100.0, rel=1e-3)


@pytest.mark.slow(reason="half a second and more")
def test_largest_of_limited_smooth_maxima_is_the_largest_maximum():
    maxima = [quantities.SmoothMaximum(f"mass.{name}") for name in ("x", "x_dot")]
    limit = quantities.at_most(quantities.LargestOf(maxima), 0.1)
    size = quantities.ParameterFunction(lambda stiffness: stiffness, "stiffness")
    bounds = {"stiffness": (20.0, 500.0)}
    design = bd.optimize(loaded_spring, size, "stiffness", limit, bounds)
    # The largest speed is 1 / sqrt(stiffness).
    assert design.parameters["stiffness"] == pytest.approx(100.0, rel=4e-3)
    (constraint,) = design.constraints
    assert constraint.value == pytest.approx(0.1, rel=1e-5)
    assert constraint.comparison == "at its limit"


@pytest.mark.slow(reason="half a second and more")
def test_maxima_that_do_not_reach_the_limit_of_their_smooth_maximum_have_one_search():
    travel = quantities.SmoothMaximum("mass.x")
    size = quantities.ParameterFunction(
        lambda stiffness: (stiffness / 200.0 - 1.0) ** 2, "stiffness"
    )
    arguments = (loaded_spring, size, "stiffness")
    bounds = {"stiffness": (20.0, 500.0)}
    free = bd.optimize(*arguments, (), bounds)
    limited = bd.optimize(*arguments, quantities.at_most(travel, 0.02), bounds)
    assert limited.evaluations == free.evaluations
    (constraint,) = limited.constraints
    (run,) = limited.analyses
    assert constraint.value == pytest.approx(run["mass.x"].max(), rel=1e-3)


@pytest.mark.slow(reason="thirteen designs with runs, paths and modes")
def test_gradients_of_all_quantities_agree_with_differences():
    several = [
        quantities.Mass()
        + 2.0 * quantities.EquilibriumValue("tip.y")
        - quantities.EndValue("tip.x"),
        quantities.LargestOf([quantities.EquilibriumValue(f"stress {k}") for k in range(2)], 8.0),
        quantities.LargestOf(
            [
                quantities.SmoothMaximum("stress 0", 20.0),
                quantities.SmoothMaximum("stress 1"),
            ],
            8.0,
        ),
        quantities.EquilibriumErrors("tip.y", [0.5, 1.0], [0.0, -0.02], [0.01, 0.02]),
        quantities.EquilibriumValue("tip.angle", to=0.5),
        quantities.Frequency(2, "equilibrium"),
        quantities.ParameterFunction(
            lambda height, length, **_: sum(x**2 for x in height) * length
        ),
        quantities.SquaredErrors("tip.y", [0.05, 0.1], [0.0, -0.01]) / 3.0,
    ]
    problem = create_problem(
        cantilever,
        several[0],
        ["height", "length"],
        [quantities.at_most(x, 1.0) for x in several[1:]],
        None,
        {"height": (0.02, 0.012)},
        RunSettings(ALPHA, None, None),
    )
    design = problem.design(problem.first)
    for k in range(3):
        delta = 1e-3 * problem.first * (np.arange(3) == k)
        values = [problem.design(problem.first + x * delta).values for x in (1, -1, 2, -2)]
        near, far = values[0] - values[1], values[2] - values[3]
        expected = (8.0 * near - far) / (12.0 * delta[k])
        # Rounding errors of frequencies and of the runs limit the differences.
        np.testing.assert_allclose(design.gradients[:, k], expected, rtol=2e-5)


@pytest.mark.slow(reason="half a second")
def test_regression_warnings_of_the_analyses_of_the_best_design_are_kept():
    # The tip rotates by nearly 1 rad, too far for Green's strains.
    limits = [
        quantities.at_least(quantities.EquilibriumValue("tip.y"), -0.7),
        quantities.at_most(quantities.EquilibriumValue("stress 0", step=0.5), 1e12),
    ]
    given, bounds = {"height": (0.003,), "load": 20.0, "strain": "green"}, {"height": (0.002, 0.05)}
    with pytest.warns(bd.BeamdaeWarning) as caught:
        design = bd.optimize(
            cantilever, quantities.Mass(), "height", limits, bounds, parameters=given
        )
    with pytest.warns(bd.BeamdaeWarning):
        expected = bd.equilibrium(cantilever(**{**given, **design.parameters})).warnings
    # Both paths end in the same equilibrium.
    assert sum(isinstance(x, bd.results.Equilibrium) for x in design.analyses) == 2
    assert design.warnings[-len(expected) :] == expected
    # Designs of the search are not reported.
    assert [str(x.message) for x in caught][-len(expected) :] == list(expected)


@pytest.mark.slow(reason="a second")
def test_regression_warnings_about_output_rows_are_omitted():
    """They recommended output_step=, an argument that `optimize` does not have."""

    @bd.model(t_end=3.0)
    def drop(height=0.05):
        mech, ball = free_ball((0.0, height), gravity=9.81)
        floor = bd.LineSurface(mech.ground.at(0.0, 0.0), (1.0, 0.0))
        mech.observe("floor", mech.add(bd.Contact("floor", ball.point, floor, 1e9)).force)
        return mech

    with pytest.warns(bd.BeamdaeWarning, match="floor.N: the output rows miss"):
        bd.simulate(drop(), bd.GeneralizedAlpha(rtol=1e-4))
    with pytest.warns(bd.BeamdaeWarning, match="stopped after 1 evaluation") as caught:
        design = bd.optimize(drop, quantities.EndValue("ball.y"), "height", max_evaluations=1)
    assert not any("output" in text for text in [*design.warnings, *map(str, caught)])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("first", [0.02, 5.0])
def test_limits_that_contradict_each_other_are_named(method, first):
    """The search only advised more evaluations."""
    name = quantities.ParameterFunction(lambda width: width, "width")
    other = quantities.ParameterFunction(lambda width: width**2, "square")
    limits = [
        quantities.at_least(name, 2.0),
        quantities.at_most(other, 9.0),
        quantities.at_most(name, 1.0),
    ]
    bounds, given = {"width": (0.01, 10.0)}, {"width": first}
    with pytest.warns(bd.BeamdaeWarning, match="width >= 2, width <= 1 cannot be satisfied"):
        result = bd.optimize(
            cantilever,
            quantities.Mass(),
            "width",
            limits,
            bounds,
            parameters=given,
            method=method,
        )
    assert 1.0 < result.parameters["width"] < 2.0
    feasible = bd.optimize(
        cantilever,
        quantities.Mass(),
        "width",
        limits[:2],
        bounds,
        parameters=given,
        method=method,
    )
    assert feasible.parameters["width"] == pytest.approx(2.0, rel=2e-6)


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("quantity", [quantities.Mass(), quantities.EquilibriumValue("tip.y")])
def test_regression_parameters_whose_neighbors_are_rejected_have_gradients(quantity):
    """Their gradients were zero, and the search converged without moving them."""

    @bd.model(t_end=1.0)
    def strip(height=0.02):
        if height > 0.02:
            raise bd.BeamdaeError("strip: the height must be at most 0.02 m.")
        return cantilever(height=(height,))

    result = bd.optimize(strip, quantity, "height", bounds={"height": (0.01, 0.02)})
    assert result.parameters["height"] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("integrator", "is_advised"), [(ALPHA, False), (bd.GeneralizedAlpha(rtol=1e-3), True)]
)
def test_searches_that_end_before_an_optimum_name_their_cause(integrator, is_advised, monkeypatch):
    def fail(function, begin, **options):
        function(begin)
        return OptimizeResult(x=begin, success=True, status=0, message="success")

    monkeypatch.setattr(solvers, "minimize", fail)
    with pytest.warns(bd.BeamdaeWarning, match="a quantity jumps or has a kink, before an optimum"):
        result = bd.optimize(
            truss,
            quantities.EndValue("crown.y"),
            "rise",
            bounds={"rise": (0.1, 0.3)},
            integrator=integrator,
        )
    assert result.status.kind == "limited"
    assert result.residual > 0.1
    assert ("use a fixed step" in result.status.sentence) is is_advised


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("constant", [0.0, 40.0])
def test_regression_constant_parts_of_the_objective_do_not_hide_failing_designs(constant):
    """With the constant, the search reported that it had converged."""
    size = quantities.ParameterFunction(lambda soft: constant + soft, "size")
    limit = quantities.at_most(quantities.EquilibriumValue("mass.x"), 100.0)
    with pytest.warns(bd.BeamdaeWarning, match="ended next to designs at which analyses fail"):
        result = bd.optimize(pair, size, "soft", limit, {"soft": (0.01, 5.0)})
    assert result.status.kind == "limited"
    assert "soft must be at least 0.5" in result.status.sentence
    assert result.parameters["soft"] >= 0.5


@pytest.mark.parametrize("first", [1.0, 1.01, 1.1, 3.0])
def test_free_minima_of_objectives_with_a_large_constant_converge(first):
    size = quantities.ParameterFunction(lambda soft: 40.0 + (soft - 1.0) ** 2, "size")
    arguments = (pair, size, "soft", (), {"soft": (0.5, 5.0)})
    result = bd.optimize(*arguments, parameters={"soft": first})
    assert result.status.kind == "ok"
    assert result.parameters["soft"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("limit", "margin", "relative", "text"),
    [
        (2e8, -12.4, 0.0, "at its limit"),
        (2e8, 5e7, 0.25, "margin 25 % of the limit"),
        (-2e8, -5e5, -0.0025, "violated by 0.25 % of the limit"),
        (0.0, 0.0123456, float("nan"), "margin 0.0123 Pa"),
        (0.0, -0.5, float("nan"), "violated by 0.5 Pa"),
    ],
)
def test_constraints_state_their_relative_margin(limit, margin, relative, text):
    constraint = Constraint("stress", limit - margin, limit, margin, 0.0, relative, "Pa")
    assert constraint.comparison == text


@pytest.mark.parametrize("limit", ["30 MPa", 30e6])
@pytest.mark.parametrize(
    ("column", "message"),
    [
        ("tip", "'tip' selects several columns; name one of tip.x .m., tip.y .m."),
        ("stres 0", "no column 'stres 0' .did you mean 'stress 0'"),
    ],
)
def test_regression_names_of_columns_are_checked_before_units(limit, column, message):
    """The unit of a group of columns was not known, which hid the names of its columns."""
    limit = quantities.at_most(quantities.EquilibriumValue(column), limit)
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.optimize(cantilever, quantities.Mass(), "width", limit, {"width": (0.001, 0.1)})


@pytest.mark.parametrize("weight", [1e-9, 1.0, 1e9])
def test_regression_optima_do_not_depend_on_the_unit_of_quantities_that_begin_at_zero(weight):
    """Small objectives and limits that were zero at the first design ended the search there."""

    def zero_at(first, second):
        return weight * quantities.ParameterFunction(
            lambda rise, **_: (rise - first) * (rise - second)
        )

    result = bd.optimize(truss, zero_at(0.2, 0.3), "rise", bounds={"rise": (0.1, 0.5)})
    # A change of 1e-4 changes the smallest value by 2.5e-7, and the search ends at 1e-6.
    assert result.parameters["rise"] == pytest.approx(0.25, rel=1e-4)
    limit = quantities.at_most(zero_at(0.2, 0.23), 0.0)
    result = bd.optimize(truss, zero_at(0.2, 0.3), "rise", limit, {"rise": (0.1, 0.5)})
    assert result.status.success
    assert result.parameters["rise"] == pytest.approx(0.23, rel=1e-6)


@pytest.mark.slow(reason="half a second")
def test_limited_bounds_of_several_quantities_are_not_below_the_largest_one():
    several = [quantities.EquilibriumValue(f"stress {k}") for k in range(3)]
    stress = quantities.LargestOf(several, exponent=5.0)
    bounds = {"width": (0.01, 0.1)}
    result = bd.optimize(
        cantilever, quantities.Mass(), "width", [quantities.at_most(stress, 30e6)], bounds
    )
    (limit,) = result.constraints
    (path,) = [x for x in result.analyses if hasattr(x, "columns")]
    largest = max(abs(path[f"stress {k}"].iloc[-1]) for k in range(3))
    assert limit.comparison == "at its limit"
    assert 1.02 < limit.value / largest < 3.0 ** (1.0 / 5.0)


@pytest.mark.slow(reason="half a second and more")
def test_max_evaluations_ends_the_search_with_the_best_design(tmp_path):
    limit = quantities.at_least(quantities.EquilibriumValue("tip.y"), -SAG)
    with pytest.warns(bd.BeamdaeWarning, match="stopped after 2 evaluations; increase"):
        result = bd.optimize(
            cantilever,
            quantities.Mass(),
            "height",
            limit,
            {"height": (0.01, 0.05)},
            parameters={"height": (0.03,)},
            max_evaluations=2,
        )
    assert (result.status.kind, result.evaluations) == ("limited", 2)
    assert result.constraints[0].margin >= 0.0
    lines = result.to_csv(tmp_path / "designs.csv").read_text().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("objective,violation,1: tip.y at equilibrium,height[0]")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("last", [1, 2])
@pytest.mark.parametrize(
    ("failure", "kind", "sentence"),
    [
        (KeyboardInterrupt(), "interrupted", "interrupted after"),
        (RuntimeError("no display"), "failed", "progress failed: RuntimeError: no display"),
    ],
)
@pytest.mark.slow(reason="half a second and more")
def test_searches_that_progress_ends_have_the_best_design_so_far(
    failure, kind, sentence, last, method
):
    def end(count, *_):
        if count == last:
            raise failure

    limit = quantities.at_least(quantities.EquilibriumValue("tip.y"), -SAG)
    arguments = cantilever, quantities.Mass(), "width", limit, {"width": (0.001, 0.1)}
    with pytest.raises((bd.Interrupted, RuntimeError)) as caught:
        bd.optimize(*arguments, progress=end, method=method)
    result = caught.value.partial
    assert (result.status.kind, result.evaluations) == (kind, last)
    assert result.status.sentence.startswith(sentence)


def test_regression_interrupts_during_the_first_gradient_return_the_first_design(monkeypatch):
    """The value of the first design was lost."""

    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(DesignProblem, "scaled_by", interrupt)
    result = bd.optimize(cantilever, quantities.Mass(), "width", partial="return")
    assert (result.status.kind, result.evaluations) == ("interrupted", 1)
    assert result.status.sentence == "interrupted after 1 evaluation"
    assert result.objective == pytest.approx(STEEL.rho * LENGTH * WIDTH * 0.02)


def test_regression_numbers_without_effect_on_all_quantities_are_named():
    """The search stated that it had converged, without a word."""
    with pytest.warns(bd.BeamdaeWarning, match="nor a constraint depends on load at the best"):
        bd.optimize(
            cantilever, quantities.Mass(), ["width", "load"], bounds={"width": (0.01, 0.03)}
        )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"objective": "mass"}, "objective must be a Quantity"),
        ({"by": "heigth"}, "has no parameter 'heigth' .did you mean 'height'"),
        ({"subject_to": [1.0]}, "subject_to must be a list of constraints"),
        ({"bounds": {"load": (0.0, 1.0)}}, "not in by"),
        ({"bounds": {"height": (0.03, 0.05)}}, "around its first value .* parameters"),
        ({"bounds": {"height": ((0.001, 0.001), 0.05)}}, "one per entry .3."),
        ({"method": "COBYLA"}, "method must be one of"),
        ({"progress": 1}, "progress must be a function"),
        ({"progress": lambda: None}, "progress must be a function that accepts 3 arguments"),
        ({"objective": quantities.EquilibriumValue("top.y")}, "top"),
        (
            {"objective": quantities.EquilibriumValue("tip.y [mm]")},
            r"did you mean 'tip.y \[m\]'",
        ),
        ({"objective": quantities.CriticalLoad(1.0)}, "0 critical points"),
    ],
)
def test_invalid_arguments_are_rejected(changes, message):
    arguments = {"model": cantilever, "objective": quantities.Mass(), "by": "height"} | changes
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.optimize(**arguments)


@bd.model(t_end=1.0)
def oscillator(stiffness=30.0):
    mech, _mass = free_ball((1.0, 0.0), velocity=(0.2, 0.0), name="mass", spring=(stiffness,))
    return mech


@bd.model(t_end=0.15)
def shaken_leaf(height=bd.param(0.012, "m")):
    """Cantilever with a mass at its end, whose clamp climbs a step."""
    mech = bd.Mechanism(gravity=EARTH, start="equilibrium")
    axle = mech.add(bd.RigidBody("axle", 1.0, 0.1, (0.0, 0.0)))
    place, center, up = mech.ground.at(0.0, 0.0), axle.at(0.0, 0.0), (0.0, 1.0)
    mech.add(bd.Prismatic("guide", place, center, up))

    def climb(t):
        return 0.01 * (1.0 - np.cos(np.pi * (t - 0.01) / 0.02))

    road = bd.piecewise((0.01, 0.0), (0.03, climb), 0.02)
    mech.add(bd.TranslationalDriver("road", place, center, road, up))
    section = bd.Section.rectangle(STEEL, width=0.05, height=height, damping=1e-4)
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.6, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", center, leaf.start))
    mech.add(bd.PointMass("load", 10.0, on=leaf.end))
    mech.observe("stress", leaf.largest_stress(exponent=150))
    return mech


@pytest.mark.slow(reason="runs of 24 designs")
def test_regression_searches_with_adaptive_steps_end_within_their_tolerance():
    """Jumps of the values kept the violation above 1e-6, and 20 more designs hardly differed."""
    result = bd.optimize(
        shaken_leaf,
        quantities.Mass(),
        "height",
        quantities.at_most(quantities.SmoothMaximum("stress.bound"), "300 MPa"),
        {"height": ("4 mm", "30 mm")},
        parameters={"height": 0.008},
    )
    assert result.status.success
    assert not result.warnings
    # The limit holds to 1e-5, the `rtol` of the runs.
    assert result.constraints[0].value == pytest.approx(300e6, rel=1e-5)
    # There were 32, of which 20 compared jumps of the values.
    assert result.evaluations < 24


def test_regression_only_values_of_runs_with_adaptive_steps_are_noisy():
    """With rtol=1e-2, limits of the mass were satisfied at 1.01 times the limit."""
    limits = [
        quantities.at_most(quantities.Mass(), 1.0),
        quantities.at_most(quantities.EndValue("mass.x"), 1.0),
    ]
    noises = [
        create_problem(
            oscillator,
            quantities.SquaredErrors("mass.x", [1.0], [1.0]),
            "stiffness",
            limits,
            {"stiffness": (5.0, 35.0)},
            None,
            RunSettings(integrator, None, None),
        ).noise.tolist()
        for integrator in (bd.Radau(rtol=1e-2), bd.GeneralizedAlpha(step=0.01))
    ]
    assert noises == [[0.01, 0.0, 0.01], [0.0, 0.0, 0.0]]


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_steps_are_accurate_enough_for_active_limits_of_zero():
    """Changes were relative to a value near zero: use GeneralizedAlpha(step=3e-09)."""
    size = quantities.ParameterFunction(lambda stiffness: stiffness, "stiffness")
    at_rest = quantities.at_least(quantities.EndValue("mass.x_dot"), 0.0)
    method = bd.GeneralizedAlpha(step=0.005)
    result = bd.optimize(oscillator, size, "stiffness", at_rest, {"stiffness": (5.0, 35.0)}, method)
    assert not result.warnings
    assert result.parameters["stiffness"] == pytest.approx(2.25 * np.pi**2, rel=1e-3)


@pytest.mark.slow(reason="a second")
def test_regression_steps_that_change_the_design_are_told():
    # x = 1 + 0.2 sin(w t) / w is 1 at t = 1 s if w = pi.
    target = quantities.SquaredErrors("mass.x", [1.0], [1.0]) * 1e3
    arguments = (
        oscillator,
        target,
        "stiffness",
        quantities.at_most(quantities.EndValue("mass.x_dot"), -0.1),
    )
    with pytest.warns(
        bd.BeamdaeWarning, match="mass.x.* is about .* % of its value, .*; use step="
    ):
        result = bd.optimize(
            *arguments, {"stiffness": (5.0, 35.0)}, bd.GeneralizedAlpha(step=0.25, rho_inf=0.5)
        )
    assert "the error is about" in repr(result)
    result = bd.optimize(*arguments, {"stiffness": (5.0, 35.0)})
    assert not result.warnings
    assert result.parameters["stiffness"] == pytest.approx(np.pi**2, rel=1e-3)


@pytest.mark.filterwarnings("ignore:optimize. no evaluated design")
def test_regression_errors_of_steps_are_relative_to_values_far_beyond_their_limit():
    """Changes were relative to a limit in the wrong unit: 100 % or more."""
    size = quantities.ParameterFunction(lambda stiffness: stiffness, "stiffness")
    limit = quantities.at_most(quantities.EndValue("mass.x"), 1e-6)
    method = bd.GeneralizedAlpha(step=0.01)
    arguments = (oscillator, size, "stiffness", limit, {"stiffness": (25.0, 35.0)}, method)
    result = bd.optimize(*arguments, max_evaluations=3)
    assert result.status.kind == "limited"
    assert not any("the error is about" in x for x in result.warnings)


@pytest.mark.parametrize(
    ("quantity", "label"),
    [
        (quantities.EndValue("tip.y") + quantities.Mass(), "EndValue of tip.y + mass"),
        (
            quantities.EndValue("tip.y") - 2.0 * quantities.Mass(),
            "EndValue of tip.y - 2 mass",
        ),
        (quantities.Mass() - quantities.EndValue("tip.y"), "mass - EndValue of tip.y"),
        (
            quantities.Frequency(2) - 1.05 * quantities.Frequency(1),
            "frequency 2 - 1.05 frequency 1",
        ),
        (-(quantities.Mass() - quantities.Frequency(1)) / 4, "-0.25 mass + 0.25 frequency 1"),
        (-quantities.Mass(), "-mass"),
        (sum([quantities.EndValue("a"), quantities.Mass()]), "EndValue of a + mass"),
        (
            quantities.Mass() + (quantities.EndValue("a") - quantities.EndValue("b")),
            "mass + EndValue of a - EndValue of b",
        ),
    ],
)
def test_sums_of_quantities_and_objectives_have_readable_labels(quantity, label):
    """An objective plus a quantity was rejected, and the difference was '2 + -1 1.05 ...'."""
    assert quantities.at_most(quantity, 1.0).label == f"{label} <= 1"


@pytest.mark.parametrize("term", [quantities.Mass(), quantities.EndValue("tip.y")])
@pytest.mark.parametrize(
    "operation",
    [lambda x: x + 1.0, lambda x: 1.0 + x, lambda x: x - 1.0, lambda x: 1.0 - x, lambda x: x * x,
     lambda x: x / 0.0, lambda x: 1.0 / x],
)  # fmt: skip
def test_other_operands_are_rejected(term, operation):
    with pytest.raises(bd.BeamdaeError, match="is not supported; add objectives and quantities"):
        operation(term)


@bd.model(t_end=1.0)
def hanger(stiffness=bd.param(30.0, "N/m", "stiffness of the spring"), rest=1.0):
    """Mass on a spring."""
    mech, _mass = free_ball((0.0, -rest), name="mass", gravity=9.81, spring=(stiffness,))
    return mech


def read_bounds_of_fit(bounds):
    problem = FitProblem(hanger, {"t [s]": [0.1, 0.2], "mass.y": [-1.0, -1.1]}, ["stiffness"])
    return [float(x[0]) for x in Scaling(problem, bounds, ()).bounds]


def read_bounds_of_optimize(bounds):
    settings = RunSettings(ALPHA, None, None)
    objective = quantities.EndValue("mass.y")
    problem = create_problem(hanger, objective, "stiffness", [], bounds, None, settings)
    return [problem.lower[0], problem.upper[0]]


@pytest.mark.parametrize("read", [read_bounds_of_fit, read_bounds_of_optimize])
def test_bounds_may_be_texts_with_units(read):
    assert read({"stiffness": ("20 N/m", "0.04 N/mm")}) == pytest.approx([20.0, 40.0], rel=1e-14)
    assert read({"stiffness": (20.0, "40N/m")}) == pytest.approx([20.0, 40.0], rel=1e-14)
    for bounds, message in (
        (("20 N", 40.0), "bounds of stiffness=20 N: the unit N measures another quantity"),
        (("20 foo/m", 40.0), "the unit foo/m is unknown"),
        (("low", 40.0), "bounds? of stiffness must be .*'low'"),
    ):
        with pytest.raises(bd.BeamdaeError, match=message):
            read({"stiffness": bounds})


@pytest.mark.slow(reason="half a second")
def test_regression_frequencies_about_an_unbalanced_reference_name_the_remedy():
    """The message was that of mode_sensitivities, about an argument that optimize does not have."""

    @bd.model(t_end=1.0)
    def mass_under_load(stiffness=100.0):
        mech, mass = mass_on_rail(x=1.0)
        anchor = mech.ground.at(0.0, 0.0)
        mech.add(bd.Spring("spring", anchor, mass.point, stiffness, free_length=1.0))
        mech.add(bd.Force("push", mass.point, (5.0, 0.0)))
        return mech

    arguments = "stiffness", (), {"stiffness": (50.0, 150.0)}
    with pytest.raises(bd.BeamdaeError, match=r"^optimize: .*about='equilibrium'"):
        bd.optimize(mass_under_load, quantities.Frequency(1, about="reference"), *arguments)
    for goal in (quantities.Frequency(1), quantities.Frequency(1, about="equilibrium")):
        result = bd.optimize(mass_under_load, goal, *arguments)
        assert result.parameters["stiffness"] == pytest.approx(50.0)


def test_functions_of_parameters_receive_the_parameters_that_they_name():
    parameters = {"height": 2.0, "width": 3.0}
    for function in (lambda height: height, lambda height, **others: height):
        assert quantities.ParameterFunction(function).call(parameters) == 2.0
    assert quantities.ParameterFunction(dict).call(parameters) == parameters


def waves(width, load):
    """Three minima over the width, the lowest of them beside the upper bound."""
    return (load - 40.0) ** 2 / 100.0 + np.cos(2.0 * width) * (1.0 + 0.1 * width)


WAVES = {
    "objective": quantities.ParameterFunction(waves, "waves", "J"),
    "by": ["width", "load"],
    "bounds": {"width": (1.0, 10.0), "load": (10.0, 90.0)},
    "parameters": {"width": 2.0},
}


def test_several_starts_find_the_lowest_of_several_minima(tmp_path):
    single = bd.optimize(cantilever, **WAVES)
    assert single.parameters["width"] == pytest.approx(np.pi / 2.0, rel=0.05)
    assert (single.starts, single.describe_starts()) == (None, "")
    result = bd.optimize(cantilever, **WAVES, starts=8)
    assert result.parameters["width"] == pytest.approx(2.5 * np.pi, rel=0.05)
    table = result.starts
    assert len(table) == 8
    assert table.loc[0, "objective"] == single.objective
    assert table["objective"].min() == result.objective < single.objective
    assert table["first width"].between(1.0, 10.0).all()
    # A Latin hypercube has one point in each of seven intervals.
    cells = np.floor((table["first load"][1:] - 10.0) / (80.0 / 7.0))
    assert sorted(cells) == list(range(7))
    count = int((table["objective"] < result.objective + 1e-3).sum())
    assert f"{count} of 8 searches end at this objective; the next" in result.describe_starts()
    # The result is that of the best search.
    best = table.loc[table["objective"].idxmin()]
    assert result.evaluations == best["evaluations"] == len(result.history())
    assert result.table().loc["width", "first value"] == best["first width"]
    page = result.page(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "searches end at this objective" in page


def test_starts_are_reproducible_by_their_seed():
    first, again, other = (
        bd.optimize(cantilever, **WAVES, starts=3, seed=seed).starts for seed in (1, 1, 2)
    )
    assert first.equals(again)
    assert not first.equals(other)
    assert first.loc[0].equals(other.loc[0])


def test_feasible_designs_are_better_than_lower_objectives():
    def ridge(width):
        # The derivative is zero at the first width.
        return np.cos(2.0 * (width - 1.0))

    limit = quantities.at_most(quantities.ParameterFunction(ridge, "ridge"), -0.95)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        bounds = {"width": (0.9, 2.6), "load": (10.0, 90.0)}
        start = {"width": 1.0}
        width = quantities.ParameterFunction(lambda width: width, "width")
        arguments = (cantilever, width, ["width", "load"], limit, bounds)
        single = bd.optimize(*arguments, parameters=start)
        result = bd.optimize(*arguments, parameters=start, starts=4)
    assert single.constraints[0].margin < -1.0
    assert result.constraints[0].margin == pytest.approx(0.0, abs=1e-6)
    assert result.objective == pytest.approx(1.0 + np.arccos(-0.95) / 2.0)


def fails_above(limit):
    def value(width, load):
        if width > limit:
            raise ValueError(f"a width of {width:.3g} is too large")
        return waves(width, load)

    return quantities.ParameterFunction(value, "waves")


def test_failed_starts_are_listed_and_the_others_are_used():
    arguments = WAVES | {"objective": fails_above(5.0)}
    table = bd.optimize(cantilever, **arguments, starts=6).starts
    is_failed = table["first width"] > 5.0
    assert 0 < is_failed.sum() < 6
    assert (table["status"][is_failed] == "failed").all()
    assert table["reason"][is_failed].str.fullmatch("ValueError: .* is too large").all()
    assert table["objective"][is_failed].isna().all()
    assert (table["evaluations"][is_failed] == 1).all()
    assert table["objective"][~is_failed].notna().all()
    arguments["objective"] = fails_above(0.0)
    message = "optimize: the first designs of all 3 searches failed; the first one: .*too large"
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.optimize(cantilever, **arguments, starts=3)


@pytest.mark.parametrize(
    "bounds", [{}, {"width": (1.0, 10.0)}, WAVES["bounds"] | {"load": (0, np.inf)}]
)
def test_several_starts_need_finite_bounds(bounds):
    with pytest.raises(
        bd.BeamdaeError, match=r"finite bounds of all parameters; pass those of .*load"
    ):
        bd.optimize(cantilever, **WAVES | {"bounds": bounds}, starts=2)


@pytest.mark.parametrize("partial", ["raise", "return"])
def test_interrupts_of_later_searches_return_the_best_design_so_far(partial):
    counts = []

    def interrupt(count, objective, violation):
        counts.append(count)
        if count == 30:
            signal.raise_signal(signal.SIGINT)

    arguments = {**WAVES, "starts": 8, "progress": interrupt, "partial": partial}
    if partial == "raise":
        with pytest.raises(bd.Interrupted) as caught:
            bd.optimize(cantilever, **arguments)
        result = caught.value.partial
    else:
        result = bd.optimize(cantilever, **arguments)
    assert counts == list(range(1, 31))
    assert result.status.kind == "interrupted"
    assert 1 < len(result.starts) < 8
    assert result.starts["objective"].min() == result.objective


def fit_of_oscillator(bounds, log=()):
    times = np.linspace(0.1, 1.0, 10)
    data = {"t [s]": times, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * times)}
    return bd.fit(oscillator, data, "stiffness", ALPHA, sigma=1e-3, bounds=bounds, log=log)


def optimum_of_oscillator(bounds):
    squares = quantities.ParameterFunction(lambda stiffness: (stiffness - 40.0) ** 2)
    return bd.optimize(oscillator, squares, "stiffness", bounds=bounds)


@pytest.mark.parametrize("search", [fit_of_oscillator, optimum_of_oscillator])
@pytest.mark.parametrize("bounds", [(None, 90.0), (10.0, None), (None, None)])
def test_regression_bounds_of_none_are_missing(search, bounds):
    """They were rejected as if they did not contain the first value."""
    result = search({"stiffness": bounds})
    assert result.parameters["stiffness"] == pytest.approx(40.0, rel=1e-2)
    if search is fit_of_oscillator:
        result = search({"stiffness": bounds}, ["stiffness"])
        assert result.parameters["stiffness"] == pytest.approx(40.0, rel=1e-2)


@pytest.mark.parametrize("search", [fit_of_oscillator, optimum_of_oscillator])
@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ((30.0, 30.0), r"must differ, got \(30.0, 30.0\); remove stiffness from by"),
        ((90.0, 10.0), r"must ascend, \(lower, upper\), got \(90.0, 10.0\); exchange them"),
        ((35.0, 90.0), r"around its first value 30.*parameters={'stiffness': value}"),
    ],
)
def test_regression_bounds_that_are_equal_or_descend_are_named(search, bounds, message):
    """All were said not to contain the first value."""
    with pytest.raises(bd.BeamdaeError, match=message):
        search({"stiffness": bounds})


@pytest.mark.parametrize("root", [np.sqrt, math.sqrt, lambda x: x**0.5])
def test_regression_functions_that_end_at_a_bound_have_derivatives(root):
    """Central differences beyond the bound were not finite, and the search failed."""
    cost = quantities.ParameterFunction(lambda stiffness: 0.1 * stiffness - root(stiffness - 30.0))
    result = bd.optimize(oscillator, cost, "stiffness", bounds={"stiffness": (30.0, 90.0)})
    assert result.status.success
    # 0.1 = 0.5 / sqrt(stiffness - 30)
    assert result.parameters["stiffness"] == pytest.approx(55.0, rel=1e-3)
    # A function with a finite slope that ends at its minimum.
    ending = quantities.ParameterFunction(lambda stiffness: stiffness + root(stiffness - 30.0) ** 2)
    result = bd.optimize(oscillator, ending, "stiffness", bounds={"stiffness": (30.0, None)})
    assert result.parameters["stiffness"] == 30.0
    assert result.residual == pytest.approx(0.0, abs=1e-6)


def test_regression_gradients_that_are_not_finite_are_stated_once():
    """The sentence appeared twice, with the name of a Python class."""

    def value(stiffness):
        return (
            (stiffness - 20.0) ** 2 if abs(stiffness - 30.0) < 1e-6 or stiffness > 31.0 else np.nan
        )

    with pytest.raises(
        bd.BeamdaeError, match=r"^optimize: the gradient of cost of oscillator is not"
    ):
        bd.optimize(oscillator, quantities.ParameterFunction(value, "cost"), "stiffness")
    first = {"stiffness": 60.0}
    with pytest.warns(bd.BeamdaeWarning) as caught:
        bd.optimize(
            oscillator,
            quantities.ParameterFunction(value, "cost"),
            "stiffness",
            parameters=first,
        )
    text = str(caught[-1].message)
    assert "BeamdaeError" not in text
    assert text.count("optimize:") == 1


def test_regression_searches_without_bounds_advise_them():
    with pytest.warns(
        bd.BeamdaeWarning, match="positive, got .*; pass bounds= that exclude such designs"
    ):
        bd.optimize(cantilever, quantities.Mass(), "width", bounds={"width": (None, 0.1)})


def test_regression_values_that_are_not_finite_at_the_start_have_advice():
    cost = quantities.ParameterFunction(lambda stiffness: np.inf * stiffness, "cost")
    with pytest.raises(
        bd.BeamdaeError, match=r"cost of oscillator is inf at .*; start from others"
    ):
        bd.optimize(oscillator, cost, "stiffness")


@bd.model(t_end=1.0)
def whole(mass=2, load=1.0):
    return oscillator(stiffness=float(mass))


@pytest.mark.parametrize(
    "call", [bd.sensitivities, lambda *x: bd.optimize(x[0], quantities.Mass(), x[1])]
)
def test_regression_whole_numbers_without_derivative_have_advice(call):
    with pytest.raises(bd.BeamdaeError, match=r"compare whole numbers by sweep, or write 2\.0 in"):
        call(whole, "mass")


def test_regression_first_designs_that_fail_name_meaningless_strains():
    """With E in MPa, the error did not mention units."""
    soft = bd.Material(E=211e3, nu=0.31, rho=7800.0)

    @bd.model(t_end=1.0)
    def leaf(height=0.006):
        section = bd.Section.rectangle(soft, width=0.05, height=height)
        mech, beam = clamped_beam(section, 4, 0.4, name="leaf", formulation="exact")
        mech.add(bd.Force("load", beam.end, (0.0, -300.0)))
        mech.observe("tip", beam.end)
        return mech

    tip = quantities.at_least(quantities.EquilibriumValue("tip.y"), -0.01)
    hint = "the largest strain is .*, far beyond linear elasticity"
    with pytest.raises(bd.BeamdaeError, match=f"did not reach its end.*{hint}.*check .* units"):
        bd.optimize(leaf, quantities.Mass(), "height", tip)
