"""Warnings of runs that leave a table, or whose arguments do not fit its range."""

import numpy as np
import pytest

import beamdae as bd

LEFT, MISFIT, UNIT, REPEAT = "where its value is held", "but the table is", "is an angle", "repeats"
WORDS = (LEFT, MISFIT, UNIT, REPEAT)


def falling(rows, values, argument=lambda point, t: point.position[1], kind="linear"):
    """Return a ball that falls from 1 m with a force from a table."""
    table = bd.table(rows, values, kind=kind, name="curve")
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0)))
    mech.add(bd.ForceLaw("pull", ball.point, lambda x, t: (0.0, table(argument(x, t)))))
    return mech


def depth(scale=1.0, offset=0.0):
    """Return an argument: the fallen distance, in another unit and from another zero."""
    return lambda point, t: scale * (1.0 - point.position[1]) + offset


def turning(rows, values, outside="hold", unit=1.0):
    """Return a disk that turns twice with a torque from a table of its angle, times `unit`."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 1.0, (0.0, 0.0), angular_velocity=4.0 * np.pi))
    center = disk.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), center))
    table = bd.table(rows, values, "pchip", outside)
    mech.add(bd.ForceLaw("load", center, lambda disk, t: (0, 0, table(unit * disk.angle))))
    return mech


def driven_ram(rows, values, amplitude=0.05, center=0.35, stop=None):
    """Return a ram that moves by `amplitude` about `center`, with a force from a table."""
    mech = bd.Mechanism()
    ram = mech.add(bd.PointMass("ram", 50.0, at=(0.0, center)))
    guide = mech.ground.at(0.0, 0.0), ram.point
    mech.add(bd.PointOnLine("guide", *guide, direction=(0.0, 1.0)))
    law = bd.sine(amplitude, frequency=1.0)
    mech.add(bd.TranslationalDriver("drive", *guide, law, direction=(0.0, 1.0)))
    for name, table in (("process", (rows, values)), ("stop", stop)):
        if table is not None:
            curve = bd.table(*table, kind="linear")

            def force(point, t, curve=curve):
                return 0.0, curve(point.position[1])

            mech.add(bd.ForceLaw(name, ram.point, force))
    return mech


PAD, CURVE, ROWS = [0.0, 3.0, 0.0], [0.0, 3.0, 5.0, 6.0], [0.0, 100.0, 300.0, 500.0]
TURN, LOAD = np.radians([0.0, 90.0, 180.0, 270.0, 360.0]), [0.0, 0.0, -1.0, 0.0, 0.0]
WAVE = [0.0, 1.0, 3.0, 1.0, 0.0]
PROCESS = [0.0, 3e-3, 6e-3], [118e3, 60e3, 0.0]
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
    "turn": (turning(TURN, LOAD), 1.0, REPEAT),
    "repeated turn": (turning(TURN, LOAD, "repeat"), 1.0, ""),
    "stop of a turn": (turning(TURN, [0.0, 0.0, 0.0, -1.0, -1.0]), 1.0, ""),
    "part of a turn": (turning(0.9 * TURN, LOAD), 1.0, ""),
    "rad in degrees": (turning(np.degrees(TURN), WAVE), 1.0, UNIT),
    "rad in a quarter in degrees": (turning(np.degrees(TURN) / 4.0, WAVE, "repeat"), 1.0, UNIT),
    "degrees in rad": (turning(TURN, WAVE, "repeat", 180.0 / np.pi), 1.0, UNIT),
    "degrees": (turning(np.degrees(TURN), WAVE, "repeat", 180.0 / np.pi), 1.0, ""),
    "m in mm": (falling(ROWS, CURVE, depth()), 0.3, MISFIT),
    "m in mm, smooth": (falling(ROWS, CURVE, depth(), "pchip"), 0.3, MISFIT),
    "mm in m": (falling([0.0, 0.005, 0.01], PAD, depth(1e3)), 0.2, MISFIT),
    "mm pass an end zone in m": (falling([0.0, 0.004, 0.008], PAD, depth(-1e3, 785)), 0.4, MISFIT),
    "m pass an end zone": (falling([0.0, 0.004, 0.008], PAD, depth(-1.0, 0.785)), 0.4, ""),
    "m pass a thin end zone": (falling([0.0, 5e-5, 1e-4], PAD, depth(-1.0, 0.785)), 0.4, ""),
    "mm pass an end zone in mm": (falling([0.0, 4.0, 8.0], PAD, depth(-1e3, 785)), 0.4, ""),
    "pad far below": (falling([-0.002, 0.0], [5e4, 0.0]), 0.45, ""),
    "point of operation": (falling(ROWS, CURVE, depth(1.0, 200.0)), 0.3, ""),
    "about zero": (falling([-30.0, -10.0, 10.0, 30.0], CURVE, depth()), 0.3, ""),
    "rows for small motions": (falling([0.0, 0.1, 0.2, 500.0], CURVE, depth()), 0.3, ""),
    "at rest": (falling(ROWS, CURVE, lambda point, t: point.position[0]), 0.3, ""),
    "touched at last": (falling([0.0, 0.05, 0.1, 0.2], CURVE, depth(1.0, -0.44)), 0.3, ""),
    "never entered": (driven_ram(*PROCESS), 1.0, MISFIT),
    "never entered from below": (driven_ram([0.744, 0.747, 0.75], CURVE[:3]), 1.0, MISFIT),
    "entered": (driven_ram(*PROCESS, center=0.055), 1.0, ""),
    "near": (driven_ram(*PROCESS, center=0.15), 1.0, ""),
    "small motion": (driven_ram(*PROCESS, amplitude=1e-3), 1.0, ""),
    "two stops": (driven_ram(*PROCESS, stop=([0.744, 0.75], [0.0, -118e3])), 1.0, ""),
}


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("mech", "t_end", "words"), CASES.values(), ids=CASES.keys())
def test_arguments_that_do_not_fit_a_table_have_a_warning(mech, t_end, words):
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=t_end)
    found = [x for x in run.warnings if any(word in x for word in WORDS)]
    assert len(found) == bool(words)
    assert all(words in x for x in found)


def test_warnings_name_the_argument_and_the_remedy():
    (left,) = bd.simulate(falling([0.5, 1.5], [-3.0, 3.0]), t_end=0.9).warnings
    assert left.startswith("pull: x = -3.")
    assert "leaves the range 0.5 to 1.5 of curve at t = 0.9 s, where its value is held" in left
    assert "repeat its first value there if it stays constant" in left
    (misfit,) = bd.simulate(falling(ROWS, CURVE, depth()), t_end=0.3).warnings
    assert misfit.startswith("pull: x of curve is 0 to 0.44")
    assert misfit.endswith(
        "during the run, but the table is over 0 to 500; check the units of both and the zero "
        "offset of the argument."
    )
