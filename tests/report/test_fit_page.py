"""The page of a fit: it opens on the measured columns, with the data as points on the curves."""

import numpy as np
import pytest
from mechanisms import rope_swing
from numpy.testing import assert_allclose
from pages import find_violations, read_page

import beamdae as bd

pytestmark = pytest.mark.slow
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


def test_the_page_has_no_violations(fit, open_page):
    size = {"width": 390, "height": 844}
    tab = open_page(fit, viewport=size, color_scheme="dark")
    assert find_violations(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= size["width"]


def test_units_of_estimates_are_in_the_file(fit, tmp_path):
    lines = fit.to_csv(tmp_path / "fit.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].endswith(",unit")
    assert lines[1].startswith("length,")
    assert lines[1].endswith(",m")
