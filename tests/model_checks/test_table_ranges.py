"""Warnings of runs that leave a table."""

import numpy as np
import pytest
from mechanisms import free_ball

import beamdae as bd

LEFT = "where its value is held"


def falling(rows, values, argument=lambda point, t: point.position[1], kind="linear"):
    """Return a ball that falls from 1 m with a force from a table."""
    table = bd.table(rows, values, kind=kind, name="curve")
    mech, ball = free_ball((0.0, 1.0), gravity=9.81)
    mech.add(bd.ForceLaw("pull", ball.point, lambda x, t: (0.0, table(argument(x, t)))))
    return mech


def turning(rows, values, outside="hold", unit=1.0):
    """Return a disk that turns twice with a torque from a table of its angle, times `unit`."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 1.0, (0.0, 0.0), angular_velocity=4.0 * np.pi))
    center = disk.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), center))
    table = bd.table(rows, values, "pchip", outside)
    mech.add(bd.ForceLaw("load", center, lambda disk, t: (0, 0, table(unit * disk.angle))))
    return mech


TURN, LOAD = np.radians([0.0, 90.0, 180.0, 270.0, 360.0]), [0.0, 0.0, -1.0, 0.0, 0.0]
# Model, end of the run, and words of the warning, or "".
CASES = {
    "left": (falling([0.5, 1.5], [-3.0, 3.0]), 0.9, LEFT),
    "left, nearly constant": (falling([0.5, 1.0, 1.5], [2.0, 2.001, 3.0]), 0.6, LEFT),
    "left at both sides": (falling([0.9, 0.95], [1.0, 2.0]), 0.2, LEFT),
    "zero at the end": (falling([0.5, 1.0, 1.5], [0.0, 3.0, 3.0]), 0.9, ""),
    "constant at the end": (falling([0.5, 1.0, 1.5], [2.0, 2.0, 3.0]), 0.9, ""),
    "rounding": (falling([0.5, 1.0, 1.5], [0.1 + 0.2, 0.3, 3.0]), 0.6, ""),
    "rounding of zero": (falling([0.5, 1.0, 1.5], [1e-16, 1.0, 3.0]), 0.6, ""),
    "over time": (falling([0.0, 0.1], [0.0, 3.0], lambda point, t: t), 0.3, ""),
    "inside": (falling([-1.0, 0.0, 1.0, 2.0], [1.0, 2.0, 1.0, 3.0]), 0.3, ""),
    "repeated turn": (turning(TURN, LOAD, "repeat"), 1.0, ""),
    "stop of a turn": (turning(TURN, [0.0, 0.0, 0.0, -1.0, -1.0]), 1.0, ""),
    "part of a turn": (turning(0.9 * TURN, LOAD), 1.0, ""),
}


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("mech", "t_end", "words"), CASES.values(), ids=CASES.keys())
def test_arguments_that_leave_a_table_have_a_warning(mech, t_end, words):
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=t_end)
    found = [x for x in run.warnings if LEFT in x]
    assert len(found) == bool(words)


def test_warnings_name_the_argument():
    (left,) = bd.simulate(falling([0.5, 1.5], [-3.0, 3.0]), t_end=0.9).warnings
    assert left.startswith("pull: x = -3.")
    assert "leaves the range 0.5 to 1.5 of curve at t = 0.9 s, where its value is held" in left
