"""Pictures of odd data: what cannot be drawn is left out, and names are what they are."""

import re
import warnings
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pandas as pd
import pytest

from beamdae.report.pictures import figures as pictures
from beamdae.report.text import make_printable, shorten_text
from beamdae.studies import study_pictures as plots
from beamdae.studies.references import Reference

T = np.linspace(0.0, 1.0, 11)
ODD = r"$x_1^{2}\frac{ [/b] :smile: _u"
LONG = "L" * 300


def table(**columns):
    return pd.DataFrame({"t [s]": T, **columns})


def ink(path):
    """Share of the picture that is colored."""
    image = matplotlib.image.imread(path)[..., :3]
    return float(np.mean(np.ptp(image, axis=-1) > 0.2))


TABLES = {
    "constant": (table(**{"a.x [m]": 1.0 + 0.0 * T}), True),
    "zero": (table(**{"a.x [m]": 0.0 * T}), True),
    "nan": (table(**{"a.x [m]": np.nan * T}), False),
    "inf": (table(**{"a.x [m]": np.where(T > 0.5, np.inf, T)}), True),
    "huge": (table(**{"a.x [m]": 1e308 * np.cos(9.0 * T), "b.x [m]": 1e299 * T}), True),
    "one row": (table(**{"a.x [m]": T, "a.phi [rad]": T}).iloc[:1], True),
    "no row": (table(**{"a.x [m]": T}).iloc[:0], False),
    "no column": (table(), False),
    "names": (table(**{f"{ODD}.x [m]": T, f"{ODD}._y [m]": T**2, "_h\x07.x [m]": T}), True),
    "long names": (table(**{f"{LONG}.x [m]": T, f"{LONG}.y [m]": T, f"{LONG} [N]": T}), True),
}


@pytest.mark.slow(reason="ten pictures")
@pytest.mark.parametrize(("data", "seen"), TABLES.values(), ids=TABLES)
def test_picture_of_run_of_odd_data(tmp_path, data, seen):
    path = pictures.plot_run(tmp_path / "run.png", data, f"{ODD}{LONG}")
    assert (ink(path) > 1e-4) == seen


@pytest.mark.slow(reason="ten pictures")
@pytest.mark.parametrize(("data", "seen"), TABLES.values(), ids=TABLES)
def test_picture_of_comparison_of_odd_data(tmp_path, data, seen):
    for error in (0.0, np.nan, np.inf, 1e-3):
        deviant = pd.DataFrame({"x": np.full(len(T), error)}, index=T)
        runs = {ODD: (data, deviant), LONG: (data, None)}
        path = pictures.plot_comparison(tmp_path / "c.png", data, runs, 1e-4, ODD)
        assert ink(path) > 0.0, "not even the legend"


def test_a_stress_in_pascal_does_not_make_ways_in_meters_still():
    moving = {"axle.y [m]": 0.1 * T, "stress [Pa]": 5e8 * T}
    still = {"axle.x [m]": 1e-19 * T, "axle.angle [rad]": 1e-16 * T}
    data = table(**moving, **still)
    assert pictures.characteristic_columns(data) == ["axle.y [m]"]


@pytest.mark.slow(reason="a picture")
def test_of_forty_observables_twelve_are_drawn_and_the_picture_says_so(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(pictures, "saved", lambda figure, path: figures.append(figure))
    pictures.plot_run(tmp_path / "r.png", table(**{f"o{k}.x [m]": T for k in range(40)}), "r")
    assert len(figures[0].axes) == 12
    assert figures[0].get_suptitle() == "r\n12 of 40 observables"


def test_styles_of_legend_and_curves_agree(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(pictures, "saved", lambda figure, path: figures.append(figure))
    data = table(**{"a.u [m]": T})
    runs = {n: (data, pd.DataFrame({"a.u [m]": 1e-3 + T}, index=T)) for n in "ABCDEFGH"}
    pictures.plot_comparison(tmp_path / "c.png", data, runs, 1e-9, "c")
    (figure,) = figures
    (legend,) = figure.legends
    shown = [(h.get_color(), h.get_linestyle()) for h in legend.get_lines()][1:]
    assert len(set(zip(shown, "ABCDEFGH", strict=True))) == 8
    for axis, first in zip(figure.axes, (1, 0), strict=True):
        drawn = [(x.get_color(), x.get_linestyle()) for x in axis.lines[first : first + 8]]
        assert drawn == shown


# Plots of studies.


def study(tmp_path, rows, over=None, uncertainty=1e-6):
    """Results with these rows; what a row does not say is as in the first of a sound study."""
    usual = {"model": "arm", "group": "arm", "series": "Ida(rtol)", "label": "Ida(rtol=0.1)",
             "status": "ok", "rtol": 0.1, "step": np.nan, "wall time [s]": 0.1, "error [-]": 1e-3,
             "below resolution": False}  # fmt: skip
    parameters = {k: v for row in rows for k, v in row.items() if k not in usual}
    order = ["model", *parameters, *(k for k in usual if k != "model")]
    found = pd.DataFrame([usual | row for row in rows])[order]
    known = Reference(("", ""), pd.DataFrame(), (), uncertainty, "")
    return SimpleNamespace(
        table=found,
        study=SimpleNamespace(over=over, cases=[None] * len(rows)),
        references=dict.fromkeys(found["group"], known) | {"another": known},
        folder=tmp_path,
    )


@pytest.fixture
def figure_of(monkeypatch):
    """The figure of a plot of a study, which is not saved."""

    def drawn(results, name):
        kept = []
        with monkeypatch.context() as patch:
            patch.setattr(pictures, "saved", lambda figure, path: kept.append(figure) or path)
            plots.plots(results)[name]()
        return kept[0]

    return drawn


NOTHING = {
    "all failed": [{"status": "failed", "error [-]": np.nan}],
    "no error": [{"error [-]": np.nan}],
    "error of zero": [{"error [-]": 0.0}],
    "infinite error": [{"error [-]": np.inf}],
    "no wall time": [{"wall time [s]": np.nan}],
}


@pytest.mark.parametrize("rows", NOTHING.values(), ids=NOTHING)
def test_a_study_without_anything_to_plot_has_no_plots(tmp_path, rows):
    rows = [{"elements": 4} | row for row in rows] + [{"elements": 8} | row for row in rows]
    found = plots.plots(study(tmp_path, rows)) | plots.plots(study(tmp_path, rows, "elements"))
    assert found["work_precision"]() == []
    if "wall time [s]" not in rows[0] and rows[0].get("status") == "ok":
        assert found["mesh_convergence"]() == []
    if rows[0].get("status") == "failed":
        assert found["cost_scaling"]() == found["mesh_convergence"]() == []


def test_a_group_without_a_success_has_no_panel(tmp_path, figure_of):
    rows = [{"group": "a"}, {"group": "b", "status": "failed", "error [-]": np.nan}]
    figure = figure_of(study(tmp_path, rows), "work_precision")
    assert [axis.get_title() for axis in figure.axes] == ["a"]


@pytest.mark.slow(reason="a picture")
def test_work_precision_shows_runs_that_are_all_below_resolution(tmp_path, figure_of):
    rows = [{"error [-]": e, "below resolution": True, "wall time [s]": e} for e in (1e-8, 1e-7)]
    results = study(tmp_path, rows)
    low, high = figure_of(results, "work_precision").axes[0].get_ylim()
    assert 1e-7 < low < 1e-5 < high < 1e-3
    assert ink(plots.plots(results)["work_precision"]()[0]) > 1e-4


def test_lines_join_runs_in_the_order_of_their_setting(tmp_path, figure_of):
    rows = [
        {"rtol": rtol, "wall time [s]": cost, "error [-]": 10.0 * rtol}
        for rtol, cost in ((1e-3, 0.3), (1e-5, 0.2), (1e-4, 0.1))
    ]
    figure = figure_of(study(tmp_path, rows), "work_precision")
    assert list(figure.axes[0].lines[0].get_xdata()) == [0.3, 0.1, 0.2]


def test_ticks_are_of_one_size(tmp_path, figure_of):
    rows = [{"elements": n, "wall time [s]": c} for n in (2, 4, 8) for c in (0.11 * n, 0.12 * n)]
    for name in ("work_precision", "cost_scaling"):
        figure = figure_of(study(tmp_path, rows), name)
        labels = [
            label
            for axis in (figure.axes[0].xaxis, figure.axes[0].yaxis)
            for label in [*axis.get_ticklabels(), *axis.get_ticklabels(minor=True)]
        ]
        assert {label.get_fontsize() for label in labels if label.get_text()} == {8.0}


def test_lines_join_runs_in_the_order_of_their_setting_with_the_spread_of_their_times(
    tmp_path, figure_of
):
    settings = {0.01: (0.3, 2e-3), 0.1: (0.1, 1e-3), 0.001: (0.2, 3e-3)}
    rows = [
        {"rtol": x, "label": f"{x}", "error [-]": error, "wall time [s]": cost,
         "wall time min [s]": 0.5 * cost, "wall time max [s]": 10.0 * cost}
        for x, (cost, error) in settings.items()
    ]  # fmt: skip
    axis = figure_of(study(tmp_path, rows), "work_precision").axes[0]
    assert list(axis.lines[0].get_xdata()) == [0.1, 0.3, 0.2]
    (bars,) = axis.collections
    ends = [(*bar[:, 0], bar[0, 1]) for bar in bars.get_segments()]
    expected = [
        (0.5 * c, 10.0 * c, error) for c, error in (settings[x] for x in (0.1, 0.01, 0.001))
    ]
    np.testing.assert_allclose(ends, expected)
    assert axis.get_xlim()[1] > 3.0


def test_names_in_svg_are_valid_xml_whatever_they_hold(tmp_path):
    name = f"{ODD}\x07\x1b[0m <!-- --> &"
    rows = [{"group": name, "series": f"_{name}", "label": name, "elements": n} for n in (2, 4)]
    for plot in ("work_precision", "cost_scaling"):
        _, svg = plots.plots(study(tmp_path, rows))[plot]()
        assert ElementTree.fromstring(svg.read_bytes()).tag.endswith("svg")


@pytest.mark.slow(reason="many panels")
def test_many_groups_with_long_names_are_drawn_as_far_as_anybody_looks(tmp_path, figure_of):
    rows = [
        {"group": f"{LONG}{k}", "load": f"{LONG}{k}", "elements": n, "series": f"{LONG}{s}",
         "label": f"{LONG}{s}", "wall time [s]": 0.1 * n}
        for k in range(40) for n in (2, 4) for s in range(20)
    ]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for plot in ("work_precision", "cost_scaling"):
            results = study(tmp_path, rows)
            assert ink(plots.plots(results)[plot]()[0]) > 1e-3
            figure = figure_of(results, plot)
            figure.canvas.draw()
            assert len(figure.axes) == 24
            assert figure.get_suptitle() == "the first 24 of 40"
            assert np.ptp([axis.get_position().width for axis in figure.axes]) < 1e-6


def test_letters_of_users_are_shown_by_their_codes():
    assert make_printable("a\x07b\x1b[1m\ud800\n梁") == r"a\x07b\x1b[1m\ud800 梁"
    assert shorten_text("abcdefghij", 5) == "ab…ij"
    assert len(shorten_text(LONG, 60)) == 60
    assert re.fullmatch("L+…L+", shorten_text(LONG, 7))
