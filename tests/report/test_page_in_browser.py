"""The page of a study in a browser."""

import re

import pytest
from pages import (
    NAMES,
    ODD,
    SENTENCE,
    T,
    case,
    classes,
    curves,
    numbers_of_curves,
    odd_names,
    point,
    row,
    rows,
    study,
)


def test_page_opens_and_fits_its_window(show):
    tab = show(study())
    assert tab.title() == study()["title"]
    assert tab.inner_text("h1") == study()["title"]
    assert tab.inner_text("#made") == "beamdae 0.1.0"
    assert tab.inner_text("#reference") == "They agree."
    for width in (1280, 600):
        tab.set_viewport_size({"width": width, "height": 800})
        assert tab.evaluate("document.documentElement.scrollWidth") <= width


def test_points_say_what_they_are_and_failures_are_listed(show):
    tab = show(study())
    assert tab.locator(".run").count() == 6
    point(tab, 4).hover()
    said = tab.inner_text("#tip")
    for text in ("GeneralizedAlpha(step=0.001)", "5.00e-4", "0.4 s", "10000"):
        assert text in said
    tab.mouse.move(1, 1)
    assert not tab.locator("#tip").is_visible()
    listed = tab.inner_text("#unplotted")
    assert "Failed, not drawn: 1" in listed
    assert f"Radau(rtol=1e-06) limited {SENTENCE}" in " ".join(listed.split())


def test_what_the_reference_does_not_resolve_is_drawn_hollow_at_its_limit(show):
    tab = show(study())
    hollow = tab.locator(".run.hollow")
    assert hollow.count() == 1
    assert hollow.locator(".arrow").count() == 1
    height = float(tab.locator("#precision-plot .resolution").get_attribute("y1"))
    at = float(re.findall(r"[\d.]+", hollow.get_attribute("transform"))[1])
    # Rounded to a tenth of a pixel; the error itself, two decades less, would be far below.
    assert at == pytest.approx(height, abs=0.06)
    hollow.hover()
    assert "at most 1.0e-6" in tab.inner_text("#tip")
    fill = "element => getComputedStyle(element.querySelector('.mark')).fill"
    assert hollow.evaluate(fill) == "rgb(255, 255, 255)"
    assert point(tab, 2).evaluate(fill) == "rgb(0, 114, 178)"


def test_lines_join_the_runs_of_a_series(show):
    lines = show(study()).locator("#precision-plot .series")
    # In the order of cases: two from Ida's three points, the one that ends below the limit in
    # dashes; one of the others.
    assert [(" dashed" in c, c.split()[1]) for c in classes(lines)] == [
        (False, "color-0"),
        (True, "color-0"),
        (False, "color-1"),
    ]


def test_lines_and_labels_are_in_the_order_of_ranks_whatever_the_result(show):
    """A finer run that is less accurate by chance stays between its neighbors."""
    page = study()
    page["cases"] = [
        case(k, f"Ida(rtol={label})", error, cost, rank=rank, group=page["groups"][0]["id"])
        for k, (label, error, cost, rank) in enumerate(
            [("1e-05", 1e-3, 1.0, 1), ("0.001", 1e-2, 0.1, 0), ("1e-06", 3e-3, 10.0, 2)]
        )
    ]
    tab = show(page)
    at = [float(x.get_attribute("x1")) for x in tab.locator("#precision-plot .series").all()]
    assert len(at) == 2
    assert at == sorted(at), "from the cheapest on"
    tab.get_by_role("button", name="case", exact=True).click()
    assert rows(tab) == ["Ida(rtol=0.001)", "Ida(rtol=1e-05)", "Ida(rtol=1e-06)"]


def test_rows_are_sorted_by_a_click_as_numbers_and_failures_last(show):
    tab = show(study())
    labels = {int(c["id"].split()[1]): c["label"] for c in study()["cases"]}
    order = {1: [0, 1, 2, 4, 5, 6, 3], -1: [6, 5, 4, 2, 1, 0, 3]}
    header = tab.get_by_role("button", name="steps", exact=True)
    for way, name in ((1, "ascending"), (-1, "descending")):
        header.click()
        assert rows(tab) == [labels[k] for k in order[way]]
        assert tab.locator("th[aria-sort]:has-text('steps')").get_attribute("aria-sort") == name
    tab.get_by_role("button", name="case", exact=True).click()
    assert rows(tab)[-1] == labels[3]
    assert rows(tab)[1:3] == [labels[4], labels[5]]


def test_filter_hides_rows(show):
    tab = show(study())
    for words, count in (("alpha", 2), ("ida note", 4), ("newton CONVERGE", 1), ("nothing", 0)):
        tab.fill("#filter", words)
        assert len(rows(tab)) == count
        assert tab.inner_text("#count") == f"{count} of 7 cases"
    tab.fill("#filter", "")
    assert len(rows(tab)) == 7


def test_clicks_select_and_draw_curves(show):
    tab = show(study())
    # The least error that is resolved is shown first.
    assert tab.locator("tr.selected").count() == 1
    tab.get_by_role("button", name="Clear the selection").click()
    assert tab.locator(".panel").count() == 0
    assert "Select cases" in tab.inner_text("#panels")
    point(tab, 2).click()
    assert numbers_of_curves(tab) == [1, 1, 1, 1]
    row(tab, 5).locator("td.label").click()
    row(tab, 1).locator("input").press("Space")
    assert numbers_of_curves(tab) == [3, 3, 3, 3]
    assert classes(tab.locator("tr.selected")) == ["selected"] * 3
    assert tab.locator(".run.selected .number").all_text_contents() == ["1", "2", "3"]
    colors = [re.search(r"color-\d", c)[0] for c in classes(tab.locator("#chosen .curve"))]
    # The first of a family has its color; no other gets that of another family.
    assert colors == ["color-0", "color-1", "color-3"]
    point(tab, 2).click()
    assert numbers_of_curves(tab) == [2, 2, 2, 2]
    assert not row(tab, 2).locator("input").is_checked()


def test_a_failed_run_is_drawn_as_far_as_it_got(show):
    page = study()
    page["cases"][6]["curves"] = curves(7e-3, T[:20])
    tab = show(page)
    tab.click("#clear")
    tab.locator("#unplotted button").click()
    # A line and a cross at its end.
    assert numbers_of_curves(tab) == [2, 2, 2, 2]


def test_the_plot_is_used_by_keys(show):
    tab = show(study())
    tab.click("#clear")
    first = tab.locator(".run[tabindex='0']")
    assert first.count() == 1
    first.focus()
    assert ODD in tab.inner_text("#tip")
    # From the left to the right.
    for label in ("Ida(rtol=0.001)", "GeneralizedAlpha(step=0.002)"):
        tab.keyboard.press("ArrowRight")
        assert label in tab.inner_text("#tip")
    at = tab.evaluate("scrollY")
    tab.keyboard.press("Space")
    assert tab.evaluate("scrollY") == at
    assert point(tab, 5).get_attribute("aria-pressed") == "true"
    assert numbers_of_curves(tab) == [1, 1, 1, 1]


def test_another_model_without_errors_curves_and_animation(show):
    tab = show(study())
    tab.select_option("#group", "rod()")
    assert rows(tab) == ["Ida(rtol=0.01)", "Radau(rtol=0.01)"]
    assert tab.inner_text("#reference") == "Reference not accepted. They do not agree."
    said = " ".join(tab.locator(".empty").all_inner_texts())
    for text in ("No case of this model has both", "No animation", "No case of this model has c"):
        assert text in said
    assert "No consistent start" in tab.inner_text("#unplotted")
    assert "Without error or wall time, not drawn: 1" in tab.inner_text("#unplotted")
    assert not tab.locator("#player").is_visible()


ONE = case(0, "Ida", 1e-3, 1.0, group="a")


@pytest.mark.parametrize(
    ("page", "said"),
    [
        ({}, "This study has no cases."),
        ({"groups": [{"id": "a"}]}, "This study has no cases."),
        (
            {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}]},
            "No case of this model has curves.",
        ),
        (
            {"groups": [{"id": "a"}], "columns": study()["columns"], "cases": [ONE]},
            "1 of 1 cases",
        ),
    ],
    ids=["nothing", "no cases", "bare case", "one case"],
)
def test_little_to_show(show, page, said):
    assert said in show(page).inner_text("main")


def test_names_of_users_are_shown_whatever_they_are(show):
    tab = show(odd_names())
    assert tab.title().startswith("u16")
    assert rows(tab)
    choice = tab.get_by_label("Observed: which")
    for k in range(len(NAMES)):
        choice.select_option(index=k)
        assert tab.locator("[data-panel=observed] path.curve").count() == 1
    first = tab.locator("#table tr[data-case='case 2'] td").all_inner_texts()
    # Its only odd value is that of u16: no name of JavaScript's own has one.
    assert [text for text in first[-len(NAMES) :] if text != "\N{EN DASH}"] == ["u16"]
