"""Errors of periodic motions, compared with motions of exact beams with four times the elements."""

import numpy as np
import pytest
from mechanisms import hinged_beam, mass_on_rail, rectangle

import beamdae as bd

RUNS = bd.Radau(1e-6)
STEEL = bd.Material(E=2.06e11, nu=0.3, rho=7850.0)


def strut(load=0.9, ratio=0.3):
    """Return a column under a share of Euler's load that a distributed force shakes, and a period.

    The frequency is a share of the first natural frequency.
    """
    length, section = 0.5, rectangle(2e-3, damping=1e-3, material=STEEL)
    euler = np.pi**2 * section.EI / length**2
    rate = (np.pi / length) ** 2 * ((1.0 - load) * section.EI / section.rhoA) ** 0.5
    frequency = ratio * rate / (2.0 * np.pi)
    mech, rod = hinged_beam(section, 1, length, name="rod", strain="nonlinear")
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), rod.end))
    mech.add(bd.Force("press", rod.end, (-load * euler, 0.0)))
    mech.add(bd.DistributedForce("shake", rod, (0.0, bd.sine(0.1, frequency))))
    mech.observe("middle", rod.at(0.5 * length))
    return mech, 1.0 / frequency


def blade(acceleration=15.0, frequency=43.8, elements=3, strain="nonlinear", damping=2e-5):
    """Return a tapered blade on a shaker, with its first resonance at 43.7 Hz, and the period."""
    titanium, length = bd.Material(E=114e9, nu=0.34, rho=4430.0), 0.35
    mech = bd.Mechanism()
    slide = mech.add(bd.RigidBody("slide", mass=2.0, inertia=0.01))
    ground, up = mech.ground.at(0.0, 0.0), (0.0, 1.0)
    travel = bd.sine(acceleration / (2.0 * np.pi * frequency) ** 2, frequency)
    mech.add(bd.Prismatic("guide", ground, slide.at(0.0, 0.0), direction=up))
    mech.add(bd.TranslationalDriver("shaker", ground, slide.at(0.0, 0.0), travel, direction=up))

    def section(s):
        height = 6e-3 - 3e-3 * s / length
        return rectangle(height, 0.03, damping=damping, material=titanium)

    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("blade", line, section, elements=elements, strain=strain))
    mech.add(bd.Weld("clamp", slide.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.deflection(length))
    return mech, 1.0 / frequency


def true_errors(motion, other, column):
    """Return the errors of the half range, and of the rows (root mean square), of a column."""
    sizes = [x.amplitudes().loc[column, "half range"] for x in (motion, other)]
    rows, exact = (x.table()[column].to_numpy() for x in (motion, other))
    deviation = np.sqrt(np.mean((rows - exact) ** 2)) / exact.std()
    return sorted([abs(sizes[0] / sizes[1] - 1.0), float(deviation)])


@pytest.mark.slow(reason="half a second")
def test_accurate_motions_have_no_sentence():
    motion = bd.periodic(*blade(25.0, 30.0), RUNS)
    assert motion.errors.largest < 0.01
    assert motion.warnings == ()
    assert motion.errors.table().index[-1] == "largest multiplier [-]"


@pytest.mark.slow(reason="two seconds")
def test_fixed_steps_are_refined():
    """Steps of a fifteenth of the period, and of the first-order method, lose the phase."""
    mech, period = blade(15.0, 40.0, strain="exact", elements=4, damping=1e-3)
    motion = bd.periodic(mech, period, bd.GeneralizedAlpha(period / 15.0, rho_inf=0.5))
    exact = bd.periodic(mech, period, bd.Radau(1e-8))
    smaller, larger = true_errors(motion, exact, "tip.transverse [m]")
    row = motion.errors.table().loc["tip.transverse [m]"]
    assert larger > 0.02
    assert 0.5 * smaller <= row["total"] <= 2.0 * larger
    assert row["time"] > 0.9 * row["total"]


def self_excited(elements=1, strain="nonlinear"):
    """Return a strip with a mass that a damper excites at deflections below 4 mm."""
    section = rectangle(2e-3, damping=2e-4, material=STEEL)
    mech, rod = hinged_beam(section, elements, 0.5, name="rod", gravity=9.81, strain=strain)
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), rod.end))
    mech.add(bd.Force("press", rod.end, (-0.3 * np.pi**2 * section.EI / 0.25, 0.0)))
    mech.add(bd.PointMass("lump", 0.1, on=rod.at(0.25)))

    def pull(x, rate):
        return 3.0 * ((x / 0.004) ** 2 - 1.0) * rate

    # The damper is anchored far away, so that it stays upright.
    anchor = mech.ground.at(0.25, -10.0)
    mech.add(bd.Spring("drive", anchor, rod.at(0.25), law=pull))
    mech.observe("middle", rod.at(0.25))
    return mech


@pytest.mark.slow(reason="five seconds")
def test_free_motions_state_the_error_of_the_period():
    settings = {"period_guess": 0.098, "settle": 4, "integrator": bd.Radau(1e-7)}
    motion = bd.periodic(self_excited(), **settings)
    exact = bd.periodic(self_excited(4, "exact"), **settings)
    error = abs(motion.period / exact.period - 1.0)
    table = motion.errors.table()
    assert error > 4e-4
    assert 0.5 * error < table.loc["period [s]", "total"] < 2.0 * error
    # The phase is arbitrary.
    assert table["rows"].isna().all()


@pytest.mark.slow(reason="one second")
def test_curves_state_errors_at_their_motions():
    @bd.model(t_end=1.0)
    def shaken(frequency=10.0):
        return strut(load=0.9, ratio=frequency)[0]

    response = bd.frequency_response(
        shaken, "frequency", (0.2, 0.3), lambda x: strut(ratio=x)[1], step=0.5, max_step=0.5
    )
    assert response.errors.largest == pytest.approx(response.points[-1].errors.largest, rel=0.2)
    header = "middle.y at frequency = 0.3 [m]"
    total = response.errors.table().loc[header, "total"]
    of_point = response.points[-1].errors.table().loc["middle.y [m]", "total"]
    assert total == pytest.approx(of_point, rel=1e-3)
    assert response.warnings[0].startswith("middle.")


def test_motions_without_beams_have_errors_of_steps():
    mech, mass = mass_on_rail(x=1.0, spring=(9.0, 0.5))
    mech.add(bd.Force("load", mass.point, (bd.sine(1.0, frequency=0.3), 0.0)))
    mech.observe("mass", mass.point)
    table = bd.periodic(mech, 1.0 / 0.3, RUNS).errors.table()
    assert list(table.index[-2:]) == ["mass.y_dot [m/s]", "largest multiplier [-]"]
    assert set(table["status"]) == {"measured"}
    assert 0.0 < table.loc["mass.x [m]", "total"] < 1e-4
    assert (table["time"] == table["total"]).all()


@pytest.mark.slow(reason="a second")
def test_motions_that_are_not_found_are_not_checked():
    mech, period = strut()
    motion = bd.periodic(mech, period, RUNS, settle=0, tolerance=1e-15)
    assert not motion.status.success
    statuses = set(motion.errors.table()["status"])
    assert statuses == {"not checked: no periodic motion was found"}
