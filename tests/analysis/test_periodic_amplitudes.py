"""Amplitudes of periodic motions and responses do not depend on their output rows."""

import re

import numpy as np
import pytest
from mechanisms import mass_on_rail
from pages import read_page
from scipy.special import ive

import beamdae as bd

WIDTH = 0.005  # duration of the pulse relative to the period; rows are as far apart
PULSE = "pulse.Fx [N]"
SIZE = 100.0  # N
RIPPLE = 0.01  # N


@bd.model(t_end=1.0)
def pulsed_mass(size=SIZE):
    """Return a mass on a spring under a short pulse per second, right after its least value."""

    def force(t):
        phase = np.sin(np.pi * (t - 0.5137)) / (np.pi * WIDTH)
        return size * np.exp(-(phase**2)) + RIPPLE * (1.0 - np.cos(2.0 * np.pi * (t - 0.5)))

    mech, mass = mass_on_rail()
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, 400.0, 4.0))
    pulse = mech.add(bd.Force("pulse", mass.point, (force, 0.0)))
    mech.observe("pulse", pulse.force)
    mech.observe("mass", mass.point)
    return mech


@pytest.fixture(scope="module")
def motion():
    with pytest.warns(bd.BeamdaeWarning, match="amplitudes include"):
        return bd.periodic(pulsed_mass(), period=1.0)


@pytest.fixture(scope="module")
def response():
    return bd.frequency_response(
        pulsed_mass, "size", (SIZE, 110.0), lambda size: 1.0, settle=5, max_points=2
    )


def test_regression_amplitudes_include_pulses_between_rows(motion):
    """Parabolas through 201 rows had a largest value of 95 N and a least one of -0.4 N."""
    row = motion.amplitudes().loc[PULSE]
    assert row["largest"] == pytest.approx(SIZE, rel=1e-5)
    assert 0.0 <= row["least"] < 1e-3
    assert row["half range"] == pytest.approx(0.5 * SIZE, rel=1e-4)
    exponent = 0.5 / (np.pi * WIDTH) ** 2
    assert row["mean"] == pytest.approx(SIZE * ive(0, exponent) + RIPPLE, rel=1e-4)
    rows = motion.solution.columns[PULSE]
    assert rows.max() < 0.95 * SIZE


def test_regression_warnings_of_periodic_motions_have_no_options_of_rows(motion):
    """Warnings recommended output_step=, which `periodic` does not have."""
    (warning,) = motion.warnings
    assert "the output rows miss its largest value" in warning
    assert "output_step" not in warning
    assert warning.endswith("but curves and the table of the rows do not.")


def test_regression_the_page_of_a_motion_agrees_with_its_amplitudes(motion, tmp_path):
    """The page had the amplitudes of the rows beside the extremes of the steps."""
    page = read_page(motion.page(tmp_path / "pulse.html"))
    assert page["notes"] == list(motion.warnings)
    (table,) = (x for x in page["tables"] if x["title"] == "Amplitudes")
    (cells,) = (x for x in table["rows"] if PULSE.partition(" ")[0] in x[0])
    assert re.search(r"\b100\b", " ".join(cells))


def test_regression_responses_include_pulses_between_rows(response):
    """Tables of responses had the values of rows, and each motion had a warning."""
    table = response.table()
    sizes = table["size"].to_numpy()
    assert table["pulse.Fx largest magnitude [N]"].to_numpy() == pytest.approx(sizes, rel=1e-5)
    assert response.curve("pulse.Fx")[1] == pytest.approx(0.5 * sizes, rel=1e-4)
    (reason,) = response.warnings
    assert "maximum of 2 points" in reason


@pytest.mark.slow(reason="half a second")
def test_amplitudes_of_angles_with_full_revolutions_end_at_the_last_row():
    mech = bd.Mechanism()
    crank = mech.add(bd.RigidBody("crank", 1.0, 0.1))
    base = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("shaft", base, crank.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", base, crank.at(0.0, 0.0), lambda t: 2.0 * np.pi * t))
    mech.observe("pin", crank.at(1.0, 0.0))
    table = bd.periodic(mech, period=1.0).amplitudes()
    angle = table.loc["pin.angle [rad]"]
    assert angle[["mean", "least", "largest"]].to_list() == pytest.approx(
        [np.pi, 0.0, 2.0 * np.pi], abs=1e-9
    )
    assert table.loc["pin.x [m]", "half range"] == pytest.approx(1.0, rel=1e-9)
