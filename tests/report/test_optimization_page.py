"""The page of an optimization: the first and the best design, the history, and the tables."""

import pytest
from pages import find_violations

import beamdae as bd
from beamdae.report.optimization_page import build_optimization_page

pytestmark = pytest.mark.slow(reason="optimizations")
METHOD = bd.GeneralizedAlpha(step=0.02)
LIMITS_OF_MASS = {"mass": (0.5, 3.0)}
LIMITS = {"length": (0.2, 2.0), **LIMITS_OF_MASS}


@bd.model(t_end=1.0)
def swinging(length=0.5, mass=1.0):
    """Pendulum of `length` [m] with a bob of `mass` [kg] on a spring."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.PointMass("bob", mass, at=(length, 0.0)))
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    mech.observe("bob", bob.point)
    return mech


@pytest.fixture(scope="module")
def result():
    limits = [bd.at_most(bd.SmoothMaximum("bob.y_dot"), 3.0), bd.at_most(bd.Mass(), 2.0)]
    objective = bd.EndValue("bob.x")
    return bd.optimize(swinging, objective, ["length", "mass"], limits, LIMITS, METHOD)


def facts(page, title):
    (table,) = (x for x in page["tables"] if x["title"] == title)
    return table["rows"]


def test_the_page_opens_on_the_best_and_the_first_design(result, show):
    page = build_optimization_page(result, "pendulum")
    tab = show(page)
    assert not tab.locator("#errors").is_visible()
    assert tab.locator(".run").count() == result.evaluations
    labels = [x["label"] for x in page["cases"][:2]]
    assert labels == [f"design {result.evaluations} (best)", "design 1 (first)"]
    panel = tab.locator("[data-panel=observed]")
    assert tab.get_by_label("Observed: quantity").input_value() == "bob.x [m]"
    assert panel.locator(".plot path.curve").count() == 2
    # The motion of each design is shown when it is selected.
    assert tab.inner_text("#shown") == labels[0]
    tab.locator("#table tbody tr", has_text="(first)").locator("td.label").click()
    tab.locator("#table tbody tr", has_text="(first)").locator("td.label").click()
    assert tab.inner_text("#shown") == labels[1]
    # Constraints over the designs.
    tab.get_by_label("y axis").select_option(label="1: SmoothMaximum of bob.y_dot [m/s]")
    assert "1: SmoothMaximum of bob.y_dot over design" in tab.inner_text("#scatter-title")


def test_tables_have_units_bounds_and_the_budget(result):
    page = build_optimization_page(result, "pendulum")
    optimization = dict(facts(page, "Optimization"))
    assert optimization["objective"] == "EndValue of bob.x [m]"
    assert optimization["designs"] == f"{result.evaluations} of at most 200"
    assert [x[0] for x in facts(page, "Parameters")] == ["length [m]", "mass [kg]"]
    assert facts(page, "Parameters")[0][3:] == ["0.2", "2", "no"]
    speed, mass = facts(page, "Constraints")
    assert speed[0] == "SmoothMaximum of bob.y_dot <= 3 m/s"
    assert float(speed[1]) == pytest.approx(3.0, rel=1e-5)
    assert mass[0] == "mass <= 2 kg"


def test_regression_quantities_with_a_sign_keep_their_unit():
    """The unit was missing in tables and axes."""
    limits = [bd.at_least(-bd.SmoothMaximum("bob.y_dot"), -3.0), bd.at_most(-bd.Mass(), -1.0)]
    limits.append(bd.at_most(2.0 * bd.Mass(), 6.0))
    result = bd.optimize(swinging, -bd.EndValue("bob.x"), "mass", limits, LIMITS_OF_MASS, METHOD)
    page = build_optimization_page(result, "pendulum")
    assert dict(facts(page, "Optimization"))["objective"] == "-EndValue of bob.x [m]"
    units = {x["label"]: x["unit"] for x in page["columns"]}
    assert units["objective"] == "m"
    names = [x[0] for x in facts(page, "Constraints")]
    assert [x.rpartition(" ")[2] for x in names] == ["m/s", "kg", "6"], names


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_has_no_violations(result, open_page, scheme):
    page = build_optimization_page(result, "pendulum")
    tab = open_page(page, color_scheme=scheme, viewport={"width": 1366, "height": 768})
    assert find_violations(tab) == []


def test_the_page_fits_a_phone(result, phone):
    tab = phone(build_optimization_page(result, "pendulum"))
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    assert find_violations(tab) == []


def test_designs_without_runs_have_a_drawing(tmp_path, show):
    result = bd.optimize(swinging, bd.Mass(), "mass", bounds={"mass": (0.5, 3.0)})
    page = build_optimization_page(result, "pendulum")
    assert [bool(x.get("frames")) for x in page["cases"]] == [True, True]
    assert not [x for x in page["tables"] if x["title"] == "Constraints"]
    assert not show(page).locator("#player").is_visible()
    path = result.page(tmp_path / "design.html")
    assert "Design of swinging" in path.read_text(encoding="utf-8")


def test_failed_designs_are_listed(show):
    @bd.model(t_end=1.0)
    def rod(mass=2.0):
        if mass < 1.0:
            raise bd.BeamdaeError("rod: it is too light.")
        return swinging(mass=mass)

    with pytest.warns(bd.BeamdaeWarning, match="it is too light"):
        result = bd.optimize(rod, bd.Mass(), "mass", bounds={"mass": (0.5, 3.0)})
    tab = show(build_optimization_page(result, "rod"))
    assert "it is too light" in tab.inner_text("#unplotted")
