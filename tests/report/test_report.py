"""Tables and pictures: what they show, and that they leave matplotlib's state alone."""

import math

import matplotlib
import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from rich.console import Console

import beamdae as bd
from beamdae.report.pictures import figures as pictures
from beamdae.report.terminal import text_tables as terminal

T = np.linspace(0.0, 1.0, 11)
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


def text(renderable):
    console = Console(width=120, markup=False, highlight=False)
    with console.capture() as captured:
        console.print(renderable)
    return captured.get()


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (12, "12"),
        (np.int64(12), "12"),
        (0.0, "0"),
        (0.000123456, "0.000123"),
        (1.23456e-7, "1.23e-07"),
        (math.nan, "-"),
        (None, "-"),
        (pd.NA, "-"),
        (True, "True"),
        ("auto", "auto"),
    ],
)
def test_number_in_few_characters(value, shown):
    assert terminal.format_number(value) == shown


def test_ranges_show_units_and_no_rounding():
    lines = text(terminal.range_table(FRAME.drop(columns="t [s]"))).splitlines()
    rows = {line[: line.index("]") + 1].strip(): line.split()[-3:] for line in lines if "]" in line}
    assert rows["tip.x [m]"] == ["0.5403", "1", "0.5403"]
    assert rows["tip.y [m]"] == ["0", "0", "0"]
    assert rows["bend.u [m]"] == ["0", "0.001", "0.001"]


def test_comparison_marks_what_the_reference_cannot_tell():
    table = pd.DataFrame(
        {
            "group": ["arm"] * 3,
            "label": ["A(step=1)", "B(step=2)", "C(step=3)"],
            "status": ["ok", "ok", "failed"],
            "reason": ["", "", "stopped at t = 1 s"],
            "steps": pd.array([10, 20, None], dtype="Int64"),
            "error [-]": [1e-2, 1e-6, math.nan],
            "below resolution": [False, True, False],
            "reference uncertainty [-]": [1e-5] * 3,
        }
    )
    shown = text(terminal.comparison_table(table)).splitlines()
    rows = {line.split()[0]: line for line in shown if "(step=" in line}
    assert rows["A(step=1)"].split()[1:] == ["ok", "10", "0.01"]
    assert rows["B(step=2)"].split()[1:] == ["ok", "20", "<", "0.0001"]
    assert rows["C(step=3)"].split()[1:] == ["failed", "-", "-"]
    assert terminal.failure_sentences(table) == ["arm, C(step=3): stopped at t = 1 s"]


def test_deformation_characterizes_a_comparison():
    assert pictures.characteristic_columns(FRAME) == ["bend.u [m]", "bend.phi [rad]"]
    rigid = FRAME.drop(columns=["bend.u [m]", "bend.phi [rad]"])
    assert pictures.characteristic_columns(rigid) == ["tip.x [m]", "tip.angle [rad]"]
    assert pictures.characteristic_columns(FRAME[["t [s]", "gauge 1 [-]"]]) == ["gauge 1 [-]"]


def test_panels_leave_out_rates_energies_and_what_rests():
    assert pictures._groups(FRAME) == {
        ("tip", "m"): ["tip.x [m]"],
        ("tip", "rad"): ["tip.angle [rad]"],
        ("bend", "m"): ["bend.u [m]"],
        ("bend", "rad"): ["bend.phi [rad]"],
        ("gauge 1", "-"): ["gauge 1 [-]"],
    }


def drawn(path):
    """Share of the picture that is neither white nor gray."""
    image = matplotlib.image.imread(path)[..., :3]
    return float(np.mean(np.ptp(image, axis=-1) > 0.2))


def test_picture_of_run_has_curves(tmp_path):
    path = pictures.plot_run(tmp_path / "new" / "run.png", FRAME, "title")
    assert drawn(path) > 1e-3


def test_picture_of_a_run_without_observables_shows_energies(tmp_path):
    frame = FRAME[["t [s]", "energy.kinetic [J]"]]
    assert drawn(pictures.plot_run(tmp_path / "run.png", frame, "title")) > 1e-3


@pytest.mark.slow(reason="half a second and more")
def test_picture_of_comparison_has_a_curve_in_each_color(tmp_path):
    errors = pd.DataFrame({"bend.u [m]": [0.0, *1e-3 * T[1:]]}, index=T)
    runs = {"A": (FRAME, errors), "B": (FRAME * 1.1, 10.0 * errors), "C": (FRAME * 0.9, None)}
    path = pictures.plot_comparison(tmp_path / "c.png", FRAME, runs, 1e-4, "title")
    image = matplotlib.image.imread(path)[..., :3]
    for color in pictures.COLORS[:3]:
        distance = np.abs(image - np.array(matplotlib.colors.to_rgb(color))).max(axis=-1)
        assert np.sum(distance < 0.02) > 200


def test_pictures_leave_the_global_state_alone(tmp_path):
    with matplotlib.rc_context({"lines.linewidth": 1.23, "axes.grid": True}):
        before = dict(matplotlib.rcParams)
        frame = FRAME[["t [s]", "tip.x [m]"]]
        pictures.plot_run(tmp_path / "run.png", frame, "title")
        assert dict(matplotlib.rcParams) == before


def test_picture_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(bd.BeamdaeError, match=r"run\.png: it cannot be written"):
        pictures.plot_run(tmp_path / "file" / "run.png", FRAME, "title")


def test_names_are_drawn_as_written(tmp_path):
    odd = pd.DataFrame(
        {
            "t [s]": [0.0, 1.0],
            r"price $\frac$.x [m]": [0.0, 1.0],
            r"price $\frac$.y [m]": [0.0, 2.0],
            "梁.x [m]": [0.0, 1.0],
        }
    )
    assert pictures.plot_run(tmp_path / "odd.png", odd, "odd").stat().st_size > 0


def test_regression_values_without_a_unit_are_not_rounding_beside_larger_ones():
    table = terminal.range_table(pd.DataFrame({"a [-]": [1.0, 2.0], "b [-]": [1e15, np.inf]}))
    (line,) = [line for line in text(table).splitlines() if "a [-]" in line]
    assert line.split()[2:] == ["1", "2", "2"]
