"""Tables: interpolation, time laws, force formulas, limits, CSV files and sensitivities."""

import warnings
from itertools import product

import casadi as ca
import numpy as np
import pytest
from conformance import integrators
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import free_ball, hinged_body, mass_on_rail
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import CubicSpline, PchipInterpolator, RegularGridInterpolator

import beamdae as bd

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


@every_kind
def test_tables_in_formulas_of_time_have_smooth_pieces(kind):
    table = bd.table(X, Y, kind)
    law = bd.piecewise(lambda t: 2.0 * table(3.0 - 2.0 * t) + np.sin(t))
    times = np.sort((3.0 - X) / 2.0)
    assert_allclose(law.breakpoints, times if kind == "linear" else times[[0, -1]], rtol=1e-15)
    scale = None if kind == "linear" else pytest.approx(4.0 * 0.25)
    assert law.time_scale == scale
    for t in np.linspace(-0.5, 2.5, 31):
        assert_allclose(law.at(t), 2.0 * table(3.0 - 2.0 * t) + np.sin(t), rtol=1e-14, atol=1e-14)
    # Rows on a line are no breakpoints.
    bent = bd.piecewise(bd.table([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 2.0, 0.0, 0.0], "linear"))
    assert bent.breakpoints == (0.0, 2.0, 3.0)


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
    # Rows without a jump are no breakpoints; nor is the first one.
    assert bd.piecewise(table).breakpoints == (0.25, 0.4)
    later = bd.piecewise(lambda t: 3.0 * table(2.0 * t - 0.5))
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


def run(law, integrator=None, t_end=1.0, on=None, velocity=1.0, step=None):
    """Return a run of a mass of 1 kg that moves along x under a law of force."""
    mech, ball = free_ball((0.1, 0.0), velocity=(velocity, 0.0))
    if on is None:
        mech.add(bd.ForceLaw("push", ball.point, lambda ball, t: (law(ball.position[0]), 0.0)))
    else:
        mech.add(bd.Force("push", ball.point, (law, 0.0)))
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


PEAK = [0.0, 5.0 - 1e-3, 5.0, 5.0 + 1e-3, 20.0]
HEIGHTS = np.array([0.0, 0.0, -4e3, 0.0, 0.0])
RIDGE = bd.table((PEAK, [0.0, 10.0]), np.outer(HEIGHTS, [1.0, 3.0]), "linear")
PULSES = bd.table([0.0, 0.9, 0.91, 0.92, 1.0], [0.0, 0.0, -20.0, 0.0, 0.0], "linear", "repeat")


@pytest.mark.parametrize(
    ("law", "lost"),
    [
        (bd.table(PEAK, HEIGHTS, "linear"), 4.0),
        (bd.table(PEAK, HEIGHTS, "pchip"), 4.0),
        (lambda x: RIDGE(x, 2.5), 6.0),
        (PULSES, 2.0),  # ten pulses
    ],
    ids=["linear", "pchip", "grid", "repeated"],
)
@pytest.mark.parametrize("method", [bd.Radau(1e-6), bd.Ida(1e-6)], ids=lambda x: x.method)
def test_steps_do_not_pass_over_peaks(law, lost, method):
    """Peaks of millimeters in the way of a free mass take the work of their area."""
    solution = run(law, method, velocity=10.0)
    work = 50.0 - 0.5 * solution.table()["ball.x_dot [m/s]"].iloc[-1] ** 2
    # Flanks are symmetric about their middle.
    assert_allclose(work, lost, rtol=1e-3)


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
    outside = run(bd.table([1.0, 3.0], [0.0, 1.0], "linear", "error", "curve"), method)
    sentence = "stopped at t = 0 s: push: x = 0.1 leaves the range 1 to 3 of curve"
    assert outside.status.sentence == sentence


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


@bd.model(t_end=1.0)
def table_spring(stiffness=40.0, kind="linear", rows=6):
    """Mass on a spring with the tension stiffness times elongation, as a table."""
    x = np.linspace(-0.5, 0.5, rows)
    curve = bd.table(x, stiffness * x, kind)
    mech, mass = free_ball((1.0, 0.0), velocity=(0.3, 0.0), mass=2.0, name="mass")
    mech.add(bd.Spring("spring", mech.ground.at(0, 0), mass.point, law=curve))
    return mech


@pytest.mark.slow(reason="differentiates runs")
@pytest.mark.parametrize(("kind", "rows"), [("linear", 6), ("spline", 6), ("spline", 300)])
def test_sensitivities_by_values_of_a_table(kind, rows):
    """Regression: rounding errors of the coefficients of long tables hid their derivatives."""
    settings = {"kind": kind, "rows": rows}
    result = bd.sensitivities(table_spring, "stiffness", bd.Radau(1e-8), parameters=settings)
    k, h = 40.0, 1e-30

    def position(k):
        omega = np.sqrt(k / 2.0)
        return 0.3 / omega * np.sin(omega * result.t)

    exact = position(k + 1j * h).imag / h
    assert_allclose(
        result.sensitivity("mass.x", "stiffness"), exact, atol=1e-6 * np.max(np.abs(exact))
    )


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


def test_regression_names_that_end_like_units_are_names(tmp_path):
    """The words after underscores, and h, were read as units."""
    for name in ("F_cs", "p_ug", "x_cg", "omega_gn", "height (h)", "F (a)", "F_min", "x (down)"):
        table = bd.table_from_csv(write(tmp_path, f"{name},y\n0,0\n1,3\n2,9\n"))
        assert table.arguments == (name,)
        assert table(1.0) == 3.0


def test_regression_commas_that_may_separate_thousands_are_named(tmp_path):
    path = write(tmp_path, "t [s];F [N]\n0;1,200\n1;1,500\n")
    with pytest.warns(
        bd.BeamdaeWarning, match=r"numbers of .* such as 1,200 are read with decimal"
    ):
        table = bd.table_from_csv(path, kind="linear")
    assert table(0.0) == 1.2


FILES = [
    "travel [mm];force [kN]\n0;0\n1,5;3,5\n3;7\n",
    "sep=;\ntravel (mm);force (kN)\n0;0\n1,5;3,5\n3;7\n",
    "travel [mm]\tforce [kN]\n0\t0\n1,5\t3,5\n3\t7\n",
    "% press 3\n// raw\ntravel [mm],force [kN],\n0,0,\n1.5,3.5,\n,,\n3,7,\n",
    "# travel [mm],force [kN]\n0,0\n1.5,3.5\n3,7\n",
    "# travel [mm],force [kN]\n# recorded 2024-05-01, sensor 3\n0,0\n1.5,3.5\n3,7\n",
    "# travel [mm],force [kN]\n# recorded by hand\n0,0\n1.5,3.5\n3,7\n",
    "# travel,force\n# mm,kN\n0,0\n1.5,3.5\n3,7\n",
    "press 3;;\noperator;Smith, M.;\ntravel;force\n[mm];[kN]\n0;0\n1,5;3,5\n3;7\n",
    "# press 3, 2024-05-06\ntravel (mm),force (measured) (kN)\n0,0\n1.5,3.5\n3,7\n",
    "press,3\n3,rows\ntravel [mm],force [kN]\n0,0\n1.5,3.5\n3,7\n",
]


def test_regression_tables_read_the_files_that_fit_reads(tmp_path):
    """Semicolons, decimal commas, tabs, and other comments than "#" were rejected."""
    path = tmp_path / "pad.csv"
    for text, encoding in product(FILES, ("utf-8", "utf-8-sig", "utf-16")):
        path.write_text(text, encoding)
        table = bd.table_from_csv(path, kind="linear")
        assert_allclose(table(1.5e-3), 3500.0, rtol=1e-15, err_msg=text)
        assert table.arguments == ("travel",)


UNITS = {
    "N·m": 1.0,
    "N-m": 1.0,
    "kNm": 1e3,
    "°/s": np.pi / 180,
    "rpm": np.pi / 30,
    "min⁻¹": np.pi / 30,
    "μm": 1e-6,
    "%": 1e-2,
    "m/s²": 1.0,
    "m/s2": 1.0,
    "gn": 9.80665,
    "km/h": 1 / 3.6,
    "psi": 6894.757293168361,
    "kip/in": 4448.2216152605 / 0.0254,
    "N/mm²": 1e6,
    "in-lbf": 0.0254 * 4.4482216152605,
    "lb/ft^3": 0.45359237 / 0.3048**3,
    "mm^-1": 1e3,
}


def test_units_of_tables(tmp_path):
    for unit, factor in UNITS.items():
        path = write(tmp_path, f"t [s],y [{unit}]\n0,0\n1,2\n")
        table = bd.table_from_csv(path, kind="linear")
        assert_allclose(table(1.0), 2.0 * factor, rtol=1e-14, err_msg=unit)


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


CSV_SENTENCES = {
    "": "is empty; write a table with a header",
    "x [mm],F [stone]\n0,1\n1,2\n2,3\n": r"unit of 'F \[stone\]' is unknown",
    "x,F\n0,1\n1\n": "row 2 of 'F' must be a finite number, got ''",
    "x,F\n0,1\n1,1_000\n2,3\n": "row 2 of 'F' must be a finite number, got '1_000'",
    "x,F\n0,1\n#DIV/0!,2\n2,3\n": "row 2 of 'x' must be a finite number, got '#DIV/0!'",
    "x,x\n0,1\n": "contains the column 'x' twice; rename one",
    "x,F\a\n0,1\n": r"the header 'F\\x07' of .* contains unprintable characters",
    "x\n0\n1\n2\n": "no separators of columns in its header 'x'; separate the columns by com",
    "x,\n0,\n1,\n2,\n": "the file has 0 columns besides x; pass y=",
    "t,x,F\n0,0,0\n1,1,2\n": "the file has 3 columns: t, x, F; pass x= and y=",
    "x [mm];F [kN]\n0.5;0\n1,5;3,5\n": "it contains the numbers 1,5 and 0.5; write a header",
    "x [mm],p [mpa]\n0,1\n1,2\n": r"\(did you mean 'MPa' or 'mPa'\?\); write a unit such",
    "t [s],a [g]\n0,1\n1,2\n": r"unit g of 'a \[g\]' is ambiguous; write the values in kg or",
    "t [s],M [nm]\n0,1\n1,2\n": r"unit nm of .* is ambiguous; write the values in m or N m",
    "t [s],k (lb/in)\n0,1\n1,2\n": r"unit of 'k \(lb/in\)' is unknown",
    "t [s],p [kg/cm^2]\n0,1\n1,2\n": r"unit of 'p \[kg/cm\^2\]' is unknown",
    "t [s],x (in mm)\n0,1\n1,2\n": r"unit of 'x \(in mm\)' is unknown",
    "t [s],v [ms-1]\n0,1\n1,2\n": r"unit of 'v \[ms-1\]' is unknown",
    "# x,F\n# a,b\n0,1\n1,2\n2,3\n": "may be the header: 'x,F' and 'a,b'; write one",
    "0,0\n1,3\n2,4\n": "has no header; write a first line such as 't",
    "x,F\n0,1\n1,2\n1,3\n": r"^table pad\.csv: x must ascend, but 1 is followed by 1",
    "x,F\n0,0\n5,1\n10,4\n5,2\n0,0\n": "10 is followed by 5; .*or make a table of each",
    "x,F\n10,4\n5,1\n0,0\n": "10 is followed by 5; reverse the order of the rows",
}


@pytest.mark.filterwarnings("ignore:.* SI units")
def test_messages_about_csv_files(tmp_path):
    for text, sentence in CSV_SENTENCES.items():
        with pytest.raises(bd.BeamdaeError, match=sentence):
            bd.table_from_csv(write(tmp_path, text))


@pytest.mark.slow(reason="assembles the equations twice")
def test_tables_begin_when_events_change_a_law():
    mech, disk = hinged_body(1.0, 0.1, name="disk")
    shaft = mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0)
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


@pytest.mark.slow(reason="several linear models")
@pytest.mark.parametrize(
    ("values", "below", "above"),
    [
        ((1.0, 5.0, 10.0), True, True),
        ((0.0, 10.0, 0.0), False, False),
        ((2.0, 5.0, 5.0), True, False),
    ],
    ids=["slope", "zero", "constant"],
)
@pytest.mark.parametrize("outside", ["hold", "error"])
def test_regression_linear_models_outside_a_table_carry_a_warning(values, below, above, outside):
    """The held value of a table has no slope; one that ends in zero or a constant continues."""
    curve = bd.table([0.0, 0.5, 1.0], list(values), "linear", outside, "pad")
    mech, ball = mass_on_rail(2.0, name="ball")
    mech.add(bd.ForceLaw("push", ball.point, lambda ball, t: (-curve(ball.position[0]), 0.0)))
    warning = "leaves the range 0 to 1 of pad, where its value is held; extend the"
    is_error = outside == "error"
    for place, is_warned in ((-0.5, below or is_error), (0.7, False), (1.5, above or is_error)):
        for analysis in (bd.linearize, bd.modes):
            found = analysis(mech, about={"ball.x": place}).warnings
            assert any(warning in x for x in found) == is_warned


STEP_PLACES, STEP = [0.0, 0.0199, 0.0201, 0.1], [0.0, 0.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("x", "y", "sentence"),
    [
        (
            STEP_PLACES,
            STEP,
            r"^table: the spline reaches 328 at x = 0.0700375, far outside the values 1 to 1 of "
            r"the rows beside it; use kind='pchip' or kind='linear', or add rows\.$",
        ),
        (
            (STEP_PLACES, [0.0, 1.0, 2.0]),
            np.outer(STEP, [1.0, 2.0, 3.0]),
            r"reaches 984 at x\[0\] .*; use kind='linear', ",
        ),
        (
            ([0.0, 1.0, 2.0], STEP_PLACES),
            np.outer([1.0, 2.0, 3.0], STEP),
            r"reaches 984 at x\[1\] .*; use kind='linear', ",
        ),
        # The force of a press was 24 kN where 0 was measured, since it reaches 66 kN elsewhere.
        (
            [0.0, 80.0, 84.0, 86.0, 88.0, 90.0, 92.0, 95.0, 100.0],
            [0.0, 0.0, 10.0, 38.0, 60.0, 66.0, 50.0, 8.0, 0.0],
            "far outside the values 0 to 0 of the rows",
        ),
        # 92.7 kN beside rows of 80 and 0 kN.
        ([0, 1, 3, 6, 9, 11, 12], [0, 15, 40, 60, 75, 80, 0], "the spline reaches 92.7"),
    ],
    ids=["step", "first argument", "second argument", "press", "end"],
)
def test_regression_splines_far_outside_their_values_have_a_warning(x, y, sentence):
    """A force of 0 to 1 N was 328 N without a warning."""
    with pytest.warns(bd.BeamdaeWarning, match=sentence):
        bd.table(x, y)


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
        # Five rows a period.
        bd.table(range(11), np.sin(0.4 * np.pi * np.arange(11)))
        # Constant up to rounding errors.
        bd.table([0.0, 1e-6, 2.0, 3.0], [5.0, 5.0, 5.0 + 1e-15, 5.0])
        bd.table([0.0, 1.0, 2.0], [0.0, 0.0, 0.0])


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
    tables = repeated_and_long(kind)
    repeated, long = (bd.piecewise(table) for table in tables)
    assert repeated.breakpoints == ()
    t = np.linspace(-2.9, 2.9, 40)
    assert_allclose([repeated.at(x) for x in t], [long.at(x) for x in t], atol=1e-11)
    assert_allclose(*(run(table, on="force", t_end=2.2).table() for table in tables), atol=1e-7)
