"""Warnings of runs that leave a table that holds its values."""

import warnings

import numpy as np
import pytest

import beamdae as bd


def falling(table, argument=lambda point, t: point.position[1]):
    """Return a ball that falls from 1 m with a force from a table."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0)))

    def law(point, t):
        return (0.0, table(argument(point, t)))

    mech.add(bd.ForceLaw("pull", ball.point, law))
    mech.observe("ball", ball.point)
    return mech


def test_regression_runs_outside_a_table_carry_a_warning():
    """The force beyond the end of the table was held without a warning."""
    table = bd.table([0.5, 1.5], [-3.0, 3.0], kind="linear")
    message = r"pull: x = -3.\d* leaves the range 0.5 to 1.5 of table at t = 0.9 s"
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(falling(table), t_end=0.9)


@pytest.mark.parametrize("values", [(0.0, 3.0, 3.0), (2.0, 2.0, 3.0)])
def test_zero_and_constant_ends_of_tables_continue_without_a_warning(values):
    table = bd.table([0.5, 1.0, 1.5], list(values), kind="linear")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(falling(table), t_end=0.9)


@pytest.mark.parametrize(
    "values",
    [(0.1 + 0.2, 0.3, 3.0), (1e-16, 1.0, 3.0), (0.1 + 0.2, 0.3, 0.3)],
    ids=["constant end", "zero end", "constant"],
)
def test_regression_ends_with_rounding_errors_continue_without_a_warning(values):
    table = bd.table([0.5, 1.0, 1.5], list(values), kind="linear")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(falling(table), t_end=0.6)


def test_regression_the_warning_names_the_remedy_for_a_constant_end():
    table = bd.table([0.5, 1.0, 1.5], [2.0, 2.001, 3.0], kind="linear")
    with pytest.warns(bd.BeamdaeWarning, match="repeat its first value there if it stays constant"):
        bd.simulate(falling(table), t_end=0.6)


def test_tables_over_time_hold_their_last_value_without_a_warning():
    table = bd.table([0.0, 0.1], [0.0, 3.0], kind="linear")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(falling(table, lambda point, t: t), t_end=0.3)


def test_runs_inside_the_table_carry_no_warning():
    table = bd.table(np.linspace(-1.0, 2.0, 4), [1.0, 2.0, 1.0, 3.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(falling(table), t_end=0.3)


def test_regression_arguments_in_other_units_than_a_table_carry_a_warning():
    """A table in millimeters was without effect, and without a warning, at its zero end."""
    message = r"^pull: x = .* leaves the range .* times its length; check the units of the table"
    inside = bd.table([0.0, 0.005, 0.01], [0.0, 3.0, 0.0], kind="linear")
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(falling(inside, lambda point, t: 1e3 * (1.0 - point.position[1])), t_end=0.2)
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(falling(inside, lambda point, t: 2.0 + point.position[1]), t_end=0.2)
    pad = bd.table([-0.002, 0.0], [5e4, 0.0], kind="linear")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(falling(pad), t_end=0.452)
