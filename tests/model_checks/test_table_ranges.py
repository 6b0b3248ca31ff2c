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


def turning(angles, values, outside="hold", unit=1.0):
    """Return a disk that turns twice with a torque from a table of its angle, times `unit`."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 1.0, (0.0, 0.0), angular_velocity=4.0 * np.pi))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0)))
    table = bd.table(angles, values, "pchip", outside)
    mech.add(
        bd.ForceLaw("load", disk.at(0.0, 0.0), lambda disk, t: (0, 0, table(unit * disk.angle)))
    )
    mech.observe("disk", disk.at(0.0, 0.0))
    return mech


TURN = np.radians([0.0, 90.0, 180.0, 270.0, 360.0])


@pytest.mark.slow(reason="half a second")
def test_regression_tables_of_one_turn_that_turn_on_carry_a_warning():
    """A press had no load from its second turn on, because its table is zero at both ends."""
    load = [0.0, 0.0, -1.0, 0.0, 0.0]
    with pytest.warns(bd.BeamdaeWarning, match=r"load: x = 12.* if the table repeats with each tu"):
        bd.simulate(turning(TURN, load), t_end=1.0)
    assert bd.simulate(turning(TURN, load, "repeat"), t_end=1.0).warnings == ()
    # A stop on one side, and a table of another range.
    for angles, values in ((TURN, [0.0, 0.0, 0.0, -1.0, -1.0]), (0.9 * TURN, load)):
        assert bd.simulate(turning(angles, values), t_end=1.0).warnings == ()


@pytest.mark.parametrize("outside", ["hold", "repeat"])
@pytest.mark.parametrize("turns", [0.25, 1.0, 2.0])
def test_regression_angles_in_rad_in_tables_over_degrees_have_a_warning(turns, outside):
    """A press had no load in any turn, in silence, and a table over rad held its last value."""
    load = [0.0, 1.0, 3.0, 1.0, 0.0]
    degrees, angles = np.linspace(0.0, 360.0 * turns, 5), np.linspace(0.0, 2.0 * np.pi * turns, 5)
    words = "load: x of table is an angle in {}, but the table seems to be over {}"
    for rows, unit, units in (
        (degrees, 1.0, ("rad", "degrees")),
        (angles, 180.0 / np.pi, ("degrees", "rad")),
    ):
        with pytest.warns(bd.BeamdaeWarning, match=words.format(*units)):
            bd.simulate(turning(rows, load, outside, unit), t_end=1.0)
    for rows, unit in ((degrees, 180.0 / np.pi), (angles, 1.0)):
        warned = bd.simulate(turning(rows, load, outside, unit), t_end=1.0).warnings
        assert not any("is an angle in" in x for x in warned)


def test_runs_inside_the_table_carry_no_warning():
    table = bd.table(np.linspace(-1.0, 2.0, 4), [1.0, 2.0, 1.0, 3.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(falling(table), t_end=0.3)


@pytest.mark.slow(reason="half a second")
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


@pytest.mark.parametrize(
    ("rows", "unit", "is_reported"),
    [
        # An end zone of 8 mm: position in mm, in cm, in m, and both in mm. A thin pad.
        ([0.0, 0.004, 0.008], 1e3, True),
        ([0.0, 0.004, 0.008], 1e2, True),
        ([0.0, 0.004, 0.008], 1.0, False),
        ([0.0, 5e-5, 1e-4], 1.0, False),
        ([0.0, 4.0, 8.0], 1e3, False),
    ],
)
def test_regression_positions_in_mm_that_pass_a_table_over_m_have_a_warning(
    rows, unit, is_reported
):
    """A press did .0037 J of 385 J, because its positions pass the table at any speed."""
    table = bd.table(rows, [0.0, 3.0, 0.0], kind="linear")
    last = 1.0 - 0.5 * 9.81 * 0.4**2
    mech = falling(table, lambda point, t: unit * (point.position[1] - last))
    warned = bd.simulate(mech, t_end=0.4).warnings
    assert any("check the units of the table" in x for x in warned) == is_reported


def depth(point, t):
    """Return the fallen distance [m]."""
    return 1.0 - point.position[1]


@pytest.mark.parametrize("kind", ["linear", "pchip", "spline"])
def test_regression_runs_that_hardly_use_a_table_have_a_warning(kind):
    """A table over mm instead of m gave 0.1 % of its force, without a warning."""
    table = bd.table([0.0, 100.0, 300.0, 500.0], [0.0, 3.0, 5.0, 6.0], kind=kind, name="curve")
    message = (
        r"^pull: x of curve is 0 to 0.44\d* during the whole run, 0.088 % of the range 0 to 500 of "
        "the table; check the units of the table and of its argument.$"
    )
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(falling(table, depth), t_end=0.3)


@pytest.mark.parametrize(
    ("rows", "argument"),
    [
        # Other points of operation, and small motions about zero.
        ([0.0, 100.0, 300.0, 500.0], lambda point, t: 200.0 + depth(point, t)),
        ([-30.0, -10.0, 10.0, 30.0], depth),
        # Rows for small motions.
        ([0.0, 0.1, 0.2, 500.0], depth),
        # Constant arguments, and times.
        ([0.0, 100.0, 300.0, 500.0], lambda point, t: point.position[0]),
        ([0.0, 100.0, 300.0, 500.0], lambda point, t: t),
        # A pad that is touched at the end of a long way.
        ([0.0, 0.05, 0.1, 0.2], lambda point, t: depth(point, t) - 0.44),
    ],
)
def test_small_motions_in_tables_have_no_warning(rows, argument):
    table = bd.table(rows, [0.0, 3.0, 5.0, 6.0], kind="linear")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(falling(table, argument), t_end=0.3)


def driven_ram(table, amplitude=0.05, center=0.35, second=None):
    """Return a ram that moves by `amplitude` about `center`, with a force from a table."""
    mech = bd.Mechanism()
    ram = mech.add(bd.PointMass("ram", 50.0, at=(0.0, center)))
    guide = mech.ground.at(0.0, 0.0), ram.point
    mech.add(bd.PointOnLine("guide", *guide, direction=(0.0, 1.0)))
    law = bd.sine(amplitude, frequency=1.0)
    mech.add(bd.TranslationalDriver("drive", *guide, law, direction=(0.0, 1.0)))
    for name, curve in (("process", table), ("stop", second)):
        if curve is not None:

            def force(point, t, curve=curve):
                return 0.0, curve(point.position[1])

            mech.add(bd.ForceLaw(name, ram.point, force))
    return mech


def find_unentered(mech, t_end=1.0):
    run = bd.simulate(mech, bd.Radau(1e-3), t_end=t_end, output_step=0.01)
    return [x for x in run.warnings if "where its value is zero" in x]


PROCESS = bd.table([0.0, 3e-3, 6e-3], [118e3, 60e3, 0.0], kind="linear", name="process table")


def test_regression_tables_that_are_never_entered_have_a_warning():
    """The zero offset of a process force was missing, and the force was 0 during the run."""
    (sentence,) = find_unentered(driven_ram(PROCESS))
    assert sentence.startswith("process: x of process table is 0.3")
    assert sentence.endswith(
        " during the whole run, outside the range 0 to 0.006 of the table, where its value is "
        "zero; check the zero offset and the unit of the argument."
    )
    mirrored = bd.table([0.744, 0.747, 0.75], [0.0, 60e3, 118e3], kind="linear")
    assert len(find_unentered(driven_ram(mirrored))) == 1


@pytest.mark.parametrize(
    "mech",
    [
        driven_ram(PROCESS, center=0.055),
        driven_ram(PROCESS, center=0.15),
        driven_ram(PROCESS, amplitude=1e-3),
        driven_ram(bd.table([0.0, 3e-3, 6e-3], [118e3, 9e4, 60e3], kind="linear")),
        driven_ram(PROCESS, second=bd.table([0.744, 0.75], [0.0, -118e3], kind="linear")),
    ],
    ids=["entered", "near", "small motion", "force at the edge", "two stops"],
)
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_stops_that_are_not_reached_have_no_warning(mech):
    assert find_unentered(mech) == []
