"""Natural frequencies against published values and Rayleigh-Ritz solutions."""

import numpy as np
import pandas as pd
import pytest
from benchmarks import mode_closed_forms as closed_forms
from benchmarks.modes import (
    EISENBERGER,
    FORMULATIONS,
    MODE_CASES,
    WRIGHT,
    arch_section,
    ring,
    rotating_arm,
    square_rubber,
    supported_beam,
)
from benchmarks.run import SUMMARY
from benchmarks.step_response import STEP_RESPONSES
from numpy.testing import assert_allclose

import beamdae as bd

STORED = pd.read_csv(SUMMARY)


def ritz(speed):
    """Return flapping frequencies of a thin rotating cantilever, by the Rayleigh-Ritz method.

    Spin softening lowers w^2 in the plane of rotation only, by the square of the speed.
    """
    return np.hypot(closed_forms.rotating_cantilever(speed, 0.0, 3), speed)


def case_parameter(case, formulation):
    quick = formulation == "elements" and case.name in ("free ring, thin", "supported beam")
    marks = [] if quick else [pytest.mark.slow(reason="one of each is enough")]
    return pytest.param(case, formulation, id=f"{case.name}, {formulation}", marks=marks)


@pytest.mark.parametrize(
    ("case", "formulation"),
    [
        case_parameter(case, x)
        for case in MODE_CASES
        for x in FORMULATIONS
        if not case.name.startswith(("rotating arm", "Campbell"))
    ],
)
def test_published_frequencies_are_reproduced(case, formulation):
    rows = list(case.rows_by(formulation))
    stored_rows = STORED[(STORED["case"] == case.name) & (STORED["setting"] == rows[0]["setting"])]
    for row, line in zip(rows, stored_rows.to_dict("records"), strict=True):
        # LAPACK evaluates closed forms; their eigenvalues differ by a factor of 1e5.
        assert_allclose(float(row["published"]), float(line["published"]), rtol=1e-10)
        assert float(row["relative"]) <= case.tolerance
        # Allows for rounding errors of slender structures.
        assert_allclose(float(row["ours"]), float(line["ours"]), rtol=1e-7)


@pytest.mark.slow(reason="several rotations")
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(
    "case", [case for case in MODE_CASES if "Campbell" in case.name], ids=lambda case: case.name
)
def test_campbell_diagrams_are_reproduced(case, formulation):
    # Rounding errors of slender beams change the last digits, unlike those of the stored rows.
    for row in case.rows_by(formulation):
        assert float(row["relative"]) <= case.tolerance


@pytest.mark.parametrize("speed", [0.0, 1.0, 5.0])
def test_waves_of_one_period_are_translations_of_a_spinning_ring(speed):
    """Bryan's formula for n = 1: seen from the ring, a resting ring circles at its speed."""
    waves = closed_forms.spinning_thin_ring(arch_section(), 1.0, 1, speed)
    assert_allclose(waves, speed)


def test_every_published_mode_is_in_the_table():
    rows = STORED[STORED["setting"].str.startswith("modes")]
    assert set(rows["case"]) == {case.name for case in MODE_CASES}
    for case in MODE_CASES:
        case_rows = rows[rows["case"] == case.name]
        assert len(case_rows) == len(FORMULATIONS) * len(case.reference)
        assert (case_rows["relative"] <= case.tolerance).all()


def test_published_arch_frequencies_solve_its_equations():
    section, length = arch_section(), 0.5 * np.pi
    unit = length**2 * np.sqrt(section.rhoA / section.EI)
    exact = unit * closed_forms.hinged_arch(section, 1.0, length, np.array(EISENBERGER) / unit)
    assert_allclose(exact, EISENBERGER, rtol=0.0, atol=5.1e-4)


@pytest.mark.parametrize("speed", WRIGHT)
def test_published_frequencies_of_rotating_arms_match_ritz(speed):
    assert_allclose(ritz(speed), WRIGHT[speed], rtol=2e-5)


@pytest.mark.parametrize(
    ("speed", "formulation"),
    [
        (2.0, "floating frame"),
        pytest.param(12.0, "floating frame", marks=pytest.mark.slow(reason="one speed is enough")),
        (12.0, "exact"),
    ],
)
def test_thin_rotating_arm_matches_ritz(speed, formulation):
    """In the plane of rotation, spin softening lowers w^2 by the square of the speed."""
    values = bd.modes(rotating_arm(1e3, 8, formulation), about=bd.rotation(speed), n=3).eigenvalues
    # Allows for shear, rotary inertia and axial strain, 1e-6 (k pi)^2, and the mesh error.
    assert_allclose(np.sqrt(values.imag**2 + speed**2), ritz(speed), rtol=2.5e-4)
    assert_allclose(values.real, 0.0, atol=1e-9)


@pytest.mark.slow(reason="rings of two heights")
def test_ring_converges_to_the_thin_ring():
    """The effects of shear, rotary inertia and axial strain grow with the height squared."""
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    deviations = []
    for height in (0.02, 0.01):
        section = bd.Section.rectangle(steel, width=0.02, height=height)
        frequency = bd.modes(ring(section, 1.0, 16), n=5).eigenvalues[3].imag
        deviations.append(1.0 - frequency / closed_forms.thin_ring(section, 1.0, 2))
    # The mesh error is 4e-6 of the frequency.
    assert_allclose(deviations[0] / deviations[1], 4.0, rtol=0.2)


@pytest.mark.slow(reason="two runs of a rotating beam")
def test_small_step_response_of_a_rotating_arm_matches_the_nonlinear_run():
    (step,) = STEP_RESPONSES
    stored_rows = STORED[STORED["case"] == step.name].to_dict("records")
    for row, line in zip(step.rows(), stored_rows, strict=True):
        assert row["setting"] == line["setting"]
        assert float(row["relative"]) <= 1e-3
        for column in ("published", "ours"):
            assert_allclose(float(row[column]), float(line[column]), rtol=1e-6)


@pytest.mark.slow(reason="512 elements")
@pytest.mark.parametrize("formulation", FORMULATIONS.values())
def test_twenty_modes_of_a_fine_mesh_match_the_closed_form(formulation):
    """512 elements with the sparse solver; rounding of their stiffness leaves ten digits."""
    many = bd.modes(supported_beam(512, formulation), n=20).eigenvalues.imag
    expected = closed_forms.supported_beam(square_rubber(), 2.0, 20)
    assert_allclose(many, expected, rtol=1e-8)
