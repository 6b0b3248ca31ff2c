"""Bode diagrams against the transfer functions of oscillators."""

from itertools import pairwise

import numpy as np
import pytest
from mechanisms import clamped_beam, hinged_beam, rectangle
from numpy.testing import assert_allclose

import beamdae as bd


def oscillator(damping=0.02, count=1, feedback=0.0):
    """Return a linear model of masses of 2 kg, each on a spring of 200 (k + 1) N/m."""
    mech = bd.Mechanism()
    push = mech.input("push", unit="N")
    for k in range(count):
        mass = mech.add(bd.PointMass(f"mass {k}", 2.0, at=(1.0, float(k))))
        wall = mech.ground.at(0.0, float(k))
        mech.add(bd.PointOnLine(f"rail {k}", wall, mass.point, (1.0, 0.0)))
        spring = bd.Spring(f"spring {k}", wall, mass.point, 200.0 * (k + 1), damping, 1.0)
        mech.add(spring)
        rate = mech.sensor(f"rate {k}", mass.point, "x_dot")
        mech.add(bd.Force(f"force {k}", mass.point, (push + feedback * rate, 0.0)))
        mech.observe(f"mass {k}", mass.point)
    return bd.linearize(mech, inputs=["push"], outputs=[f"mass {k}.x" for k in range(count)])


@pytest.mark.parametrize("damping", [1e-4, 0.02, 8.0])
def test_default_frequencies_contain_all_peaks_and_half_powers(damping):
    diagram = bd.bode(oscillator(damping, 3))
    peaks = diagram.peak_table()
    assert len(peaks) == 3
    for k, row in peaks.iterrows():
        w, decay = np.sqrt(100.0 * (k + 1)), damping / 4.0
        largest = 1.0 / (damping * np.sqrt(w**2 - decay**2))
        assert row["output / input"] == f"mass {k}.x / push"
        assert row["unit"] == "m/N"
        # The resonance of the displacement is below the natural frequency.
        assert row["magnitude"] == pytest.approx(largest, rel=1e-2)
        assert row["magnitude"] < (1.0 + 1e-9) * largest
        own = diagram.frequencies * 2.0 * np.pi
        for power, position in ((1.0, 0.0), (0.5, 1.0), (0.5, -1.0)):
            at = int(np.argmin(np.abs(own - np.sqrt(w**2 - decay**2) - position * decay)))
            if damping < 1.0:
                size = np.abs(diagram.response[at, k, 0]) / largest
                assert size**2 == pytest.approx(power, rel=2e-3)
    assert not diagram.warnings


def test_regression_free_motions_of_thin_beams_do_not_grow():
    """Rounding of the state matrix made an unstable pole of 199 1/s of a free rotation."""
    h = 1.2e-5
    section = rectangle(h, 10.0 * h)
    mech, leaf = hinged_beam(section, 4, (0.0, -0.06), name="leaf")
    mech.add(bd.Force("push", leaf.end, (0.0, 0.0)))
    mech.observe("tip", leaf.end)
    diagram = bd.bode(bd.linearize(mech, inputs=["push.Fx"], outputs=["tip.x"]), [1.0, 10.0])
    assert np.all(diagram.model.poles[:2] == 0.0)
    assert np.all(diagram.model.poles.real == 0.0)
    assert not any("unstable" in x for x in diagram.warnings)


def chain(stiffnesses, damping):
    """Return a linear model of masses of 1 kg on springs, with a force on the first mass."""
    mech = bd.Mechanism()
    before = mech.ground.at(0.0, 0.0)
    for k, stiffness in enumerate(stiffnesses):
        mass = mech.add(bd.PointMass(f"mass {k}", 1.0, at=(k + 1.0, 0.0)))
        mech.add(bd.PointOnLine(f"rail {k}", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
        spring = bd.Spring(f"spring {k}", before, mass.point, stiffness, damping * stiffness)
        mech.add(spring)
        mech.add(bd.Force(f"push {k}", mass.point, (0.0, 0.0)))
        mech.observe(f"mass {k}", mass.point)
        before = mass.point
    return bd.linearize(mech, inputs=["push 0.Fx"], outputs=["mass 0.x"])


def test_regression_small_peaks_are_listed():
    """Peaks below 1 % of the largest one were omitted without a note."""
    for damping, tolerance in ((0.0, 1e-5), (1e-4, 6e-3)):
        model = chain([100.0, 1e3, 1e4], damping)
        frequencies = np.sort(model.poles.imag[model.poles.imag > 0.0]) / (2.0 * np.pi)
        peaks = bd.bode(model).peak_table()
        assert_allclose(peaks["frequency [Hz]"], frequencies, rtol=tolerance)
    assert peaks["magnitude"].iloc[-1] < 1e-5 * peaks["magnitude"].iloc[0]


def masses_between_walls(mass, stiffnesses, number):
    """Return a linear model of masses in a row, with force and position of one of them."""
    mech = bd.Mechanism()
    masses = [
        mech.add(bd.PointMass(f"mass {k}", mass, at=(k + 1.0, 0.0)))
        for k in range(len(stiffnesses) - 1)
    ]
    walls = mech.ground.at(0.0, 0.0), mech.ground.at(len(stiffnesses), 0.0)
    points = [walls[0], *(x.point for x in masses), walls[1]]
    for k, one in enumerate(masses):
        mech.add(bd.PointOnLine(f"rail {k}", walls[0], one.point, (1.0, 0.0)))
    for k, (ends, stiffness) in enumerate(zip(pairwise(points), stiffnesses, strict=True)):
        mech.add(bd.Spring(f"spring {k}", *ends, stiffness))
    mech.add(bd.Force("push", masses[number].point, (0.0, 0.0)))
    mech.observe("mass", masses[number].point)
    return bd.linearize(mech, outputs=["mass.x"], inputs=["push.Fx"])


def test_rounding_errors_are_no_peaks():
    # The second mode of equal springs between walls does not move its node, the middle mass.
    peaks = bd.bode(masses_between_walls(1.0, [100.0] * 4, 1)).peak_table()
    expected = 10.0 * np.sqrt([2.0 - np.sqrt(2.0), 2.0 + np.sqrt(2.0)]) / (2.0 * np.pi)
    assert_allclose(peaks["frequency [Hz]"], expected, rtol=1e-5)


@pytest.mark.parametrize("coupling", [2e-6, 4e-5, 1e-4])
def test_undamped_modes_at_nearly_one_frequency_have_one_peak(coupling):
    peaks = bd.bode(masses_between_walls(2.0, [200.0, coupling, 200.0], 0)).peak_table()
    assert peaks["magnitude"].tolist() == [np.inf]
    assert peaks["frequency [Hz]"][0] == pytest.approx(10.0 / (2.0 * np.pi), rel=1e-6)


@pytest.mark.parametrize("damping", [0.5, 4.0, 12.0])
@pytest.mark.parametrize("grid", [[1.3, 1.5, 1.7], [0.4, 1.45, 2.9], None])
def test_regression_peaks_of_an_oscillator_are_exact_between_frequencies(damping, grid):
    """Peaks moved with the range, whose grid contains them, and so did their phases."""
    (peak,) = bd.bode(oscillator(damping), grid).peak_table().to_dict("records")
    s = 1j * np.sqrt(100.0 - 2.0 * (damping / 4.0) ** 2)
    exact = 1.0 / (2.0 * s**2 + damping * s + 200.0)
    assert peak["peak"]
    assert peak["frequency [Hz]"] == pytest.approx(s.imag / (2.0 * np.pi), rel=1e-6)
    assert peak["magnitude"] == pytest.approx(abs(exact), rel=1e-6)
    assert peak["phase [deg]"] == pytest.approx(np.degrees(np.angle(exact)), abs=1e-3)


def test_regression_ends_of_the_range_are_no_peaks():
    """Rows at the first or last frequency looked like resonances."""
    (row,) = bd.bode(oscillator(0.5), between=(0.1, 1.0)).peak_table().to_dict("records")
    assert (row["frequency [Hz]"], row["peak"]) == (1.0, False)


def test_tables_contain_magnitudes_and_phases():
    diagram = bd.bode(oscillator(), [1.0, 2.0, 5.0])
    table = diagram.table()
    s = 2j * np.pi * np.array([1.0, 2.0, 5.0])
    exact = 1.0 / (2.0 * s**2 + 0.02 * s + 200.0)
    assert list(table) == [
        "frequency [Hz]",
        "mass 0.x / push magnitude [m/N]",
        "mass 0.x / push phase [deg]",
    ]
    assert_allclose(table.iloc[:, 1], np.abs(exact), rtol=1e-9)
    assert_allclose(table.iloc[:, 2], np.degrees(np.angle(exact)), atol=1e-9)


def test_ranges_contain_their_ends_and_the_resonances_between():
    diagram = bd.bode(oscillator(count=3), between=(2.0, 2.5))
    f = diagram.frequencies
    assert_allclose(f[[0, -1]], [2.0, 2.5], rtol=1e-12)
    # The first and the third resonance are outside.
    assert np.min(np.abs(f - np.sqrt(200.0) / (2.0 * np.pi))) < 1e-6
    assert np.all(np.diff(f) > 0.0)


def test_unstable_models_have_a_warning():
    with pytest.warns(bd.BeamdaeWarning, match=r"unstable \(largest growth rate 0.25 1/s\)"):
        diagram = bd.bode(oscillator(0.0, feedback=1.0))
    assert "unstable" in diagram.warnings[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"frequencies": [0.0]}, "bode: frequencies must be positive, got 0"),
        ({"frequencies": []}, "at least one value"),
        ({"frequencies": [1.0], "between": (1.0, 2.0)}, "mutually exclusive"),
        ({"between": (2.0, 1.0)}, r"between must ascend, got \(2.0, 1.0\)"),
        ({"model": bd.Mechanism()}, "must be a result of linearize, got .*; pass linearize"),
    ],
)
def test_invalid_arguments_are_rejected(arguments, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.bode(**({"model": oscillator()} | arguments))


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_default_frequencies_end_where_natural_frequencies_are_wrong(recwarn):
    """They ended at ten times the highest mode, with a warning of errors of more than 30 %."""
    strip = rectangle(0.002, damping=1e-5)
    mech, beam = clamped_beam(strip, 4, 0.5)
    mech.add(bd.Force("push", beam.end, (0.0, 0.0)))
    mech.observe("tip", beam.end)
    model = bd.linearize(mech, inputs=["push"], outputs=["tip.y"])
    diagram = bd.bode(model)
    assert not recwarn.list
    assert not diagram.warnings
    # The errors of the fourth and the fifth frequency are 0.37 and 2.5 %.
    rates = np.sort(model.poles.imag[model.poles.imag > 0.0]) / (2.0 * np.pi)
    assert diagram.frequencies[-1] == pytest.approx(np.sqrt(rates[3] * rates[4]), rel=1e-3)
    with pytest.warns(bd.BeamdaeWarning, match="frequency 7: the error is about"):
        bd.bode(model, between=(1.0, 1000.0))


def thin_beam(damping, elements, tip=(0.06, 0.0), weight=0.0, mass=0.4):
    """Return a linear model of a beam with a thickness of 0.4 mm, clamped without weight.

    With a `weight` [m/s^2], the beam is hinged at its start. The `mass` [kg] is at its end.
    """
    mech = bd.Mechanism(gravity=(0.0, -weight))
    section = rectangle(4e-4, 0.015, damping=damping)
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), tip), section, elements=elements))
    support = bd.Revolute if weight else bd.Weld
    mech.add(support("support", mech.ground.at(0.0, 0.0), leaf.start))
    if mass:
        mech.add(bd.PointMass("mass", mass, on=leaf.end))
    mech.add(bd.Force("push", leaf.end, (0.0, 0.0)))
    mech.observe("tip", leaf.end)
    return bd.linearize(mech, "equilibrium", inputs=["push.Fy"], outputs=["tip.y"])


@pytest.mark.parametrize("damping", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("elements", [2, 8])
def test_regression_default_frequencies_begin_below_slow_resonances(damping, elements):
    """Axial vibrations of thin beams are 1e10 times as fast, and 3.84 Hz was taken for zero."""
    diagram = bd.bode(thin_beam(damping, elements))
    first = diagram.peak_table().iloc[0]
    stiffness = 3.0 * 2.1e11 * 0.015 * 4e-4**3 / 12.0 / 0.06**3
    # The closed form without shear and mass of the beam, and with E instead of the stiffer width.
    expected = np.sqrt(stiffness / 0.4) / (2.0 * np.pi)
    assert first["frequency [Hz]"] == pytest.approx(expected, rel=5e-3)
    assert diagram.frequencies[0] == pytest.approx(0.1 * expected, rel=5e-3)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("elements", [2, 8])
@pytest.mark.parametrize("damping", [0.0, 1e-5, 1e-3])
def test_regression_slow_instability_beside_fast_vibrations_is_found(elements, damping):
    """Standing beams on a hinge were stable: their growth was small beside the fastest pole."""
    standing = thin_beam(damping, elements, (0.0, 0.06), 1e-2, 0.0)
    with pytest.warns(bd.BeamdaeWarning, match="the linear model is unstable"):
        bd.bode(standing, frequencies=[1.0])


@pytest.mark.slow(reason="a quarter of a second")
def test_responses_of_rounding_errors_are_told_from_small_ones():
    """By symmetry, a vertical force does not turn the crown of an arch."""
    arch = bd.load_model("example:shallow_arch")
    diagram = bd.bode(bd.linearize(arch()), np.geomspace(1.0, 100.0, 30))
    noise = {x.name for x in diagram.transfer_functions if x.is_noise}
    assert {f"crown.{x} / press.Fy [N]" for x in ("x [m]", "angle [rad]")} <= noise
    assert "crown.y [m] / press.Fy [N]" not in noise
    # States of filters are twelve orders of magnitude smaller than others.
    damped = bd.linearize(bd.load_model("example:active_damping")())
    diagram = bd.bode(damped, np.geomspace(1.0, 100.0, 30))
    noise = {x.name for x in diagram.transfer_functions if x.is_noise}
    assert not noise & {"strain [-] / patch.M [N m]", "end.y [m] / patch.M [N m]"}
