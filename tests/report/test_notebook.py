"""Runs in a notebook: text, columns, HTML summary, plots and animations."""

import json
import pickle
import re

import numpy as np
import pandas as pd
import pytest
from benchmarks.cases import PENDULUM
from mechanisms import beam_pendulum, free_ball, rectangle
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=1e-2)


def create_pendulum():
    """Build a beam on a hinge, with a bob at its end."""
    section = rectangle(0.02, material=bd.Material(E=2e9, nu=0.3, rho=1000.0))
    mech = beam_pendulum(elements=1, section=section)
    beam = mech.part("beam")
    mech.add(bd.PointMass("bob", 0.1, on=beam.end))
    return mech, beam


@pytest.fixture(scope="module")
def run():
    return bd.simulate(create_pendulum()[0], ALPHA, t_end=0.2, output_step=0.02)


def test_columns_are_selected_by_header_name_or_observable(run):
    tip = run["tip.y"]
    assert tip.name == "tip.y [m]"
    assert tip.index.name == "t [s]"
    assert_array_equal(tip.index, run.t)
    assert_array_equal(tip, run.columns["tip.y [m]"])
    assert_array_equal(run["tip.y [m]"], tip)
    assert list(run["tip"]) == [name for name in run.columns if name.startswith("tip.")]
    assert_array_equal(run["energy.kinetic"], run.energies["energy.kinetic [J]"])
    assert_array_equal(run["lam.hinge"].iloc[:, 0], run.lam[:, 0])
    assert_array_equal(run["beam.x0_dot"], run.v[:, 0])


def test_columns_are_plotted_over_other_columns(run):
    figure = run.plot("tip.y", "tip.y_dot", x="tip.x").figure
    for axis, name in zip(figure.axes, ("tip.y", "tip.y_dot"), strict=True):
        curve, start = axis.lines
        assert_array_equal(curve.get_xdata(), run["tip.x"])
        assert_array_equal(curve.get_ydata(), run[name])
        assert_array_equal(start.get_xydata()[0], curve.get_xydata()[0])
        assert axis.get_xlabel() == "tip.x [m]"
    # Coordinates of one point have equal scales; a velocity over a coordinate has not.
    assert [axis.get_aspect() for axis in figure.axes] == [1.0, "auto"]
    assert [axis.get_title() for axis in run.plot(x="tip.x").figure.axes] == ["tip.y", "tip.angle"]
    titles = [axis.get_title() for axis in run.plot("tip", x="tip.x").figure.axes]
    assert titles == ["tip.y", "tip.angle", "tip.x_dot", "tip.y_dot", "tip.angle_dot"]
    assert bd.plot([run, run], "tip.y", x="tip.x").figure.legends
    with pytest.raises(bd.BeamdaeError, match="plot: 'tip' selects several columns; name one"):
        run.plot("tip.y", x="tip")
    with pytest.raises(bd.BeamdaeError, match=r"^plot: there is no column 'tip\.z' .did you mean"):
        run.plot("tip.y", x="tip.z")


def test_measured_data_are_plotted_as_markers_in_the_units_of_the_run(run, tmp_path):
    t = run.t[1::3]
    x, y = (run.at_times(t)[name].to_numpy() for name in ("tip.x", "tip.y"))
    data = {"t [ms]": 1e3 * t, "tip.x": x, "tip.y [mm]": 1e3 * y, "room [K]": 0.0 * t}
    path = tmp_path / "measured.csv"
    pd.DataFrame(data).to_csv(path, index=False)
    figure = run.plot(data=path).figure
    assert [axis.get_title() for axis in figure.axes] == ["tip.x", "tip.y"]
    assert_allclose(figure.axes[1].lines[1].get_xydata(), np.stack([t, y], axis=1), rtol=1e-14)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [run.label, "data"]
    experiments = {"one": pd.DataFrame(data), "two": pd.DataFrame(data).iloc[1:]}
    *_, first, second = run.plot("tip.y", x="tip.x", data=experiments).figure.axes[0].lines
    assert_allclose(first.get_xydata(), np.stack([x, y], axis=1), rtol=1e-14)
    assert_allclose(second.get_xydata(), first.get_xydata()[1:], rtol=1e-14)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("none.csv", "plot: 'none.csv' cannot be read"),
        (3, "plot: data must be a table"),
        ({"t [s]": [0.0], "room [K]": [1.0]}, "must contain values of a column of the run"),
        ({"t [s]": [0.0], "tip.x": [1.0]}, "must contain one of the plotted columns .tip.y"),
        ({"t [s]": [0.0], "tip.y [kg]": [1.0]}, "is in kg, but the model observes it in m"),
        ({"t [kg]": [0.0], "tip.y": [1.0]}, "must be in a unit such as s or ms, got kg"),
        ({"tip.y": [1.0]}, "plot: data must contain the column 't .s.'"),
        (
            {"t [s]": [0.0], "tip.y [mm]": [1.0], "tip.y [m]": [1.0]},
            "'tip.y .mm.' and 'tip.y .m.' of data are the same",
        ),
    ],
)
def test_invalid_measured_data_are_refused(run, data, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        run.plot("tip.y", data=data)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        *((lambda run, name=x: run[name], r"Solution: there is no column") for x in ("", 3, None)),
        (lambda run: run["tip.Y"], r"did you mean 'tip\.y'"),
        (lambda run: bd.plot([]), "plot: .*got none"),
        (lambda run: bd.plot([3]), "plot: .*got 3"),
        (lambda run: bd.plot([run, run], labels=["one", "one"]), "labels must contain a different"),
        *(
            (lambda run, path=x: run.plot("tip.y").save(path), r"suffix such as \.png, got")
            for x in ("tip", "", 3, None)
        ),
        (lambda run: run.animate("run.avi"), r"must end in \.gif or \.mp4"),
        (lambda run: run.animate("run"), "suffix"),
        (lambda run: run.animate(speed=0.0), "speed"),
        *((lambda run, number=x: run.animate(frames=number), "frames") for x in (1, 501)),
    ],
)
def test_invalid_arguments_are_refused(run, call, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        call(run)


def test_regression_dense_data_do_not_hide_the_curves(run):
    """1800 markers of 3.5 points covered the curve."""
    for count, is_dense in ((100, False), (1800, True)):
        times = np.linspace(run.t[0], run.t[-1], count)
        data = {"t [s]": times, "tip.y": run.at_times(times)["tip.y"].to_numpy()}
        figure = run.plot(data=data).figure
        curve, points = figure.axes[0].lines
        assert (points.get_zorder() < curve.get_zorder()) == is_dense
        assert (points.get_markersize() < 2.5) == is_dense
        assert (points.get_alpha() or 1.0) < 1.0 or not is_dense
        # The entry of the legend is legible.
        assert figure.legends[0].get_lines()[-1].get_alpha() is None


def test_regression_texts_in_other_columns_of_data_are_ignored(run):
    """A column of comments was refused, although columns of numbers were ignored."""
    data = {"t [s]": [0.0, 0.1], "tip.y": [0.0, 1.0], "comment": ["start", None]}
    assert_array_equal(run.plot(data=data).figure.axes[0].lines[1].get_ydata(), [0.0, 1.0])


def legend_of(plot):
    (legend,) = plot.figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_regression_each_experiment_has_one_marker_in_all_panels(run):
    """Markers were numbered in each panel, and the legend named those of one panel only."""
    t = run.t[1::3]
    data = {"e1": {"t [s]": t, "tip.x": t}, "e2": {"t [ms]": 1e3 * t, "tip.y [mm]": t}}
    plot = run.plot(data=data)
    assert legend_of(plot)[1:] == ["data, e1", "data, e2"]
    assert [axis.lines[1].get_marker() for axis in plot.figure.axes] == ["o", "s"]


def test_regression_a_run_with_the_label_data_is_in_the_legend(run):
    """The entry of the data replaced that of the run."""
    data = {"t [s]": run.t, "tip.y": run.t}
    plot = bd.plot([run, run], labels=["a", "data"], data=data)
    assert legend_of(plot) == ["a", "data", "measured data"]


def test_regression_a_plot_over_the_only_characteristic_column_is_not_empty():
    """The figure had no axes."""
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    run = bd.simulate(mech, ALPHA, t_end=0.02)
    assert [x.get_title() for x in run.plot(x="ball.y").figure.axes] == ["ball.x"]


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_observables_take_precedence_over_bodies_of_the_same_name():
    """The columns of the body were returned: its center of mass and all coordinates."""
    mech, beam = create_pendulum()
    bar = mech.add(bd.RigidBody("bar", mass=1.0, inertia=0.1, center=(1.0, -1.0)))
    mech.add(bd.Revolute("pin", beam.end, bar.at(1.0, 0.0)))
    mech.observe("bar", bar.at(1.0, -2.0))
    mech.observe("beam", beam.deformation(0.5))
    run = bd.simulate(mech, ALPHA, t_end=0.02)
    assert run["bar.y"].iloc[0] == run.table()["bar.y [m]"].iloc[0] == -2.0
    assert list(run["beam"]) == ["beam.u [m]", "beam.v [m]", "beam.phi [rad]"]
    assert bd.plot(run, "bar.y").figure.axes[0].lines[0].get_ydata()[0] == -2.0
    assert run.difference(run.observe("low", bar.at(1.0, -2.0)), "bar.y").abs().max(axis=None) == 0
    assert run["bar.angle"].iloc[0] == 0.0
    assert run["beam.x0"].iloc[0] == 0.0
    rest = bd.equilibrium(mech)
    assert rest["bar.y"].iloc[-1] == rest.table()["bar.y [m]"].iloc[-1]
    assert len(rest["beam"].columns) == 3


@pytest.mark.parametrize("of", ["attachment", "strain", "reaction"])
def test_observables_added_after_a_run_equal_those_added_before(of):
    def quantity(mech, beam):
        if of == "strain":
            return beam.strain(s=0.3, offset=0.01)
        return beam.at(0.7) if of == "attachment" else mech.parts["hinge"].reaction

    mech, beam = create_pendulum()
    later = bd.simulate(mech, ALPHA, t_end=0.1).observe("seen", quantity(mech, beam))
    again, beam = create_pendulum()
    again.observe("seen", quantity(again, beam))
    before = bd.simulate(again, ALPHA, t_end=0.1)
    assert list(later.columns) == list(before.columns)
    # The same kernels with the same numbers: equal bit for bit.
    assert_array_equal(later["seen"], before["seen"])


def test_invalid_observables_are_rejected(run):
    mech, beam = create_pendulum()
    beam_of_run = run.equations.mechanism.parts["beam"]
    with pytest.raises(bd.BeamdaeError, match="'beam' is not part of the mechanism"):
        run.observe("seen", beam.end)
    with pytest.raises(bd.BeamdaeError, match="only attachments, quantities such as"):
        run.observe("seen", "tip")
    with pytest.raises(bd.BeamdaeError, match=r"tip\.x \[m\]"):
        run.observe("tip", beam_of_run.start)
    solution = bd.simulate(mech, ALPHA, t_end=0.02)
    late = mech.add(bd.PointMass("late", 1.0, at=(3.0, 0.0)))
    with pytest.raises(bd.BeamdaeError, match="'late' is not part of the mechanism that ran"):
        solution.observe("seen", late.point)
    assert len(solution.observe("seen", beam.end)["seen.x"]) == len(solution.t)


def test_the_summary_contains_status_and_quality(run):
    page = run._repr_html_()
    for phrase in ("GeneralizedAlpha", "reached the end", "energy imbalance", "tip"):
        assert phrase in page
    assert "nan" not in page


def test_names_in_the_summary_are_escaped():
    mech, ball = free_ball(name="<b>&")
    mech.observe("<i>", ball.point)
    page = bd.simulate(mech, ALPHA, t_end=0.1)._repr_html_()
    assert "<b>&amp;" not in page
    assert "&lt;i&gt;" in page


@pytest.mark.slow(reason="half a second and more")
def test_plots_of_several_runs_have_a_legend(run, tmp_path):
    other = bd.simulate(create_pendulum()[0], bd.Ida(rtol=1e-4), t_end=0.2, output_step=0.01)
    figure = bd.plot([run, other], "tip.x", "tip.y").figure
    assert [axis.get_title() for axis in figure.axes] == ["tip.x", "tip.y"]
    for axis, column in zip(figure.axes, ("tip.x", "tip.y"), strict=True):
        assert axis.get_ylabel() == "[m]"
        for line, solution in zip(axis.lines, (run, other), strict=True):
            assert_array_equal(line.get_xdata(), solution.t)
            assert_array_equal(line.get_ydata(), solution[column])
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [ALPHA.label, bd.Ida(1e-4).label]
    path = bd.plot([run, run], "tip", labels=["_one", "$two$"]).save(tmp_path / "deep" / "tip.png")
    with Image.open(path) as picture:
        assert picture.size[0] > 500
    assert run.plot("tip.y")._repr_png_().startswith(b"\x89PNG")


@pytest.mark.slow(reason="half a second and more")
def test_of_many_columns_twelve_are_plotted(run):
    names = list(run.table().columns[1:]) + list(run.coordinates().columns)
    figure = run.plot(*dict.fromkeys(names)).figure
    assert len(figure.axes) == 12
    assert figure.get_suptitle() == f"12 of {len(set(names))} columns"


def test_characteristic_columns_are_plotted_by_default(run):
    # The range of tip.x is a minor part of that of tip.y.
    assert [axis.get_title() for axis in run.plot().figure.axes] == ["tip.y", "tip.angle", "tip.x"]


def test_an_animation_is_written_to_a_file(run, tmp_path):
    path = run.animate(tmp_path / "deep" / "run.gif", speed=0.5, frames=3)
    frames = []
    with Image.open(path) as moving:
        assert moving.n_frames == 3
        # Two intervals of 0.1 s; durations of GIF frames are multiples of 10 ms.
        assert_allclose(moving.info["duration"], 200, atol=10)
        for k in range(3):
            moving.seek(k)
            frames.append(np.asarray(moving.convert("L")))
    assert not np.array_equal(frames[0], frames[-1])
    assert list(path.parent.iterdir()) == [path]


def test_an_animation_in_a_notebook_contains_trails_and_colors(run):
    animation = run.animate(frames=3, speed=0.5, color="M", trail="tip")
    data = json.loads(re.search(r'id="data">(.*?)</script>', animation.page, re.DOTALL)[1])
    assert data["speed"] == 0.5
    assert data["colored"]
    colors = [color["title"] for color in data["frames"]["colors"]]
    assert colors == ["bending moment M [N m]", "largest stress [kPa]"]
    kinds = {body["kind"]: body["points"] for body in data["frames"]["glyphs"] if "x" in body}
    # Ten points between two frames.
    assert kinds == {"trail": 21, "beam": 49}
    page = animation._repr_html_()
    assert page.startswith("<iframe srcdoc=")
    assert page.count("<") == 2


def test_equations_without_a_mechanism_cannot_be_drawn():
    solution = bd.simulate(PENDULUM.build(), ALPHA, t_end=0.1)
    assert "<svg" not in solution._repr_html_()
    with pytest.raises(bd.BeamdaeError, match="has no mechanism"):
        solution.animate()
    with pytest.raises(bd.BeamdaeError, match="has no mechanism"):
        solution.observe("x", None)


def test_a_single_point_at_rest_is_drawn():
    mech = bd.Mechanism()
    mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    solution = bd.simulate(mech, ALPHA, t_end=0.1)
    assert pickle.dumps(solution.animate(frames=2))
