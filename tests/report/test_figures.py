"""Figures of runs, comparisons and studies, also of unusual values and names."""

import warnings
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib
import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import beamdae as bd
from beamdae.report.pictures import figures, time_plots
from beamdae.report.pictures.tick_labels import format_ticks
from beamdae.studies import study_page
from beamdae.studies.references import Reference

T = np.linspace(0.0, 1.0, 11)
ODD = r"$x_1^{2}\frac{ [/b] :smile: _u"
LONG = "L" * 300
FRAME = pd.DataFrame(
    {
        "t [s]": T,
        "tip.x [m]": np.cos(T),
        "tip.y [m]": 1e-15 * T,
        "tip.angle [rad]": T,
        "tip.x_dot [m/s]": -np.sin(T),
        "bend.u [m]": 1e-3 * T**2,
        "bend.phi [rad]": 1e-3 * T,
        "gauge 1 [-]": 1e-4 * T,
        "energy.kinetic [J]": T**2,
    }
)


def table(**columns):
    return pd.DataFrame({"t [s]": T, **columns})


def colored_share(path):
    """Return the share of pixels that are neither white nor gray."""
    image = matplotlib.image.imread(path)[..., :3]
    return float(np.mean(np.ptp(image, axis=-1) > 0.2))


def compare(runs, title=""):
    """Return the figure of several runs; see `beamdae.plot`."""
    headers = list(next(iter(runs.values())))
    selection = time_plots.PlotSelection("t [s]", [], {})
    return time_plots.create_figure(runs, selection, headers, title)


def save_run(path, data, title):
    return figures.save_figure(time_plots.create_run_figure(data, title), path)


@pytest.mark.slow(reason="half a second and more")
def test_a_comparison_has_a_curve_in_each_color(tmp_path):
    runs = {"A": FRAME, "B": FRAME * 1.1, "C": FRAME * 0.9}
    path = figures.save_figure(compare(runs, "title"), tmp_path / "c.png")
    image = matplotlib.image.imread(path)[..., :3]
    for color in figures.COLORS[:3]:
        distance = np.abs(image - np.array(matplotlib.colors.to_rgb(color))).max(axis=-1)
        assert np.sum(distance < 0.02) > 200


def test_figures_do_not_change_the_settings_of_matplotlib(tmp_path):
    with matplotlib.rc_context({"lines.linewidth": 1.23, "axes.grid": True}):
        before = dict(matplotlib.rcParams)
        frame = FRAME[["t [s]", "tip.x [m]"]]
        save_run(tmp_path / "run.png", frame, "title")
        assert dict(matplotlib.rcParams) == before


TABLES = {
    "ordinary": (FRAME, True),
    "energies alone": (FRAME[["t [s]", "energy.kinetic [J]"]], True),
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


@pytest.mark.slow(reason="ten figures")
@pytest.mark.parametrize(("data", "has_curves"), TABLES.values(), ids=TABLES)
def test_figures_of_runs_with_unusual_values(tmp_path, data, has_curves):
    path = save_run(tmp_path / "run.png", data, f"{ODD}{LONG}")
    assert (colored_share(path) > 1e-4) == has_curves


@pytest.mark.slow(reason="ten figures")
@pytest.mark.parametrize(("data", "has_curves"), TABLES.values(), ids=TABLES)
def test_figures_of_comparisons_with_unusual_values(tmp_path, data, has_curves):
    path = figures.save_figure(compare({ODD: data, LONG: data}, ODD), tmp_path / "c.png")
    assert colored_share(path) > 0.0, "the legend is missing"


RANGES = {
    "with minus signs": -100.0 + 13.37 * T,
    "of many digits": 9876.5 + T,
    "with a common power": 1e-7 * T,
    "near a large value": 1e9 + T,
    "near a small value": 2.345e-6 + 1e-9 * T,
    "below the limit of powers": -0.0199 + 0.0001 * T,
}


@pytest.mark.slow(reason="measures all texts")
def test_texts_of_panels_do_not_overlap():
    """The layout does not measure texts, so that it takes no time."""
    data = table(**{f"{'long name ' * 2}{name}.u [m]": x for name, x in RANGES.items()})
    figure = time_plots.create_run_figure(data, "two lines " * 10)
    figure.draw_without_rendering()
    boxes = [figure._suptitle.get_window_extent()]
    for axis in figure.axes:
        texts = [axis.title, axis.yaxis.label, axis.xaxis.label, axis.yaxis.get_offset_text()]
        ticks = axis.get_yticklabels()
        low, high = axis.get_ylim()
        ticks = [tick for tick in ticks if low <= tick.get_position()[1] <= high]
        texts += [ticks[0], ticks[-1], *axis.get_xticklabels()[1:-1]]
        boxes += [text.get_window_extent() for text in texts if text.get_text()]
    assert len(boxes) > 6 * len(RANGES)
    for k, box in enumerate(boxes):
        assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width
        assert 0.0 <= box.y0 < box.y1 <= figure.bbox.height
        assert not box.count_overlaps(boxes[:k])


@pytest.mark.parametrize(
    ("label", "largest", "scaled", "tick"),
    [
        ("stress [Pa]", 2e8, "stress [MPa]", "100"),
        ("tip.y [m]", 0.004, "tip.y [mm]", "2"),
        ("tip.y [m]", 2e5, "tip.y [10³ m]", "100"),
        ("rate [rad/s]", 4e4, "rate [10³ rad/s]", "20"),
        ("torque [N m]", 2e4, "torque [kN m]", "10"),
        ("strain [-]", 2e-4, "strain [10⁻⁶]", "100"),
        ("mass [kg]", 2e4, "mass [10³ kg]", "10"),
        ("load factor", 4e6, "load factor [10⁶]", "2"),
        ("power [W]", 4000.0, "power [W]", "2000"),
        ("tip.y [m]", 0.04, "tip.y [m]", "0.02"),
    ],
)
def test_axes_show_multiples_of_units(label, largest, scaled, tick):
    figure = Figure()
    axis = figure.add_subplot()
    axis.plot([0.0, 1.0], [0.0, largest])
    axis.set_ylabel(label)
    axis.set_yticks([0.0, 0.5 * largest, largest])
    format_ticks(axis.yaxis)
    for _ in range(2):  # A second drawing does not divide again.
        figure.draw_without_rendering()
        assert axis.get_ylabel() == scaled
        assert axis.get_yticklabels()[1].get_text() == tick


def test_powers_of_ten_are_plain_text():
    curve, error = (T, 1e-7 * T, {}), (T, 10.0 ** (-6.0 * T), {})
    panels = [
        figures.Panel("", "a.u [m]", [curve]),
        figures.Panel("", "error [-]", [error], scales=("linear", "log")),
    ]
    figure = figures.draw_panels(panels)
    figure.draw_without_rendering()
    curves, error = figure.axes
    assert curves.get_ylabel() == "a.u [nm]"
    assert curves.yaxis.get_offset_text().get_text() == ""
    assert {"10⁻⁶", "10⁻²"} <= {label.get_text() for label in error.get_yticklabels()}


def test_styles_of_legend_and_curves_agree():
    figure = compare(dict.fromkeys("ABCDEFGH", FRAME))
    (legend,) = figure.legends
    styles = [(h.get_color(), h.get_linestyle()) for h in legend.get_lines()]
    assert len(set(styles)) == 8
    for axis in figure.axes:
        assert [(x.get_color(), x.get_linestyle()) for x in axis.lines] == styles


# Plots of studies.


def study(tmp_path, rows, over=None, uncertainty=1e-6):
    """Return results with these rows; missing entries are those of a successful run."""
    defaults = {"model": "arm", "group": "arm", "series": "Ida(rtol)", "label": "Ida(rtol=0.1)",
             "status": "ok", "rtol": 0.1, "step [s]": np.nan, "wall time [s]": 0.1,
             "error [-]": 1e-3, "below resolution": False}  # fmt: skip
    parameters = {k: v for row in rows for k, v in row.items() if k not in defaults}
    order = ["model", *parameters, *(k for k in defaults if k != "model")]
    cases = pd.DataFrame([defaults | row for row in rows])[order]
    cases["error bound [-]"] = cases["error [-]"]
    reference = Reference(("", ""), pd.DataFrame(), (), uncertainty, "")
    return SimpleNamespace(
        table=cases,
        study=SimpleNamespace(over=over, over_header=over, cases=[None] * len(rows)),
        references=dict.fromkeys(cases["group"], reference) | {"another": reference},
        folder=tmp_path,
    )


@pytest.fixture
def figure_of():
    """Return a function that draws a plot of a study."""

    def draw(results, name):
        return study_page.list_plots(results)[f"{name}.png"]()

    return draw


NOTHING = {
    "all failed": [{"status": "failed", "error [-]": np.nan}],
    "no error": [{"error [-]": np.nan}],
    "error of zero": [{"error [-]": 0.0}],
    "infinite error": [{"error [-]": np.inf}],
    "no wall time": [{"wall time [s]": np.nan}],
}


@pytest.mark.parametrize("rows", NOTHING.values(), ids=NOTHING)
def test_a_study_without_data_has_no_plots(tmp_path, rows):
    rows = [{"elements": n} | row for n in (4, 8) for row in rows]
    assert study_page.list_plots(study(tmp_path, rows))["work_precision.png"]() is None
    if "wall time [s]" not in rows[0]:
        plots = study_page.list_plots(study(tmp_path, rows, "elements"))
        assert plots["mesh_convergence.png"]() is None


def test_a_group_without_a_success_has_no_panel(tmp_path, figure_of):
    rows = [{"group": "a"}, {"group": "b", "status": "failed", "error [-]": np.nan}]
    figure = figure_of(study(tmp_path, rows), "work_precision")
    assert [axis.get_title() for axis in figure.axes] == ["a"]


@pytest.mark.slow(reason="a figure")
def test_work_precision_shows_errors_below_the_resolution(tmp_path, figure_of):
    error = {"error [-]": 1e-5, "below resolution": True}
    rows = [error | {"wall time [s]": time} for time in (1e-8, 1e-7)]
    results = study(tmp_path, rows)
    low, high = figure_of(results, "work_precision").axes[0].get_ylim()
    assert 1e-7 < low < 1e-5 < high < 1e-3
    assert (
        colored_share(figures.save_figure(figure_of(results, "work_precision"), tmp_path / "a.png"))
        > 1e-4
    )


def test_lines_connect_runs_by_setting_and_show_the_range_of_times(tmp_path, figure_of):
    settings = {0.01: (0.3, 2e-3), 0.1: (0.1, 1e-3), 0.001: (0.2, 3e-3)}
    rows = [
        {"rtol": x, "label": f"{x}", "error [-]": error, "wall time [s]": cost,
         "wall time min [s]": 0.5 * cost, "wall time max [s]": 10.0 * cost}
        for x, (cost, error) in settings.items()
    ]  # fmt: skip
    axis = figure_of(study(tmp_path, rows), "work_precision").axes[0]
    assert list(axis.lines[0].get_xdata()) == [0.1, 0.3, 0.2]
    ends = [(*x.get_xdata(), x.get_ydata()[0]) for x in axis.lines[2:5]]
    expected = [
        (0.5 * c, 10.0 * c, error) for c, error in (settings[x] for x in (0.1, 0.01, 0.001))
    ]
    np.testing.assert_allclose(ends, expected)
    assert axis.get_xlim()[1] > 3.0


def test_mesh_convergence_has_a_line_per_group(tmp_path, figure_of):
    errors = {"a": {4: 1e-3, 2: 1e-2, 8: np.nan}, "b": {2: 1e-1, 4: 1e-2, 8: np.nan}}
    rows = [
        {"group": group, "elements": n, "error [-]": error}
        for group, meshes in errors.items()
        for n, error in meshes.items()
    ]
    (axis,) = figure_of(study(tmp_path, rows, "elements"), "mesh_convergence").axes
    assert [list(x.get_xdata()) for x in axis.lines] == [[2, 4]] * 2
    assert [list(x.get_ydata()) for x in axis.lines] == [[1e-2, 1e-3], [1e-1, 1e-2]]
    assert (axis.get_xscale(), axis.get_yscale(), axis.get_xlabel()) == ("log", "log", "elements")


@pytest.mark.slow(reason="half a second and more")
def test_names_with_markup_give_valid_svg(tmp_path, figure_of):
    name = f"{ODD}\x07\x1b[0m <!-- --> &"
    rows = [{"group": name, "series": f"_{name}", "label": name, "elements": n} for n in (2, 4)]
    figure = figure_of(study(tmp_path, rows), "work_precision")
    svg = figures.save_figure(figure, tmp_path / "figure.svg")
    assert ElementTree.fromstring(svg.read_bytes()).tag.endswith("svg")


@pytest.mark.slow(reason="many panels")
def test_of_many_groups_with_long_names_12_are_drawn(tmp_path, figure_of):
    rows = [
        {"group": f"{LONG}{k}", "load": f"{LONG}{k}", "elements": n, "series": f"{LONG}{s}",
         "label": f"{LONG}{s}", "wall time [s]": 0.1 * n}
        for k in range(40) for n in (2, 4) for s in range(20)
    ]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        results = study(tmp_path, rows)
        assert (
            colored_share(
                figures.save_figure(figure_of(results, "work_precision"), tmp_path / "a.png")
            )
            > 1e-3
        )
        figure = figure_of(results, "work_precision")
        figure.canvas.draw()
        assert len(figure.axes) == 12
        assert figure.get_suptitle() == "12 of 40 groups"
        assert np.ptp([axis.get_position().width for axis in figure.axes]) < 1e-6


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("number", [13, 60])
def test_regression_headings_of_sweep_pictures_do_not_cover_titles(number):
    """The line "12 of 17 columns" covered the titles of the first row."""
    figure, axes = figures.create_panels(number, "")
    for axis in axes:
        figures.format_axis(axis, "tip.y max", "[m]")
    figure.draw_without_rendering()
    heading, title = (x.get_window_extent() for x in (figure._suptitle, axes[0].title))
    assert figure._suptitle.get_text() == f"12 of {number} columns"
    assert title.y1 < heading.y0 < heading.y1 <= figure.bbox.y1


@pytest.mark.slow(reason="a third of a second")
def test_default_pictures_of_paths_have_up_to_six_panels():
    """Nine observed columns had nine panels, too small to read."""
    path = bd.equilibrium(bd.load_model("example:shallow_arch"), to=0.5)
    labels = [axis.get_xlabel() for axis in path.plot().figure.axes]
    assert len(labels) == 6
    assert labels[0] == "crown.y [m]"
    assert len(path.plot("crown", "quarter", "right").figure.axes) == 9


@pytest.mark.slow(reason="a third of a second")
def test_paths_that_end_early_have_a_mark_there():
    arch = bd.load_model("example:shallow_arch")
    with pytest.warns(bd.BeamdaeWarning, match="maximum of 4 points"):
        path = bd.equilibrium(arch, to=0.5, max_points=4)
    (axis,), (legend,) = (figure := path.plot("crown.y").figure).axes, figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["stable", "stopped"]
    assert axis.lines[-1].get_xdata() == path["crown.y"].iloc[-1]
