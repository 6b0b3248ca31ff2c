"""Pages of fits and of optimized designs."""

import numpy as np
import pytest
from mechanisms import clamped_beam, rectangle, rope_swing
from numpy.testing import assert_allclose
from pages import find_violations, list_lines, read_page

import beamdae as bd
from beamdae import quantities

pytestmark = pytest.mark.slow(reason="a fit")


TIMES = np.linspace(0.1, 1.0, 10)


@bd.model(t_end=1.0)
def swinging(length=0.5, mass=1.0):
    """Pendulum of `length` [m] with a bob of `mass` [kg]."""
    return rope_swing(length, mass)


@pytest.fixture(scope="module")
def fit():
    method = bd.GeneralizedAlpha(step=0.01)
    run = bd.simulate(swinging(length=0.6), method, output_step=0.1).at_times(TIMES)
    y_dot = run["bob.y_dot"].to_numpy() + 0.01 * np.cos(40.0 * TIMES)
    data = {"t [s]": TIMES + 0.02, "bob.y_dot": 0.5 + 2.0 * y_dot}
    sensor = {"scale": "bob.y_dot", "offset": "bob.y_dot", "shift": {"bob.y_dot": (-0.1, 0.1)}}
    return bd.fit(swinging, data, ["length"], method, **sensor)


def test_the_page_opens_on_the_measured_column(fit, tmp_path):
    page = read_page(fit.page(tmp_path / "fit.html"))
    header, residual = "bob.y_dot [m/s]", "residual of bob.y_dot [sigma]"
    assert page["featured"] == [header, residual]
    model, data = (case["curves"] for case in page["cases"])
    assert_allclose(data["observed"][residual], fit.residuals, atol=1e-5 * np.ptp(fit.residuals))
    y_dot = np.interp(data["t"], model["t"], model["observed"][header])
    assert_allclose(data["observed"][header], y_dot, atol=0.02)  # twice the noise
    (estimates,) = (table for table in page["tables"] if table["title"] == "Estimates")
    assert estimates["rows"][0][0] == "length [m]"


def test_the_page_in_a_browser(fit, show):
    tab = show(fit)
    choice = tab.get_by_label("Observed: quantity")
    assert choice.input_value() == "bob.y_dot [m/s]"
    # The points of the data are above the curve of the model.
    model, data = tab.evaluate(
        "state.charts.get('observed').spec.series.map(({type, z, data}) => [type, z, data.length])"
    )
    assert (model[0], data[0], data[2]) == ("line", "scatter", len(TIMES))
    assert data[1] > model[1]
    assert not tab.locator("#errors").is_visible()


def test_the_page_of_a_fit_has_no_violations(fit, open_page):
    size = {"width": 390, "height": 844}
    tab = open_page(fit, viewport=size, color_scheme="dark")
    assert find_violations(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= size["width"]


def test_units_of_estimates_are_in_the_file(fit, tmp_path):
    lines = fit.to_csv(tmp_path / "fit.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].endswith(",unit")
    assert lines[1].startswith("length,")
    assert lines[1].endswith(",m")


METHOD = bd.GeneralizedAlpha(step=0.02)
LIMITS_OF_MASS = {"mass": (0.5, 3.0)}


LIMITS = {"length": (0.2, 2.0), **LIMITS_OF_MASS}


@bd.model(t_end=1.0)
def sprung(length=0.5, mass=1.0):
    """Pendulum of `length` [m] with a bob of `mass` [kg] on a spring."""
    return rope_swing(length, mass)


@pytest.fixture(scope="module")
def result():
    limits = [
        quantities.at_most(quantities.SmoothMaximum("bob.y_dot"), 3.0),
        quantities.at_most(quantities.Mass(), 2.0),
    ]
    objective = quantities.EndValue("bob.x")
    return bd.optimize(sprung, objective, ["length", "mass"], limits, LIMITS, METHOD)


@pytest.fixture
def read(tmp_path):
    """Return a function that returns the data of the page of a result."""
    return lambda result: read_page(result.page(tmp_path / "design.html"))


def facts(page, title):
    (table,) = (x for x in page["tables"] if x["title"] == title)
    return table["rows"]


def test_the_page_has_the_best_and_the_first_design(result, read):
    cases = read(result)["cases"][:2]
    labels = [f"design {result.evaluations} (best)", "design 1 (first)"]
    assert [x["label"] for x in cases] == labels
    ends = [x["curves"]["observed"]["bob.x [m]"][-1] for x in cases]
    assert ends == pytest.approx([result.objective, result.history()["objective"][0]], abs=1e-5)


def test_the_page_opens_on_the_best_and_the_first_design(result, show):
    tab = show(result)
    labels = [f"design {result.evaluations} (best)", "design 1 (first)"]
    assert not tab.locator("#errors").is_visible()
    points = """state.charts.get("scatter").spec.series
        .flatMap(({data}) => data.filter((point) => point[2])).length"""
    assert tab.evaluate(points) == result.evaluations
    assert tab.get_by_label("Observed: quantity").input_value() == "bob.x [m]"
    assert len(list_lines(tab)) == 2
    # The motion of each design is shown when it is selected.
    assert tab.inner_text("#shown") == labels[0]
    tab.locator("#table tbody tr", has_text="(first)").locator("td.label").click()
    tab.locator("#table tbody tr", has_text="(first)").locator("td.label").click()
    assert tab.inner_text("#shown") == labels[1]
    # Constraints over the designs.
    tab.get_by_label("y axis").select_option(label="1: SmoothMaximum of bob.y_dot [m/s]")
    assert "1: SmoothMaximum of bob.y_dot over design" in tab.inner_text("#scatter-title")


def test_tables_have_units_bounds_and_the_budget(result, read):
    page = read(result)
    optimization = dict(facts(page, "Optimization"))
    best = f"EndValue of bob.x = {result.objective:.6g} m"
    assert optimization["objective"] == f"{best}, first -0.484066 m"
    assert optimization["designs"] == f"{result.evaluations} of at most 200"
    assert [x[0] for x in facts(page, "Parameters")] == ["length [m]", "mass [kg]"]
    assert facts(page, "Parameters")[0][3:] == ["0.2", "2", "no"]
    speed, mass = facts(page, "Constraints")
    assert speed[0] == "SmoothMaximum of bob.y_dot <= 3 m/s"
    assert float(speed[1]) == pytest.approx(3.0, rel=1e-5)
    assert mass[0] == "mass <= 2 kg"


def test_regression_quantities_with_a_sign_keep_their_unit(read):
    """The unit was missing in tables and axes."""
    limits = [
        quantities.at_least(-quantities.SmoothMaximum("bob.y_dot"), -3.0),
        quantities.at_most(-quantities.Mass(), -1.0),
    ]
    limits.append(quantities.at_most(2.0 * quantities.Mass(), 6.0))
    result = bd.optimize(
        sprung, -quantities.EndValue("bob.x"), "mass", limits, LIMITS_OF_MASS, METHOD
    )
    page = read(result)
    objective = dict(facts(page, "Optimization"))["objective"]
    assert objective == "-EndValue of bob.x = 0.484066 m, first 0.484066 m"
    units = {x["label"]: x["unit"] for x in page["columns"]}
    assert units["objective"] == "m"
    names = [x[0] for x in facts(page, "Constraints")]
    assert [x.rpartition(" ")[2] for x in names] == ["m/s", "kg", "6"], names


@bd.model(t_end=1.0)
def stepped(height=(0.02,) * 3, widths=(0.02, 0.02), force=-50.0):
    """Cantilever in three steps of `height` [m] under a tip `force` [N]."""

    def section(s):
        return rectangle(height[min(int(3.0 * s), 2)], widths[int(s > 0.5)])

    mech, beam = clamped_beam(section, 3)
    mech.add(bd.Force("load", beam.end, (0.0, force)))
    mech.observe("tip", beam.end)
    mech.observe("stress", beam.stress(0.01, "top"))
    return mech


@pytest.fixture(scope="module")
def lists():
    limit = quantities.at_most(quantities.EquilibriumValue("stress", step=1.0), 6e7)
    bounds = {"height": (0.01, 0.05), "widths": (0.01, 0.05)}
    return bd.optimize(stepped, quantities.Mass(), ["height", "widths"], limit, bounds)


def test_regression_limits_that_are_reached_have_no_rounding_errors(lists, read):
    (row,) = facts(read(lists), "Constraints")
    assert row[0] == "stress at equilibrium <= 6e+07 Pa"
    assert row[3] == "0"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_of_a_design_has_no_violations(result, open_page, scheme):
    tab = open_page(result, color_scheme=scheme, viewport={"width": 1366, "height": 768})
    assert find_violations(tab) == []


def test_pages_of_lists_have_no_violations(lists, show):
    assert find_violations(show(lists)) == []


@pytest.mark.parametrize("name", ["result", "lists"])
def test_the_page_fits_a_phone(name, phone, request):
    tab = phone(request.getfixturevalue(name))
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    assert find_violations(tab) == []


def test_designs_without_runs_have_a_drawing(tmp_path):
    result = bd.optimize(sprung, quantities.Mass(), "mass", bounds={"mass": (0.5, 3.0)})
    path = result.page(tmp_path / "design.html")
    page = read_page(path)
    assert [bool(x.get("frames")) for x in page["cases"]] == [True, True]
    assert not [x for x in page["tables"] if x["title"] == "Constraints"]
    assert "Design of sprung" in path.read_text(encoding="utf-8")


def test_failed_designs_are_listed(show):
    @bd.model(t_end=1.0)
    def rod(mass=2.0):
        if mass < 1.0:
            raise bd.BeamdaeError("rod: it is too light.")
        return sprung(mass=mass)

    with pytest.warns(bd.BeamdaeWarning, match="it is too light"):
        result = bd.optimize(rod, quantities.Mass(), "mass", bounds={"mass": (0.5, 3.0)})
    tab = show(result)
    assert "it is too light" in tab.inner_text("#unplotted")
