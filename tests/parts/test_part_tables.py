"""Tables: interpolation, time laws, force formulas, limits, CSV files and sensitivities."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from conformance import integrators
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import CubicSpline, PchipInterpolator, RegularGridInterpolator

import beamdae as bd
from beamdae.analysis.sensitivities.model_differences import difference_model
from beamdae.parts.laws import as_law

X = np.array([-0.4, 0.1, 0.7, 1.5, 3.0])
Y = np.array([2.0, -1.0, 0.2, 0.7, 2.5])
REFERENCES = {
    "linear": lambda x: np.interp(x, X, Y),
    "pchip": lambda x: PchipInterpolator(X, Y)(np.clip(x, X[0], X[-1])),
    "spline": lambda x: CubicSpline(X, Y, bc_type="not-a-knot")(np.clip(x, X[0], X[-1])),
}
every_kind = pytest.mark.parametrize("kind", REFERENCES)


def compile_formula(table, count=1):
    x = ca.SX.sym("x", count)
    return ca.Function("table", [x], [table(*ca.vertsplit(x))])


@pytest.mark.slow(reason="a fifth of a second")
@every_kind
@given(x=st.lists(st.floats(-2.0, 5.0), min_size=1, max_size=20))
def test_numbers_symbols_and_scipy_agree(kind, x):
    table = bd.table(X, Y, kind)
    expected = REFERENCES[kind](np.array(x))
    # Rounding errors of cubic polynomials of values up to ten.
    assert_allclose(table(np.array(x)), expected, atol=1e-13)
    formula = compile_formula(table)
    assert_allclose([float(formula(value)) for value in x], expected, atol=1e-13)
    assert table(x[0]) == table(np.array(x))[0]


@pytest.mark.parametrize(
    ("x", "y"),
    [
        ([0.0, 1e-12, 1.0, 2.0, 3.0, 4.0], [0.0, 5e-15, 0.005, 0.01, 0.015, 1.0]),
        ([0.0, 1e-11, 1.0, 2.0, 3.0, 4.0], [100.0, 100.0, 100.01, 100.02, 100.03, 100.04]),
        ([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1e-20, 3e-20, 1e-10, 1.0]),
    ],
    ids=["step", "line", "decades"],
)
def test_regression_short_intervals_keep_the_slopes_of_other_rows(x, y):
    # Slopes below a bound from the shortest interval were zero in the whole table.
    places, argument = np.array([1e-13, 0.3, 1.0, 1.2, 1.5, 2.5, 3.5]), ca.SX.sym("x")
    pchip, spline = PchipInterpolator(x, y), CubicSpline(x, y, bc_type="not-a-knot")
    for kind, reference in (("pchip", pchip), ("spline", spline)):
        table = bd.table(x, y, kind)
        value = table(argument)
        formula = ca.Function("table", [argument], [value, ca.gradient(value, argument)])
        values, slopes = np.array([[float(n) for n in formula(place)] for place in places]).T
        assert_allclose(values, table(places), rtol=1e-12, atol=1e-28)
        assert_allclose(slopes[1:], reference(places[1:], 1), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("kind", ["linear", "spline"])
def test_grids_are_products_of_the_interpolations_of_both_arguments(kind):
    z, rng = np.array([0.0, 1.0, 1.5, 4.0]), np.random.default_rng(0)
    values = rng.normal(size=(len(X), len(z)))
    table = bd.table((X, z), values, kind)
    x = np.column_stack([rng.uniform(-1.0, 4.0, 30), rng.uniform(-1.0, 5.0, 30)])
    inside = np.clip(x, [X[0], z[0]], [X[-1], z[-1]])
    if kind == "linear":
        expected = RegularGridInterpolator((X, z), values)(inside)
    else:
        rows = CubicSpline(X, values, bc_type="not-a-knot")(inside[:, 0])
        expected = [
            CubicSpline(z, row, bc_type="not-a-knot")(place)
            for row, place in zip(rows, inside[:, 1], strict=True)
        ]
    assert_allclose(table(*x.T), expected, atol=1e-13)
    formula = compile_formula(table, 2)
    assert_allclose([float(formula(place)) for place in x], expected, atol=1e-13)


@every_kind
def test_slopes_of_formulas_are_derivatives_and_zero_outside(kind):
    table, x = bd.table(X, Y, kind), ca.SX.sym("x")
    slope = ca.Function("slope", [x], [ca.jacobian(table(x), x)])
    h = 1e-6
    for place in (-0.2, 0.4, 1.1, 2.9):
        expected = (table(place + h) - table(place - h)) / (2.0 * h)
        assert_allclose(float(slope(place)), expected, rtol=1e-8)
    assert float(slope(-0.5)) == float(slope(3.1)) == 0.0


def test_linear_time_laws_have_breakpoints_at_kinks_only():
    law = as_law("test", bd.table([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 2.0, 0.0, 0.0], "linear"))
    assert law.breakpoints == (0.0, 2.0, 3.0)
    assert law.time_scale is None
    assert [law.at(t) for t in (-1.0, 0.5, 1.5, 2.5, 9.0)] == [0.0, 0.5, 1.5, 1.0, 0.0]


@every_kind
def test_tables_in_formulas_of_time_have_smooth_pieces(kind):
    table = bd.table(X, Y, kind)
    law = as_law("test", lambda t: 2.0 * table(3.0 - 2.0 * t) + np.sin(t))
    times = np.sort((3.0 - X) / 2.0)
    assert_allclose(law.breakpoints, times if kind == "linear" else times[[0, -1]], rtol=1e-15)
    scale = None if kind == "linear" else pytest.approx(4.0 * 0.25)
    assert law.time_scale == scale
    for t in np.linspace(-0.5, 2.5, 31):
        assert_allclose(law.at(t), 2.0 * table(3.0 - 2.0 * t) + np.sin(t), rtol=1e-14, atol=1e-14)
    # The piece before a breakpoint continues beyond the breakpoint, without a kink.
    time = ca.SX.sym("time", 2)
    rate = ca.Function("rate", [time], [ca.jacobian(law(time), time)[0]])
    after = times[1] + 0.01
    inside = 0.5 * (times[0] + times[1])
    h = 1e-3
    change = float(rate([after, inside])) - float(rate([times[1] - h, inside]))
    assert abs(change) < 0.2


STAIRS, FORCES = [0.1, 0.25, 0.3, 0.4], [1.0, -2.0, -2.0, 5.0]


def impulse(t, first=1.0):
    """Return the integral of the staircase from zero to t."""
    edges, values = np.array([0.0, 0.25, 0.4, np.inf]), np.array([first, -2.0, 5.0])
    return np.sum(values * np.clip(np.subtract.outer(t, edges[:-1]), 0.0, np.diff(edges)), axis=1)


def test_held_values_are_those_of_the_last_row():
    table = bd.table(STAIRS, FORCES, "previous")
    x = np.array([-1.0, 0.1, np.nextafter(0.25, 0.0), 0.25, 0.3, 0.39, 0.4, 9.0])
    expected = [1.0, 1.0, 1.0, -2.0, -2.0, -2.0, 5.0, 5.0]
    assert_array_equal(table(x), expected)
    law = as_law("push", table)
    # Rows without a jump are no breakpoints; nor is the first one.
    assert law.breakpoints == (0.25, 0.4)
    assert_array_equal([law.at(t) for t in x], expected)
    later = as_law("push", lambda t: 3.0 * table(2.0 * t - 0.5))
    assert_allclose(later.breakpoints, [0.375, 0.45], rtol=1e-15)
    assert [later.at(t) for t in (0.37, 0.38, 0.46)] == [3.0, -6.0, 15.0]


@integrators(rtol=1e-6, step=0.05)
def test_held_forces_have_the_impulse_of_a_staircase(integrator):
    solution = run(
        bd.table(STAIRS, FORCES, "previous"), integrator, t_end=0.5, on="force", step=0.05
    )
    table = solution.table()
    t = table["t [s]"].to_numpy()
    # Rounding errors, since the speed is linear between breakpoints.
    assert_allclose(table["ball.x_dot [m/s]"], 1.0 + impulse(t), atol=1e-9)
    assert solution.status.success


def test_held_values_end_a_run_where_the_table_ends():
    solution = run(bd.table(STAIRS, FORCES, "previous", "error"), t_end=0.5, on="force")
    assert "x = 0 leaves the range 0.1 to 0.4 of table" in solution.status.sentence
    shifted = bd.table(np.subtract(STAIRS, 0.1), FORCES, "previous", "error")
    solution = run(shifted, t_end=0.5, on="force")
    assert_allclose(solution.trajectory.end, 0.3, rtol=1e-12)


def test_held_values_are_read_from_csv_files(tmp_path):
    path = tmp_path / "steps.csv"
    path.write_text("time [ms],force [kN]\n0,1\n250,-2\n", "utf-8")
    table = bd.table_from_csv(path, kind="previous")
    assert_array_equal(table([0.0, 0.2, 0.25, 1.0]), [1e3, 1e3, -2e3, -2e3])


def test_formulas_of_time_with_other_arguments_are_refused():
    table = bd.table(X, Y)
    with pytest.raises(bd.BeamdaeError, match=r"push: .* each argument of table must be a t \+ b"):
        as_law("push", lambda t: table(t**2))
    with pytest.raises(bd.BeamdaeError, match="must be smooth, but uses fabs"):
        as_law("push", lambda t: abs(table(t)))
    grid = bd.table((X, X), np.outer(Y, Y))
    with pytest.raises(bd.BeamdaeError, match="push: table has two arguments and is no time law"):
        as_law("push", grid)
    assert as_law("push", lambda t: grid(t, 0.7)).at(1.5) == pytest.approx(0.7 * 0.2, rel=1e-14)


def run(law, integrator=None, t_end=1.0, on=None, velocity=1.0, step=None):
    """Return a run of a mass of 1 kg that moves along x under a law of force."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.1, 0.0), velocity=(velocity, 0.0)))
    if on is None:
        mech.add(bd.ForceLaw("push", ball.point, lambda ball, t: (law(ball.position[0]), 0.0)))
    else:
        mech.add(bd.Force("push", ball.point, (law, 0.0)))
    mech.observe("ball", ball.point)
    integrator = bd.Radau(1e-8) if integrator is None else integrator
    return bd.simulate(mech, integrator, t_end=t_end, output_step=step or t_end)


# Bilinear spring: half periods with the frequencies of both sides.
SOFT, STIFF = 40.0, 360.0
BILINEAR = bd.table([-1.0, 0.0, 1.0], [STIFF, 0.0, -SOFT], "linear")
PERIOD = np.pi / np.sqrt(SOFT) + np.pi / np.sqrt(STIFF)


def bilinear_error(integrator):
    """Return the error of the position after three quarters of a soft half and whole periods."""
    solution = run(BILINEAR, integrator, t_end=4.0 * PERIOD, velocity=0.0)
    assert solution.status.success
    return abs(solution.table()["ball.x [m]"].iloc[-1] - 0.1) + 0.1 * abs(
        solution.table()["ball.x_dot [m/s]"].iloc[-1]
    )


@pytest.mark.slow(reason="three runs with thousands of steps")
def test_fixed_steps_keep_their_order_across_kinks():
    errors = [bilinear_error(bd.GeneralizedAlpha(step=PERIOD / n)) for n in (100, 200, 400)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    # Second order: a kink changes the error of one step by a term of third order.
    assert_allclose(orders, 2.0, atol=0.15)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("method", [bd.Radau, bd.Ida])
def test_adaptive_steps_keep_their_accuracy_across_kinks(method):
    errors = [bilinear_error(method(rtol)) for rtol in (1e-4, 1e-6, 1e-8)]
    # Errors of a smooth oscillator of this length are up to 20 rtol of its amplitude.
    assert np.all(np.array(errors) < 20.0 * np.array([1e-4, 1e-6, 1e-8]) * 0.1 * 20.0)


@pytest.mark.parametrize("kind", ["linear", "pchip"])
@pytest.mark.parametrize("method", [bd.Radau(1e-6), bd.Ida(1e-6)], ids=lambda x: x.method)
def test_steps_do_not_pass_over_peaks(kind, method):
    """A peak of 2 mm in the way of a free mass, whose work is known."""
    width, height = 1e-3, 4e3
    peak = bd.table([0.0, 5.0 - width, 5.0, 5.0 + width, 20.0], [0.0, 0.0, -height, 0.0, 0.0], kind)
    solution = run(peak, method, velocity=10.0)
    lost = 50.0 - 0.5 * solution.table()["ball.x_dot [m/s]"].iloc[-1] ** 2
    # Both kinds are symmetric about the middle of each flank.
    assert_allclose(lost, width * height, rtol=2e-5)


@pytest.mark.parametrize(
    "method", [bd.Radau(1e-6), bd.Ida(1e-6), bd.GeneralizedAlpha(step=1e-2)], ids=str
)
def test_runs_stop_where_the_argument_leaves_the_table(method):
    curve = bd.table([0.0, 1.0, 2.0], [0.0, 0.0, 0.0], "linear", "error", "curve")
    solution = run(curve, method, t_end=5.0)
    assert solution.status.kind == "limited"
    assert "s: push: x = 2." in solution.status.sentence
    assert solution.status.sentence.endswith("leaves the range 0 to 2 of curve")
    assert_allclose(solution.trajectory.end, 1.9, rtol=1e-6)
    held = run(bd.table([0.0, 1.0], [0.0, 0.0], "linear"), method, t_end=5.0)
    assert held.status.success


@pytest.mark.slow(reason="four runs")
def test_runs_stop_at_the_end_of_a_table_of_time():
    curve = bd.table([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], outside="error", name="pulse")
    solution = run(curve, t_end=3.0, on="time")
    assert solution.status.sentence.startswith("stopped at t = 2 s: x = 2 leaves the range 0 to 2")
    assert solution.trajectory.end == 2.0
    assert run(bd.piecewise((1.5, curve), 0.0), t_end=3.0, on="time").status.success
    late = run(bd.piecewise((1.0, 0.0), (2.5, curve), 0.0), t_end=3.0, on="time")
    assert late.trajectory.end == 2.0
    scaled = run(lambda t: 3.0 * curve(0.5 * t), t_end=5.0, on="time")
    assert scaled.trajectory.end == 4.0


def test_a_start_outside_the_table_is_reported():
    curve = bd.table([1.0, 2.0, 3.0], [0.0, 1.0, 0.0], outside="error", name="curve")
    sentence = run(curve).status.sentence
    assert sentence == "stopped at t = 0 s: push: x = 0.1 leaves the range 1 to 3 of curve"


def test_numbers_outside_a_table_and_symbols_outside_formulas_are_refused():
    curve = bd.table([1.0, 2.0], [0.0, 1.0], "linear", "error", "curve")
    with pytest.raises(bd.BeamdaeError, match=r"curve: x = 3 leaves the range 1 to 2 of curve"):
        curve(np.array([1.5, 3.0]))
    with pytest.raises(bd.BeamdaeError, match=r"curve: outside='error' requires"):
        curve(ca.SX.sym("x"))


@bd.model(t_end=1.0)
def table_spring(stiffness=40.0, kind="linear"):
    """Mass on a spring with the tension stiffness times elongation, as a table."""
    x = np.linspace(-0.5, 0.5, 6)
    curve = bd.table(x, stiffness * x, kind)
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 2.0, at=(1.0, 0.0), velocity=(0.3, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0, 0), mass.point, law=curve))
    mech.observe("mass", mass.point)
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "kind", [pytest.param("linear", marks=pytest.mark.slow(reason="two models")), "spline"]
)
def test_sensitivities_by_values_of_a_table(kind):
    result = bd.sensitivities(table_spring, "stiffness", bd.Radau(1e-8), parameters={"kind": kind})
    k, h = 40.0, 1e-30

    def position(k):
        omega = np.sqrt(k / 2.0)
        return 0.3 / omega * np.sin(omega * result.t)

    exact = position(k + 1j * h).imag / h
    assert_allclose(
        result.sensitivity("mass.x", "stiffness"), exact, atol=1e-6 * np.max(np.abs(exact))
    )


@pytest.mark.slow(reason="assembles a long table for several parameters")
@pytest.mark.parametrize("rows", [(300,), (10, 10)], ids=["curve", "grid"])
def test_regression_numbers_of_long_tables_have_derivatives(rows):
    # Coefficients of polynomials had rounding errors of 1e-5, which hid their derivatives.
    def model(stiffness=100.0):
        mech, axes = bd.Mechanism(), tuple(np.linspace(-1.0, 1.0, n) for n in rows)
        x = stiffness * axes[0] + 50.0 * axes[0] ** 3
        law = bd.table(axes[0], x) if len(rows) == 1 else bd.table(axes, x[:, None] + axes[1] ** 2)
        mass = mech.add(bd.PointMass("mass", 2.0, at=(1.0, 0.0)))
        force = law if len(rows) == 1 else lambda x, rate: law(x, rate)
        mech.add(bd.Spring("spring", mech.ground.at(0, 0), mass.point, free_length=1.0, law=force))
        return mech

    def assemble(mechanism):
        return bd.equations_of_motion(mechanism)

    named = bd.model(t_end=1.0)(model)
    values = {"stiffness": 100.0}
    difference = difference_model(named, "stiffness", values, assemble(named()), assemble)
    slopes = difference.derivative(lambda e: e.p)
    exact = (assemble(model(101.0)).p - assemble(model(99.0)).p) / 2.0
    assert_allclose(slopes, exact, atol=1e-9)


def test_models_with_other_values_share_kernels():
    first, second = (
        bd.equations_of_motion(table_spring(stiffness=k, kind="spline")) for k in (40.0, 55.0)
    )
    assert first.structure is second.structure


def write(folder, text):
    path = folder / "pad.csv"
    path.write_text(text, "utf-8")
    return path


def test_csv_columns_are_converted_to_si_units(tmp_path):
    path = write(tmp_path, "time [ms], travel [mm],force\xa0[kN]\n0,0,0\n1,5,1\n2,10,4\n")
    table = bd.table_from_csv(path, "travel", "force [kN]", kind="linear", outside="error")
    assert_allclose(table(np.array([0.0, 0.0025, 0.01])), [0.0, 500.0, 4000.0], rtol=1e-15)
    by_time = bd.table_from_csv(path, "time", "travel", kind="linear")
    assert_allclose(by_time(0.0005), 0.0025, rtol=1e-15)
    with pytest.raises(
        bd.BeamdaeError, match=r"travel = 0.02 leaves the range 0 to 0.01 of table pad"
    ):
        table(0.02)


def test_regression_columns_without_units_have_a_warning(tmp_path):
    """Forces of 58 kN were 58 N without a word."""
    with pytest.warns(bd.BeamdaeWarning, match=r"pad\.csv: 'force' has no unit and is taken in SI"):
        bd.table_from_csv(write(tmp_path, "travel [mm],force\n0,0\n1,3\n2,9\n"))
    with pytest.warns(bd.BeamdaeWarning, match=r"'travel', 'force' have no units .* \[mm\]', or"):
        bd.table_from_csv(write(tmp_path, "travel,force\n0,0\n1,3\n2,9\n"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.table_from_csv(
            write(tmp_path, "angle [deg],factor [-],note\n0,0,a\n1,3,\n"),
            "angle",
            "factor",
            "linear",
        )


def test_regression_csv_units_in_parentheses_are_converted(tmp_path):
    text = "# press 3, 2024-05-06\ntravel (mm),force (measured) (kN)\n0,0\n1,3\n2,9\n"
    table = bd.table_from_csv(write(tmp_path, text), kind="linear")
    assert_allclose(table(1e-3), 3000.0, rtol=1e-15)
    assert table.arguments == ("travel",)
    words = bd.table_from_csv(write(tmp_path, "flow_in,F_min\n0,0\n1,3\n2,9\n"), y="flow_in")
    assert words.arguments == ("F_min",)
    plain = bd.table_from_csv(write(tmp_path, "x (down),F\n0,0\n1,3\n2,9\n"), kind="linear")
    assert plain.arguments == ("x (down)",)
    assert plain(1.0) == 3.0


@pytest.mark.parametrize("header", ["F_cs", "p_ug", "x_cg", "omega_gn", "height (h)", "F (a)"])
def test_regression_names_that_end_like_units_are_names(tmp_path, header):
    """The words after underscores, and h, were read as units."""
    table = bd.table_from_csv(write(tmp_path, f"x,{header}\n0,0\n1,3\n2,9\n"), kind="linear")
    assert table(1.0) == 3.0


def test_regression_commas_that_may_separate_thousands_are_named(tmp_path):
    path = write(tmp_path, "t [s];F [N]\n0;1,200\n1;1,500\n")
    with pytest.warns(
        bd.BeamdaeWarning, match=r"numbers of .* such as 1,200 are read with decimal"
    ):
        table = bd.table_from_csv(path, kind="linear")
    assert table(0.0) == 1.2


@pytest.mark.parametrize(
    "text",
    [
        "travel [mm];force [kN]\n0;0\n1,5;3,5\n3;7\n",
        "sep=;\ntravel (mm);force (kN)\n0;0\n1,5;3,5\n3;7\n",
        "travel [mm]\tforce [kN]\n0\t0\n1,5\t3,5\n3\t7\n",
        "% press 3\n// raw\ntravel [mm],force [kN],\n0,0,\n1.5,3.5,\n,,\n3,7,\n",
        "# travel [mm],force [kN]\n0,0\n1.5,3.5\n3,7\n",
        "# travel [mm],force [kN]\n# recorded 2024-05-01, sensor 3\n0,0\n1.5,3.5\n3,7\n",
        "# travel [mm],force [kN]\n# recorded by hand\n0,0\n1.5,3.5\n3,7\n",
        "# travel,force\n# mm,kN\n0,0\n1.5,3.5\n3,7\n",
        "press 3;;\noperator;Smith, M.;\ntravel;force\n[mm];[kN]\n0;0\n1,5;3,5\n3;7\n",
    ],
)
def test_regression_tables_read_the_files_that_fit_reads(tmp_path, text):
    """Semicolons, decimal commas, tabs, and other comments than "#" were rejected."""
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        path = tmp_path / "pad.csv"
        path.write_text(text, encoding)
        table = bd.table_from_csv(path, kind="linear")
        assert_allclose(table(1.5e-3), 3500.0, rtol=1e-15)
        assert table.arguments == ("travel",)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("N·m", 1.0),
        ("N.m", 1.0),
        ("N-m", 1.0),
        ("kNm", 1e3),
        ("Nmm", 1e-3),
        ("deg/s", np.pi / 180),
        ("°/s", np.pi / 180),
        ("rpm", np.pi / 30),
        ("1/min", np.pi / 30),
        ("min⁻¹", np.pi / 30),
        ("um", 1e-6),
        ("μm", 1e-6),
        ("%", 1e-2),
        ("m/s²", 1.0),
        ("m/s2", 1.0),
        ("gn", 9.80665),
        ("km/h", 1 / 3.6),
        ("µm/m", 1e-6),
        ("psi", 6894.757293168361),
        ("ksi", 6894757.293168361),
        ("kip", 4448.2216152605),
        ("klbf", 4448.2216152605),
        ("kip/in", 4448.2216152605 / 0.0254),
        ("N/mm²", 1e6),
        ("in / s", 0.0254),
        ("in-lbf", 0.0254 * 4.4482216152605),
        ("lb/ft^3", 0.45359237 / 0.3048**3),
        ("kg mm^2", 1e-6),
        ("mm^-1", 1e3),
    ],
)
def test_units_of_tables(tmp_path, unit, factor):
    path = tmp_path / "pad.csv"
    path.write_text(f"t [s],y [{unit}]\n0,0\n1,2\n", "utf-8")
    assert_allclose(bd.table_from_csv(path, kind="linear")(1.0), 2.0 * factor, rtol=1e-14)


def test_tables_of_files_have_a_name(tmp_path):
    path = tmp_path / "pad.csv"
    path.write_text("t [s],y [m]\n0,0\n1,2\n", "utf-8")
    assert bd.table_from_csv(path, kind="linear").name == "table pad.csv"
    assert bd.table_from_csv(path, kind="linear", name="punch").name == "punch"
    with pytest.raises(bd.BeamdaeError, match="punch: kind must be"):
        bd.table_from_csv(path, kind="cubic", name="punch")


def test_csv_rows_of_two_arguments_form_a_grid(tmp_path):
    rows = ["x [mm],speed [m/s],F [N]", "0,1,3", "1,0,2", "1,1,4", "0,0,1", "2,0,5", "2,1,6"]
    path = write(tmp_path, "\n".join(rows))
    table = bd.table_from_csv(path, x=("x", "speed"), y="F", kind="linear")
    assert_allclose(table(5e-4, 0.5), 2.5, rtol=1e-14)
    path = write(tmp_path, "\n".join(rows[:-1]))
    with pytest.raises(
        bd.BeamdaeError, match=r"table pad.csv: the rows must form a grid of 3 by 2"
    ):
        bd.table_from_csv(path, x=("x", "speed"), y="F", kind="linear")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; write a table with a header"),
        ("x [mm],F [stone]\n0,1\n1,2\n2,3\n", r"unit of 'F \[stone\]' is unknown"),
        ("x,F\n0,1\n1\n", "row 2 of 'F' must be a finite number, got ''"),
        ("x,F\n0,1\n1,two\n2,3\n", "row 2 of 'F' must be a finite number, got 'two'"),
        ("x,F\n0,1\n1,nan\n2,3\n", "row 2 of 'F' must be a finite number, got 'nan'"),
        ("x,F\n0,1\n1,1_000\n2,3\n", "row 2 of 'F' must be a finite number, got '1_000'"),
        ("x,x\n0,1\n", "contains the column 'x' twice; rename one"),
        ("x,F\a\n0,1\n", r"the header 'F\\x07' of .* contains unprintable characters"),
        ("x\n0\n1\n2\n", "no separators of columns in its header 'x'; separate the columns by com"),
        ("x,\n0,\n1,\n2,\n", "the file has 0 columns besides x; pass y="),
        ("t,x,F\n0,0,0\n1,1,2\n", "the file has 3 columns: t, x, F; pass x= and y="),
        ("x [mm];F [kN]\n0.5;0\n1,5;3,5\n", "it contains the numbers 1,5 and 0.5; write a header"),
        ("x [mm],F [kn]\n0,1\n1,2\n", r"unit of 'F \[kn\]' is unknown \(did you mean 'kN'\?\);"),
        ("x [mm],p [mpa]\n0,1\n1,2\n", r"\(did you mean 'MPa' or 'mPa'\?\); write a unit such"),
        ("t [s],a [g]\n0,1\n1,2\n", r"unit g of 'a \[g\]' is ambiguous; write the values in kg or"),
        ("t [s],a [mg]\n0,1\n1,2\n", r"unit mg of 'a \[mg\]' is ambiguous"),
        ("t [s],M [in-lb]\n0,1\n1,2\n", r"unknown \(lb is a mass, write lbf for a force\); wr"),
        ("t [s],k (lb/in)\n0,1\n1,2\n", r"'k \(lb/in\)' is unknown \(lb is a mass, write lbf"),
        ("t [s],p [kg/cm^2]\n0,1\n1,2\n", r"unknown \(kg is a mass, write kgf, N or Pa for"),
        ("t [s],x [in mm]\n0,1\n1,2\n", r"unit of 'x \[in mm\]' is unknown \(omit the word in"),
        ("t [s],x (in mm)\n0,1\n1,2\n", r"unit of 'x \(in mm\)' is unknown \(omit the word in"),
        ("t [s],v [ms-1]\n0,1\n1,2\n", r"unknown \(write a quotient, such as m/s, N/m or 1/ms\)"),
        ("t [s],k [kNm⁻¹]\n0,1\n1,2\n", r"unknown \(write a quotient, such as m/s, N/m or 1/ms"),
        ("t [s],p (kg/cm²)\n0,1\n1,2\n", r"unknown \(kg is a mass, write kgf, N or Pa for"),
        ("t [s],F (KN)\n0,1\n1,2\n", r"unit of 'F \(KN\)' is unknown \(did you mean 'kN'\?\);"),
        ("t [s],F (lbs)\n0,1\n1,2\n", r"unknown \(did you mean 'lb' or 'lbf'\?\);"),
        ("x,F\n0,1\n#DIV/0!,2\n2,3\n", "row 2 of 'x' must be a finite number, got '#DIV/0!'"),
        ("x,F\n0,1\n#N/A,2\n2,3\n", "row 2 of 'x' must be a finite number, got '#N/A'"),
        ("# x,F\n# a,b\n0,1\n1,2\n2,3\n", "may be the header: 'x,F' and 'a,b'; write one"),
        ("t [s],M [nm]\n0,1\n1,2\n", r"unit nm of .* is ambiguous; write the values in m or N m"),
        ("0,0\n1,3\n2,4\n", "has no header; write a first line such as 't"),
        (
            "x_mm,F\n0,1\n1,2\n2,3\n",
            r"the header 'x_mm' seems to contain the unit mm; write it in br",
        ),
        ("x,F / kN\n0,1\n1,2\n2,3\n", "the header 'F / kN' seems to contain the unit kN"),
        ("x,F in kN\n0,1\n1,2\n2,3\n", "the header 'F in kN' seems to contain the unit kN"),
        ("x,F [kN] measured\n0,1\n1,2\n2,3\n", "seems to contain the unit kN"),
        ("x [mm] (left),F\n0,1\n1,2\n2,3\n", "seems to contain the unit mm"),
        ("x,F\n0,1\n1,2\n1,3\n", "x must ascend, but 1 is followed by 1"),
    ],
)
def test_messages_about_csv_files(tmp_path, text, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.table_from_csv(write(tmp_path, text))


@pytest.mark.parametrize(
    ("rows", "remedy"),
    [
        ("0,0\n5,1\n10,4\n5,0.5\n0,0\n", "0.01 is followed by 0.005; .*or make a table of each"),
        ("10,4\n5,1\n0,0\n", "0.01 is followed by 0.005; reverse the order of the rows"),
    ],
)
def test_regression_measured_loops_and_descending_tables_are_named(tmp_path, rows, remedy):
    """The file had no name, and sorting a loop mixes its branches."""
    path = tmp_path / "pad.csv"
    path.write_text(f"travel [mm],force [kN]\n{rows}", "utf-8")
    with pytest.raises(bd.BeamdaeError, match=rf"^table pad\.csv: x must ascend, but {remedy}"):
        bd.table_from_csv(path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bd.table(X, Y, "cubic"), "table: kind must be one of .*, got 'cubic'"),
        (lambda: bd.table(X, Y, outside="stop"), "table: outside must be one of 'hold', 'error'"),
        (
            lambda: bd.table(X, Y, outside="repeat"),
            "the first and last values must be equal, got 2 and 2.5; end the table one period aft",
        ),
        (
            lambda: bd.table((X, X), np.outer(Y, Y), outside="repeat"),
            "table: outside='repeat' is not defined for two arguments",
        ),
        (
            lambda: as_law("push", bd.table([0, 1, 2], [0, 1, 0], "linear", outside="repeat")),
            "push: table is repeated and linear, so that a law of time would have breakpoints",
        ),
        (
            lambda: bd.table([0, 1, 2], [0, 1, 0], "previous", outside="repeat"),
            "table: outside='repeat' is not defined for kind='previous'; repeat the rows of one",
        ),
        (
            lambda: run(bd.table(X, Y, "previous")),
            "table: kind='previous' jumps at the rows, where integrators stop only in time laws; ",
        ),
        (
            lambda: bd.table((X, X), np.outer(Y, Y), "previous"),
            "table: kind='previous' is not defined for two arguments; use 'linear' or 'spline'",
        ),
        (lambda: bd.table([0.0, 1.0], [0.0, 1.0]), "x must have at least 3 entries for kind='spl"),
        (
            lambda: bd.table(3.0, Y),
            "table: x must be a list of numbers or a pair of lists, got 3.0",
        ),
        (lambda: bd.table([], []), "table: x must be a list of numbers or a pair of lists"),
        (lambda: bd.table((X, X), np.outer(Y, Y), "pchip"), "is not defined for two arguments"),
        (lambda: bd.table((X, X), Y), r"table: y\[0\] must be a list of numbers"),
        (lambda: bd.table((X, X), np.outer(Y, Y[:3])), "y must have 5 rows of 5 values"),
        (lambda: bd.table(X, Y)(1.0, 2.0), r"table: the table has 1 argument \(x\), got 2"),
        (lambda: bd.table(X, Y)("far"), "arguments must be numbers, arrays or symbols"),
        (lambda: bd.table_from_csv(3), "table_from_csv: path must be a path, got 3"),
        (
            lambda: bd.table_from_csv("\ud800"),
            r"the path '\\ud800' is too long or contains unpr",
        ),
        (lambda: bd.table_from_csv("a\x1b\n\0"), r"the path 'a\\x1b\\n\\x00' is too long or con"),
        (lambda: bd.table_from_csv("no.csv"), "'no.csv' cannot be read: No such file"),
    ],
)
def test_messages(make, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        make()


@pytest.mark.slow(reason="half a second")
def test_equilibria_outside_a_table_are_reported():
    """A weight of 20 N on a table that ends at 10 N; the held value leaves it without support."""
    curve = bd.table([0.0, 1.0], [0.0, 10.0], "linear", "error", "pad")
    mech = bd.Mechanism(gravity=(0.0, -10.0))
    ball = mech.add(bd.PointMass("ball", 2.0, at=(0.0, 1.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 1.0), ball.point, (0.0, 1.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), ball.point, 25.0, free_length=2.6))
    mech.add(bd.ForceLaw("push", ball.point, lambda ball, t: (0.0, -curve(ball.position[1]))))
    with pytest.warns(bd.BeamdaeWarning, match=r"push: x = .* leaves the range 0 to 1 of pad"):
        bd.equilibrium(mech)


@pytest.mark.slow(reason="assembles the equations twice")
def test_tables_begin_when_events_change_a_law():
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1))
    shaft = mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0)
    mech.add(bd.Revolute("bearing", *shaft))
    motor = mech.add(bd.Driver("motor", *shaft, lambda t: t))
    swing = bd.table([0.0, 0.5, 1.0], [0.0, 0.5, 0.2], outside="error", name="swing")
    mech.observe("disk", disk.at(0.0, 0.0))
    mech.when("disk.angle", crosses=0.7, do=bd.change_law(motor, swing), name="change")
    solution = bd.simulate(mech, bd.Radau(1e-6), t_end=3.0, output_step=0.1)
    table = solution.table()
    later = table["t [s]"] > 0.75
    expected = 0.7 + swing(np.minimum(table["t [s]"][later].to_numpy() - 0.7, 1.0))
    assert_allclose(table["disk.angle [rad]"][later], expected, atol=1e-6)
    assert_allclose(solution.trajectory.end, 1.7, rtol=1e-6)
    assert "leaves the range 0 to 1 of swing" in solution.status.sentence


def test_regression_headers_that_differ_in_their_unit_are_ambiguous(tmp_path):
    file = tmp_path / "pad.csv"
    file.write_text("travel [mm],force [N],force [kN]\n0,0,0\n1,9,8\n", "utf-8")
    message = (
        r"y='force' is the name of several columns of .*pad.csv: force \[N\], force \[kN\]; "
        "pass the header with its unit"
    )
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.table_from_csv(file, "travel", "force", kind="linear")
    assert bd.table_from_csv(file, "travel", "force [kN]", kind="linear")(1e-3) == 8000.0
    file.write_text("travel [mm],force,force [kN]\n0,0,0\n1,9,8\n", "utf-8")
    assert bd.table_from_csv(file, "travel", "force", kind="linear")(1e-3) == 9.0


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("outside", ["hold", "error"])
def test_regression_linear_models_outside_a_table_carry_a_warning(outside):
    """The held value of a table has no slope."""
    curve = bd.table([0.0, 1.0], [0.0, 10.0], "linear", outside, "pad")
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 2.0, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), ball.point))
    mech.add(bd.ForceLaw("push", ball.point, lambda ball, t: (-curve(ball.position[0]), 0.0)))
    warning = "push: x = 1.5 leaves the range 0 to 1 of pad, where its value is held; extend the"
    for analysis in (bd.linearize, bd.modes):
        inside = analysis(mech, about={"ball.x": 0.5})
        assert not any("pad" in x for x in inside.warnings)
        assert any(warning in x for x in analysis(mech, about={"ball.x": 1.5}).warnings)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("values", [(0.0, 10.0, 0.0), (2.0, 5.0, 5.0)], ids=["zero", "constant"])
def test_regression_linear_models_continue_tables_that_end_in_zero_or_a_constant(values):
    """They asked for a longer table, although runs and equilibria do not."""
    curve = bd.table([0.0, 0.5, 1.0], list(values), "linear", name="pad")
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 2.0, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.0, 0.0), ball.point))
    mech.add(bd.ForceLaw("push", ball.point, lambda ball, t: (-curve(ball.position[0]), 0.0)))
    assert not any("pad" in x for x in bd.linearize(mech, about={"ball.x": 1.5}).warnings)
    below = bd.linearize(mech, about={"ball.x": -0.5}).warnings
    assert any("pad" in x for x in below) is (values[0] != 0.0)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("method", [bd.Radau(1e-6), bd.Ida(1e-6)], ids=lambda x: x.method)
def test_regression_steps_do_not_pass_over_peaks_of_grids(method):
    """A ridge of 2 mm, whose height depends on the second argument, in the way of a free mass."""
    width, height = 1e-3, 4e3
    places = [0.0, 5.0 - width, 5.0, 5.0 + width, 20.0]
    ridge = np.outer([0.0, 0.0, -height, 0.0, 0.0], [1.0, 3.0])
    grid = bd.table((places, [0.0, 10.0]), ridge, "linear")
    for second, factor in ((lambda t: 10.0 * t, None), (lambda t: 2.5, 1.5)):
        mech = bd.Mechanism()
        ball = mech.add(bd.PointMass("ball", 1.0, at=(0.1, 0.0), velocity=(10.0, 0.0)))

        def force(ball, t, second=second):
            return grid(ball.position[0], second(t)), 0.0

        mech.add(bd.ForceLaw("push", ball.point, force))
        mech.observe("ball", ball.point)
        solution = bd.simulate(mech, method, t_end=1.0, output_step=1.0)
        lost = 50.0 - 0.5 * solution.table()["ball.x_dot [m/s]"].iloc[-1] ** 2
        # The ball passes the ridge at t = 0.49 s.
        assert_allclose(lost, (factor or 1.98) * width * height, rtol=1e-3)


STEP_PLACES, STEP = [0.0, 0.0199, 0.0201, 0.1], [0.0, 0.0, 1.0, 1.0]


def test_regression_splines_far_outside_their_values_have_a_warning(tmp_path):
    # A force of 0 to 1 N was 328 N without a warning.
    sentence = (
        r"the spline reaches 328 at x = 0.0705546, far outside the values 1 to 1 of the rows "
        r"beside it; use kind='pchip' or kind='linear', or add rows\.$"
    )
    with pytest.warns(bd.BeamdaeWarning, match=f"^table: {sentence}"):
        curve = bd.table(STEP_PLACES, STEP)
    assert_allclose(np.max(curve(np.linspace(0.0, 0.1, 10001))), 328.0, atol=0.5)
    with pytest.warns(bd.BeamdaeWarning, match=r"^step: the spline reaches -327 at"):
        bd.table(STEP_PLACES, [1.0, 1.0, 0.0, 0.0], name="step")
    for axes, values, name in (
        ((STEP_PLACES, [0.0, 1.0, 2.0]), np.outer(STEP, [1.0, 2.0, 3.0]), r"x\[0\]"),
        (([0.0, 1.0, 2.0], STEP_PLACES), np.outer([1.0, 2.0, 3.0], STEP), r"x\[1\]"),
    ):
        with pytest.warns(
            bd.BeamdaeWarning, match=f"reaches 984 at {name} .*; use kind='linear', "
        ):
            bd.table(axes, values)
    path = write(tmp_path, "time [ms],force [kN]\n0,0\n19.9,0\n20.1,1\n100,1\n")
    expected = "table .*csv: the spline reaches 3.28e.05 at time = 0.0705546, .* 1000 to 1000 of"
    with pytest.warns(bd.BeamdaeWarning, match=expected) as issued:
        bd.table_from_csv(path)
    assert len(issued) == 1


def test_regression_splines_far_outside_two_rows_have_a_warning():
    """The force of a press was 24 kN where 0 was measured, since it reaches 66 kN elsewhere."""
    travel = [0.0, 80.0, 84.0, 86.0, 88.0, 90.0, 92.0, 95.0, 100.0]
    force = [0.0, 0.0, 10.0, 38.0, 60.0, 66.0, 50.0, 8.0, 0.0]
    with pytest.warns(bd.BeamdaeWarning, match=r"far outside the values 0 to 0 of the rows"):
        bd.table(travel, force)


def test_regression_a_force_that_ends_steeply_overshoots_with_a_warning():
    # 92.7 kN beside rows of 80 and 0 kN.
    with pytest.warns(bd.BeamdaeWarning, match="the spline reaches 92.7"):
        bd.table([0, 1, 3, 6, 9, 11, 12], [0.0, 15.0, 40.0, 60.0, 75.0, 80.0, 0.0])


def test_tables_near_their_values_have_no_warning():
    places = np.geomspace(1e-3, 1.0, 20)
    with warnings.catch_warnings():
        warnings.simplefilter("error", bd.BeamdaeWarning)
        for kind in ("pchip", "linear"):
            bd.table(STEP_PLACES, STEP, kind)
        bd.table(X, Y)
        bd.table((X, X), np.outer(Y, Y))
        bd.table(np.linspace(0.0, 0.1, 11), [0.0] * 5 + [1.0] * 6)
        bd.table(places, np.sin(6.0 * places))
        # Constant up to rounding errors.
        bd.table([0.0, 1e-6, 2.0, 3.0], [5.0, 5.0, 5.0 + 1e-15, 5.0])
        bd.table([0.0, 1.0, 2.0], [0.0, 0.0, 0.0])


@pytest.mark.parametrize("wrap", [np.mod, np.fmod])
def test_regression_laws_that_repeat_name_what_repeats(wrap):
    """The remedies for remainders were functions for one-sided terms and signs."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    message = "a table with outside='repeat'.$"
    with pytest.raises(bd.BeamdaeError, match=message):
        mech.add(bd.ForceLaw("cycle", ball.point, lambda p, t: (wrap(p.position[0], 1.0), 0.0)))


CYCLE, LOAD = np.array([-0.5, -0.2, 0.1, 0.5]), np.array([1.0, -1.0, 2.0, 1.0])


def repeated_and_long(kind):
    """Return a repeated table, and one with the rows of many periods: its ends are far away."""
    low, high = -14, 15
    rows = np.concatenate([*(CYCLE[:-1] + k for k in range(low, high)), [CYCLE[-1] + high - 1]])
    values = [*np.tile(LOAD[:-1], high - low), LOAD[-1]]
    return bd.table(CYCLE, LOAD, kind, outside="repeat"), bd.table(rows, values, kind)


@every_kind
@pytest.mark.filterwarnings("ignore:.*the spline reaches")
def test_repeated_tables_are_those_with_the_rows_of_all_periods(kind):
    repeated, long = repeated_and_long(kind)
    # Periods begin at -0.5 + k; slopes of linear tables at rows are those of either side.
    x = np.concatenate([np.linspace(-2.97, 2.97, 100), [-1.5, -0.5, 0.5, 1.5]])
    assert_allclose(repeated(x), long(x), atol=1e-11)
    smooth = x if kind != "linear" else x[:100]
    for of_argument in (lambda f, y: f(y), lambda f, y: ca.jacobian(f(y), y)):
        y = ca.SX.sym("y")
        values = [
            ca.Function("f", [y], [of_argument(table, y)])(smooth[None]).full()
            for table in (repeated, long)
        ]
        assert_allclose(*values, atol=1e-10)


@pytest.mark.slow(reason="a fifth of a second")
@every_kind
@pytest.mark.filterwarnings("ignore:.*the spline reaches")
def test_repeated_tables_give_the_runs_of_long_tables(kind):
    """A body passes several periods within a step unless the peaks of the table are found."""
    tables, radau = repeated_and_long(kind), bd.Radau(1e-10)
    repeated, long = (run(table, radau, velocity=2.0, t_end=1.5) for table in tables)
    assert repeated.status.success
    assert not repeated.warnings
    # A hundred tolerances.
    assert_allclose(repeated.table(), long.table(), atol=1e-7)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("kind", ["pchip", "spline"])
@pytest.mark.filterwarnings("ignore:.*the spline reaches")
def test_repeated_tables_of_time_are_smooth_laws(kind):
    repeated, long = (as_law("push", table) for table in repeated_and_long(kind))
    assert repeated.breakpoints == ()
    t = np.linspace(-2.9, 2.9, 40)
    assert_allclose([repeated.at(x) for x in t], [long.at(x) for x in t], atol=1e-11)
    runs = [run(law, on="force", t_end=2.2).table() for law in (repeated, long)]
    assert_allclose(*runs, atol=1e-7)


def test_slopes_of_repeated_tables_are_equal_at_both_ends():
    for kind in ("pchip", "spline"):
        table = compile_formula(
            bd.table([0.0, 1.0, 2.0, 4.0], [0.0, 1.0, 3.0, 0.0], kind, "repeat")
        )
        slope = ca.Function("slope", [x := ca.SX.sym("x")], [ca.jacobian(table(x), x)])
        assert_allclose(float(slope(-1e-9)), float(slope(1e-9)), atol=1e-7)
        assert_allclose(float(slope(4.0)), float(slope(0.0)), atol=1e-12)


@pytest.mark.slow(reason="a quarter of a second")
def test_steps_do_not_pass_over_peaks_of_repeated_tables():
    pulse = bd.table([0.0, 0.9, 0.91, 0.92, 1.0], [0.0, 0.0, 5.0, 0.0, 0.0], "linear", "repeat")
    solution = run(pulse, bd.Radau(1e-6), velocity=10.0, t_end=2.0)
    # 20 pulses with the work of 0.05 J each; a missed one changes the speed by 0.005 m/s.
    speed = solution.table()["ball.x_dot [m/s]"].iloc[-1]
    assert_allclose(speed, np.sqrt(100.0 + 2.0 * 20 * 0.05), atol=1e-3)
