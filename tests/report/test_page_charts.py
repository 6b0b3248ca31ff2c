"""Charts of the page in a browser: reading, hiding, saving."""

import csv
import io
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import T, buttons, classes, curves, odd_names, place, point, row, seen, study

PLOT = "[data-chart={}] .plot"
# Of places that are known to a pixel.
PIXEL = 0.01


def chosen(tab, *numbers):
    """Select cases, and no others."""
    tab.click("#clear")
    for number in numbers:
        row(tab, number).locator("td.label").click()


def test_curves_are_read_at_the_pointer_and_by_keys(show):
    tab = show(study())
    chosen(tab, 2)
    tab.mouse.move(*place(tab, "observed", 1.0, 0.5))
    said = tab.inner_text("#tip").split()
    assert float(said[2]) == pytest.approx(1.0, abs=0.02)
    assert float(said[-1]) == pytest.approx(-1.0, abs=1e-3)
    assert tab.locator("[data-chart=observed] .dot").count() == 1
    tab.locator(PLOT.format("observed")).focus()
    tab.keyboard.press("ArrowRight")
    said = tab.inner_text("#tip").split()
    # A hundredth of the run to the right: what is stored nearest to it is at t = 1.
    assert float(said[2]) == pytest.approx(1.02, abs=0.02)
    assert float(said[-1]) == pytest.approx(-1.0, abs=1e-3)
    for _ in range(50):
        tab.keyboard.press("ArrowRight")
    said = tab.inner_text("#tip").split()
    assert (float(said[2]), float(said[-1])) == (2.0, pytest.approx(1.0, abs=1e-3))
    tab.mouse.move(1, 1)
    tab.locator("#filter").focus()
    assert tab.locator("[data-chart=observed] .dot").count() == 0


def test_the_observed_column_is_chosen_and_kept(show):
    tab = show(study())
    choice = tab.get_by_label("Observed: which")
    assert choice.input_value() == "tip.x [m]"
    choice.select_option("hinge.F [N]")
    for _ in range(2):
        assert tab.locator("[data-panel=observed] .title").nth(1).text_content() == "hinge.F [N]"
        point(tab, 5).click()


def test_lines_differ_by_color_dashes_and_marks(show):
    tab = show(study())
    chosen(tab, 2, 1, 5, 4)
    panel = tab.locator("[data-panel=observed]")
    lines = [tuple(c.split()[1:]) for c in classes(panel.locator("path.curve"))]
    assert len(lines) == 4
    assert len({line[1:] for line in lines}) == 4
    marks = panel.locator(".line-mark")
    # Six on each.
    assert marks.count() == 24
    shapes = [marks.nth(k).get_attribute("d") for k in range(24)]
    assert len(set(shapes)) == 4
    chosen(tab, 2)
    assert panel.locator(".line-mark").count() == 0


def test_legends_hide_and_show(show):
    tab = show(study())
    chosen(tab, 2, 5)
    tab.get_by_role("button", name="Ida(rtol=0.001)", exact=False).and_(
        tab.locator(".switch")
    ).click()
    assert tab.locator("[data-panel=observed] path.curve").count() == 1
    assert row(tab, 2).locator("input").is_checked()
    switch = tab.locator("#chosen .switch").first
    assert switch.get_attribute("aria-pressed") == "false"
    # It has the focus still.
    tab.keyboard.press("Enter")
    assert tab.locator("[data-panel=observed] path.curve").count() == 2
    tab.get_by_role("button", name="1 Ida(rtol=0.001), remove").click()
    assert not row(tab, 2).locator("input").is_checked()
    families = tab.locator("#families .switch")
    assert families.all_inner_texts() == ["Ida", "GeneralizedAlpha"]
    families.first.click()
    assert tab.locator(".run").count() == 2
    assert tab.locator("#table tbody tr:visible").count() == 7
    families.first.click()
    assert tab.locator(".run").count() == 6


def test_all_curves_of_a_unit_are_shown_together(show):
    page = study()
    page["cases"] = page["cases"][:2]
    for one in page["cases"]:
        one["curves"]["observed"] = {
            "a [m]": T.tolist(),
            "b [m]": (2 * T).tolist(),
            "c [N]": T.tolist(),
        }
    tab = show(page)
    choice = tab.get_by_label("Observed: which")
    assert choice.locator("option").all_inner_texts() == ["a [m]", "b [m]", "c [N]", "all in m"]
    choice.select_option("all in m")
    panel = tab.locator("[data-panel=observed]")
    colors = [c.split()[1] for c in classes(panel.locator(".plot path.curve"))]
    assert colors == ["color-0", "color-1"]
    panel.locator(".switch", has_text="b [m]").click()
    assert panel.locator(".plot path.curve").count() == 1
    chosen(tab, 1, 2)
    # Two runs: colors are theirs, dashes those of names.
    panel.locator(".switch", has_text="b [m]").click()
    looks = [c.split()[1:] for c in classes(panel.locator(".plot path.curve"))]
    assert [len(look) for look in looks] == [1, 2, 1, 2]
    assert looks[0] != looks[2]


def test_the_difference_to_the_reference_is_shown_for_what_has_one(show):
    tab = show(study())
    chosen(tab, 5)
    panel = tab.locator("[data-panel=observed]")
    panel.get_by_label("difference to the reference").check()
    assert panel.locator(".title").nth(1).text_content() == "difference of tip.x [m]"
    # -2e-3 t.
    low, high = seen(tab, "observed")[1]
    assert_allclose([low, high], [-4.2e-3, 0.2e-3], rtol=1e-4)
    tab.get_by_label("Observed: which").select_option("hinge.F [N]")
    assert "difference to the reference" in panel.locator(".empty").inner_text()
    panel.get_by_label("difference to the reference").uncheck()
    assert panel.locator("path.curve").count() == 1
    assert tab.locator("[data-panel=drift] input").count() == 0


def test_cases_are_drawn_by_any_two_numbers(show):
    page = study()
    page["columns"] += [{"key": "speed", "label": "speed", "unit": "m/s", "kind": "number"}]
    for k, one in enumerate(page["cases"]):
        one["values"]["speed"] = 2.0 + k
    tab = show(page)
    tab.get_by_label("x axis").select_option("speed [m/s]")
    assert tab.inner_text("#precision h2") == "Error over speed"
    assert_allclose(seen(tab, "scatter")[0], [2.0 - 0.25, 7.0 + 0.25])
    tab.get_by_label("y axis").select_option("steps")
    # No errors, no limit of them.
    assert tab.locator("#precision .resolution").count() == 0
    assert tab.locator(".run.hollow").count() == 0
    point(tab, 1).hover()
    assert "speed [m/s]\t3" in tab.inner_text("#tip")


def test_a_page_may_say_what_cases_are_drawn_by_first(show):
    page = study() | {"axes": {"x": "error", "y": "steps"}}
    tab = show(page)
    assert tab.inner_text("#precision h2") == "steps over error"


def saved(tab, key, kind):
    with tab.expect_download() as download:
        buttons(tab, key).filter(has_text=kind).click()
    return download.value


def test_charts_are_saved_as_numbers(show, tmp_path):
    tab = show(study())
    chosen(tab, 2, 5)
    tab.locator("#chosen .switch").first.click()
    file = saved(tab, "observed", "CSV")
    assert file.suggested_filename.endswith("_tip.x_m_.csv")
    head, *rows = csv.reader(io.StringIO(file.path().read_text()))
    assert head == ["case", "quantity", "t [s]", "value"]
    # What is hidden is not saved.
    assert {r[0] for r in rows} == {"GeneralizedAlpha(step=0.002)"}
    assert_allclose([float(r[3]) for r in rows], np.cos(np.pi * T), atol=2e-5)
    head, *rows = csv.reader(io.StringIO(saved(tab, "scatter", "CSV").path().read_text()))
    assert head == ["case", "wall time [s]", "error", "below what the reference resolves"]
    assert rows[0] == ["Ida(rtol=0.001)", "0.1", "0.001", "no"]
    assert rows[2] == ["Ida(rtol=1e-07)", "3", "0.000001", "yes"]
    assert len(rows) == 6


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_charts_are_saved_as_pictures_of_their_own(open_page, scheme):
    tab = open_page(study(), color_scheme=scheme)
    chosen(tab, 2, 5)
    text = saved(tab, "observed", "SVG").path().read_text()
    root = ElementTree.fromstring(text)
    words = ["".join(one.itertext()) for one in root.iter() if one.tag.endswith("text")]
    # The legend says which is which.
    for said in ("tip.x [m]", "t [s]", "Ida(rtol=0.001)", "GeneralizedAlpha(step=0.002)"):
        assert said in words
    # Colors of paper, in the file itself, also from a dark screen.
    assert "rgb(0, 114, 178)" in text
    assert "var(" not in text
    assert tab.evaluate("document.documentElement.className") == ""
    image = saved(tab, "scatter", "PNG").path().read_bytes()
    assert image[:8] == b"\x89PNG\r\n\x1a\n"
    width, _ = (int.from_bytes(image[k : k + 4]) for k in (16, 20))
    assert width == 2 * round(tab.evaluate("state.charts.get('scatter').box.width"))


def test_names_of_users_are_saved_whatever_they_are(show):
    page = odd_names()
    tab = show(page)
    chosen(tab, 2)
    choice = tab.get_by_label("Observed: which")
    # Letters that XML has no room for, and those it would take for its own.
    for k in (5, 7, 8):
        choice.select_option(index=k)
        ElementTree.fromstring(saved(tab, "observed", "SVG").path().read_text())
        rows = list(csv.reader(io.StringIO(saved(tab, "observed", "CSV").path().read_text(), "")))
        assert {len(row) for row in rows} == {4}
    assert saved(tab, "observed", "PNG").path().stat().st_size > 1000


def test_a_failed_run_has_its_cross_and_no_more(show):
    page = study()
    page["cases"][6]["curves"] = curves(7e-3, T[:20])
    tab = show(page)
    chosen(tab, 3, 2)
    panel = tab.locator("[data-panel=observed]")
    ends = [
        float(re.findall(r"[\d.]+", t)[0])
        for t in panel.locator(".line-mark").evaluate_all(
            "all => all.map((one) => one.getAttribute('transform'))"
        )[:6]
    ]
    assert len(ends) == 6
    assert panel.locator("path.curve").count() == 3
