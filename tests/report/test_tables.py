"""Tables in terminals of every width: numbers stay whole, the first column stays."""

import re

import numpy as np
import pandas as pd
import pytest
from pendulum import pendulum
from rich.cells import cell_len
from rich.console import Console

import beamdae as bd
from beamdae.report.terminal import text_tables as terminal
from beamdae.report.terminal.responsive_table import Column, ResponsiveTable, shorten_to_cells

WIDTHS = (40, 60, 80, 100, 120, 10_000)
LABELS = ("Ida(rtol=0.0001)", "GeneralizedAlpha(step=0.001)", "Radau(rtol=1e-05)")


def printed(renderable, width, **settings):
    console = Console(width=width, **settings)
    with console.capture() as captured:
        console.print(renderable)
    return captured.get()


def comparison():
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


def ranges():
    observed = pd.DataFrame(
        {f"tip {k}.angle_dot [rad/s]": [-1.23456e-05, 1.23456e-05] for k in range(3)}
    )
    columns = ["half the range", "error over half the range", "allowed", "verdict"]
    values = [1.0, 1.2e-06, 1e-3, "agrees"]
    errors = pd.DataFrame([values] * 3, columns=columns, index=list(observed))
    return terminal.range_table(observed, errors)


@pytest.mark.parametrize("width", WIDTHS)
def test_comparison_keeps_integrator_and_error_and_cuts_no_number(width):
    text = printed(terminal.comparison_table(comparison()), width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    for label in LABELS:
        (line,) = [line for line in text.splitlines() if label in line]
        assert "1.23e-05" in line
    told = {"0.123", "123456", "77", "654321", "321", "1.23e-05", "1.5e-12", "2.5e-10", "3.5e-07"}
    assert set(line.split()[1:]) - {"ok"} <= told
    assert ("not shown" in text) == (width <= 120)


@pytest.mark.parametrize("width", WIDTHS)
def test_ranges_keep_the_column_the_error_and_the_verdict(width):
    text = printed(ranges(), width)
    assert max(map(len, text.splitlines())) <= width
    lines = [line for line in text.splitlines() if "tip " in line]
    for line in lines:
        assert line.split()[-1] == "agrees"
        assert "1.2e-06" in line
    assert ("not shown" in text) == (width < 100)


def test_what_is_left_out_is_said_with_where_it_is():
    text = " ".join(printed(terminal.comparison_table(comparison()), 60).split())
    assert "not shown: " in text
    assert "velocity drift" in text
    assert "a wider terminal or cases.csv shows them" in text


@pytest.mark.parametrize("width", [width for width in WIDTHS if width < 300])
def test_a_first_column_of_three_hundred_letters_loses_its_middle_beside_whole_numbers(width):
    columns = [Column("least", 2), Column("more", 1), Column("most")]
    name = f"begin{'L' * 300}end"
    text = printed(ResponsiveTable("name", columns, [(name, "1.1", "2.2", "3.3")]), width)
    (row,) = [line for line in text.splitlines() if "3.3" in line]
    assert re.match(r" beginL+…L+end +\d", row)
    assert len(row.rstrip()) >= width - 2
    text = printed(terminal.fact_list("", {name: 1.5}), width)
    assert re.match(r"beginL+…L+end  ?1.5", text)


def test_wide_letters_are_cut_by_the_cells_they_take():
    for most in range(1, 50):
        short = shorten_to_cells("梁" * 20 + "beam", most)
        assert cell_len(short) <= most
        assert cell_len(short) >= min(most - 2, 44)
    assert shorten_to_cells("梁" * 20 + "beam", 11) == "梁梁梁…beam"
    assert shorten_to_cells("abcdefgh", 4) == "ab…h"


@pytest.mark.parametrize("markup", [True, False])
def test_markup_in_names_is_text(markup):
    odd = "[/b] [bold] :smile: \x1b[31m"
    shown = r"[/b] [bold] :smile: \x1b[31m"
    for renderable in (
        ResponsiveTable(odd, [Column(odd, sentences=True)], [(odd, odd)]),
        terminal.fact_list(odd, {odd: odd}),
        terminal.parts_table({odd: odd}),
        terminal.comparison_table(comparison().assign(label=odd)),
    ):
        assert shown in printed(renderable, 200, markup=markup)


def test_summary_tells_units_with_values():
    lines = [
        ("arm", "fastest", "error <= 1e-02", "Ida", 0.25, "s", 0.2, 0.4, "Radau"),
        ("arm", "fastest", "error <= 1e-03", "Auto", 0.3, "s", np.nan, np.nan, ""),
        ("arm", "order", "", "I", 2, "", np.nan, np.nan, ""),
    ]
    names = ["group", "what", "at", "answer", "value", "unit", "min", "max", "as fast"]
    table = pd.DataFrame(lines, columns=names)
    rows = printed(terminal.summary_table(table), 50).splitlines()
    assert [r.split()[-5:] for r in rows if "Ida" in r] == [["0.25", "s", "(0.2", "to", "0.4)"]]
    assert [r.split()[-2:] for r in rows if "Auto" in r] == [["0.3", "s"]]
    assert [r.split()[-1] for r in rows if "order" in r] == ["2"]
    assert "Radau" in printed(terminal.summary_table(table), 100)
    assert "as fast" not in printed(terminal.summary_table(table.iloc[1:]), 100)


def test_ranges_of_columns_that_are_not_finite():
    table = pd.DataFrame({"a [m]": [np.nan, np.nan], "b [m]": [np.inf, 1.0], "c [m]": [1.0, 2.0]})
    text = printed(terminal.range_table(table), 80)
    assert [line.split()[-3:] for line in text.splitlines() if "[m]" in line] == [
        ["-", "-", "-"],
        ["1", "inf", "1"],
        ["1", "2", "2"],
    ]


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"limited_by": {"rod.x": 0.614, "rod.phi": 0.2}}, "rod.x 61%, rod.phi 20% of the steps"),
        ({"limited_by": {}}, None),
        ({}, None),
    ],
    ids=["some", "no step", "another method"],
)
def test_what_limits_the_step_has_a_line_where_it_is_known(settings, told):
    solution = bd.simulate(pendulum(), bd.GeneralizedAlpha(step=0.01), 0.02)
    facts = terminal.run_facts(solution.summary(), settings | {"orders": {"1": 2}})
    assert facts.get("limited by") == told
    assert "orders" not in facts["integrator"]
