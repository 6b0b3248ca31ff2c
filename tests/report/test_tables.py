"""Tables in terminals of different widths: numbers are never cut, the first column remains."""

import math
import re

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from beamdae.report import tables as terminal
from beamdae.report.tables import FactList, ResponsiveTable

WIDTHS = (40, 60, 80, 100, 120, 10_000)
LABELS = ("Ida(rtol=0.0001)", "GeneralizedAlpha(step=0.001)", "Radau(rtol=1e-05)")


def render(renderable, width, **settings):
    console = Console(width=width, **settings)
    with console.capture() as captured:
        console.print(renderable)
    return captured.get()


def create_comparison():
    numbers = {
        "wall time [s]": 0.123456,
        "steps": 123456,
        "rejected steps": 77,
        "residual calls": 654321,
        "Jacobian calls": 321,
        "error [-]": 1.2345e-05,
        "max position drift": 1.5e-12,
        "max velocity drift": 2.5e-10,
        "energy imbalance [-]": 3.5e-07,
    }
    return pd.DataFrame([{"label": label, "status": "ok", **numbers} for label in LABELS])


def create_range_table():
    return terminal.table_of(
        [
            {"observed": f"tip {k}.angle_dot [rad/s]", "end": 1.23456e-05, "error": "1.2e-06"}
            | dict.fromkeys(("min", "max", "by elements", "by strains"), -1.23456e-05)
            for k in range(3)
        ]
    )


def test_rows_of_wrapped_texts_are_separated():
    rows = [{"model": f"m{k}", "about": "several words of a sentence"} for k in range(2)]
    wide, narrow = (render(terminal.table_of(rows), width) for width in (80, 32))
    texts = [line.strip() for line in narrow.strip().splitlines()]
    assert texts.index("") < next(k for k, x in enumerate(texts) if x.startswith("m1"))
    assert "" not in [line.strip() for line in wide.strip().splitlines()]


@pytest.mark.parametrize(
    ("value", "expected"),
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
def test_numbers_are_formatted_with_three_digits(value, expected):
    assert terminal.format_number(value) == expected


def test_ranges_show_rounding_errors_as_zero_and_missing_values_as_dashes():
    t = np.linspace(0.0, 1.0, 11)
    expected = {
        "tip.x [m]": (np.cos(t), ["0.5403", "0.5403", "1"]),
        "tip.y [m]": (1e-15 * t, ["0", "0", "0"]),
        "bend.u [m]": (1e-3 * t**2, ["0.001", "0", "0.001"]),
        "none [m]": (np.nan * t, ["-", "-", "-"]),
        "early [N]": (np.where(t < 0.5, np.inf, 1.0), ["1", "1", "inf"]),
        # Values without a unit are never compared with each other.
        "small [-]": (1.0 + t, ["2", "1", "2"]),
        "large [-]": (1e15 * t, ["1e+15", "0", "1e+15"]),
    }
    observed = pd.DataFrame({name: values for name, (values, _) in expected.items()})
    lines = render(terminal.table_of(terminal.range_rows(observed)), 120).splitlines()
    rows = {line[: line.index("]") + 1].strip(): line.split()[-3:] for line in lines if "]" in line}
    assert rows == {name: texts for name, (_, texts) in expected.items()}


def test_errors_below_the_resolution_of_the_reference_are_bounds():
    table = pd.DataFrame(
        {
            "group": ["arm"] * 3,
            "label": ["A(step=1)", "B(step=2)", "C(step=3)"],
            "status": ["ok", "ok", "failed"],
            "reason": ["", "", "stopped at t = 1 s"],
            "steps": pd.array([10, 20, None], dtype="Int64"),
            "error [-]": [1e-2, math.nan, math.nan],
            "error bound [-]": [1e-2, 1e-4, math.nan],
            "below resolution": [False, True, False],
        }
    )
    lines = render(terminal.comparison_table(table), 120, markup=False).splitlines()
    rows = {line.split()[0]: line for line in lines if "(step=" in line}
    assert rows["A(step=1)"].split()[1:] == ["0.01", "ok", "10"]
    assert rows["B(step=2)"].split()[1:] == ["<", "0.0001", "ok", "20"]
    assert rows["C(step=3)"].split()[1:] == ["-", "failed", "-"]
    assert terminal.failure_sentences(table) == ["arm, C(step=3): stopped at t = 1 s"]


@pytest.mark.parametrize("width", WIDTHS)
def test_comparison_always_shows_integrator_and_error(width):
    text = render(terminal.comparison_table(create_comparison()), width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    for label in LABELS:
        (line,) = [line for line in text.splitlines() if label in line]
        assert "1.23e-05" in line
    numbers = {
        "0.123",
        "123456",
        "77",
        "654321",
        "321",
        "1.23e-05",
        "1.5e-12",
        "2.5e-10",
        "3.5e-07",
    }
    assert set(line.split()[1:]) - {"ok"} <= numbers
    assert ("not shown" in text) == (width <= 120)


def test_ranges_always_show_names_and_as_many_columns_as_fit():
    counts = []
    for width in WIDTHS:
        text = render(create_range_table(), width)
        assert max(map(len, text.splitlines())) <= width
        lines = [line for line in text.splitlines() if line.startswith(" tip ")]
        assert all("tip" in line and "…" not in line for line in lines) or width == 40
        (count,) = {len(line.partition("]")[2].split()) for line in lines if "]" in line} or {1}
        counts.append(count)
        assert ("not shown" in text) == (count < 6)
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (1, 6)


@pytest.mark.parametrize("width", [width for width in WIDTHS if width < 300])
def test_a_long_first_column_loses_its_middle(width):
    name = f"begin{'L' * 300}end"
    text = render(ResponsiveTable(["name", "most"], [(name, "3.3")]), width)
    (row,) = [line for line in text.splitlines() if "3.3" in line]
    assert re.match(r" beginL+…L+end +\d", row)
    assert len(row.rstrip()) >= width - 2


@pytest.mark.parametrize("width", [width for width in WIDTHS if width < 300])
def test_lists_break_lines_between_words_and_before_names_with_units(width):
    topic, text = "largest curvature times element length", "0.0099 (middle.Q [N]), 3 (tip [N m])"
    lines = render(FactList({topic: text, "x" * 300: "1.5"}), width).splitlines()
    assert "".join(lines).count("x") == 300
    assert max(map(len, lines)) <= width
    if width >= 60:
        assert all(any(word in line for line in lines) for word in (*topic.split(), "tip [N m]"))


@pytest.mark.parametrize("markup", [True, False])
def test_markup_in_names_is_printed_literally(markup):
    odd = "[/b] [bold] :smile: \x1b[31m"
    literal = r"[/b] [bold] :smile: \x1b[31m"
    for renderable in (
        ResponsiveTable([odd, odd], [(odd, odd)]),
        FactList({odd: odd}),
        terminal.comparison_table(create_comparison().assign(label=odd)),
    ):
        assert literal in render(renderable, 200, markup=markup)


def test_regression_sweep_tables_show_rounding_errors_as_zero():
    """A smallest force was -0, and -2.8002e-20 was shown beside values of order 1."""
    table = pd.DataFrame(
        {
            "height": [1.0, 2.0],
            "status": ["ok", "ok"],
            "contact.N end [N]": [-0.0, -2.8002e-20],
            "contact.N min [N]": [-2.8002e-20, 1.0],
            "contact.N max [N]": [3.0, 4.0],
            "gap [m]": [1e-20, 2e-20],
            "contact.Q end [N]": [0.0, -2.8002e-20],
        }
    )
    forces = ["contact.N end [N]", "contact.N min [N]", "contact.N max [N]"]
    responses = [forces, ["contact.Q end [N]"], ["gap [m]"]]
    shown = terminal.sweep_table(table, ["height"], responses)
    # The measures that vary most are the first ones, and zero outputs are the last ones.
    expected = [forces[1], "gap [m]", forces[2], forces[0], "contact.Q end [N]"]
    assert shown.headers == ["height", "status", *expected]
    assert shown.rows[0] == ["1", "ok", "0", "1e-20", "3", "0", "0"]
    zeros = terminal.sweep_table(table, ["height"], [["contact.N end [N]"]])
    assert [row[2] for row in zeros.rows] == ["0", "-2.8002e-20"]
