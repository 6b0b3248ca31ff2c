"""Mesh errors of equilibria and modes against closed forms and finer meshes."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import beamdae as bd
from beamdae.certification import analyses
from beamdae.symbolic.statements import Quantity, Variable

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
STRIP = bd.Section.rectangle(STEEL, width=0.02, height=0.004)


def cantilever(load=1.0, elements=2, section=STRIP, **settings):
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=elements, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("load", beam.at(0.7), (0.0, -load)))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.slow(reason="a path on 40 elements")
def test_the_mesh_error_of_a_bent_cantilever_is_covered():
    result = bd.certify_equilibrium(cantilever(60.0), accuracy=1e-3)
    assert result.status.success
    assert result.meshes >= 3
    # No element of the reference is longer than 1/40 of the beam.
    fine = bd.equilibrium(cantilever(60.0, elements=40, formulation="exact"))
    for column in result.columns:
        row = result.budget.loc[column]
        assert abs(fine.columns[column][-1] - row["value"]) <= row["mesh"] * row["scale"]


@pytest.mark.slow(reason="four paths")
def test_the_theory_error_of_linear_strains_in_a_frame_is_stated():
    written = cantilever(60.0, frame="tangent", strain="linear")
    stated = bd.certify_equilibrium(written, accuracy=1e-3).budget["theory as written"]
    # The tip deflects by a third of the length; linear strains do not shorten the beam.
    assert stated["tip.x [m]"] > 0.5


@pytest.mark.slow(reason="two certificates of a curved beam")
def test_regression_small_deflections_beside_large_forces_are_not_at_rest():
    """Columns below 1e-9 of the largest value in any unit counted as columns at rest."""
    mech = bd.Mechanism()
    stub = mech.add(bd.Beam("stub", bd.Arc(0.1, 0.1), STRIP, elements=2))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(*stub.start.point), stub.start))
    mech.add(bd.Force("load", stub.end, (0.0, -1e-4)))
    mech.observe("tip", stub.end)
    alone = bd.certify_equilibrium(mech)
    # A preload of two ends against each other does not bend the stub.
    post = mech.add(bd.RigidBody("post", 1.0, 0.1, (1.0, 0.0)))
    weld = mech.add(bd.Weld("post foot", mech.ground.at(1.0, 0.0), post.at(1.0, 0.0)))
    mech.add(bd.Force("preload", post.at(1.0, 0.0), (1e6, 0.0)))
    mech.observe("clamp", clamp.reaction)
    mech.observe("post foot", weld.reaction)
    beside = bd.certify_equilibrium(mech)
    # The rounding of y is 8e-9 of its deflection.
    assert alone.budget.loc["tip.angle [rad]", "mesh"] > 3e-8
    assert beside.budget.loc["tip.angle [rad]", "mesh"] == pytest.approx(
        alone.budget.loc["tip.angle [rad]", "mesh"], rel=0.1
    )


def timoshenko_frequency(section, estimate):
    """Return the natural frequency [Hz] of a cantilever of 1 m within 2 % of an estimate."""

    def free_end(frequency):
        # d/ds of the deflection, the rotation, the moment and the shear force.
        square = (2.0 * np.pi * frequency) ** 2
        rates = np.zeros((4, 4))
        rates[0, 1], rates[0, 3], rates[1, 2] = 1.0, 1.0 / section.GA, 1.0 / section.EI
        rates[2, 1], rates[2, 3], rates[3, 0] = -section.rhoI * square, -1.0, -section.rhoA * square
        return np.linalg.det(expm(rates)[2:, 2:])

    return brentq(free_end, 0.98 * estimate, 1.02 * estimate, xtol=1e-13 * estimate)


@pytest.mark.slow(reason="modes on three meshes")
def test_frequencies_are_covered():
    result = bd.certify_modes(cantilever(), accuracy=1e-3, n=4)
    assert result.status.success
    # Frequencies of finer meshes have larger rounding errors than those of the certificate.
    exact = [timoshenko_frequency(STRIP, value) for value in result.values]
    assert np.all(np.abs(result.values / exact - 1.0) <= result.mesh)
    # Bernoulli: 1.8751^2 sqrt(EI / rhoA) / (2 pi L^2)
    first = 1.87510407**2 * np.sqrt(STRIP.EI / (7850.0 * STRIP.area)) / (2.0 * np.pi)
    assert result.values[0] == pytest.approx(first, rel=1e-3)
    assert "mode 1 [Hz]" in result._repr_html_()


@pytest.mark.slow(reason="modes on several meshes")
@pytest.mark.parametrize("height", [1e-4, 1e-5])
def test_regression_rounding_errors_of_thin_beams_are_covered(height):
    """The stated error was 1e-8 where the stiffness EA left errors of 1e-6 and 1e-4."""
    section = bd.Section.rectangle(STEEL, width=0.02, height=height)
    mech = cantilever(section=section, load=0.0)
    result = bd.certify_modes(mech, accuracy=0.01, n=4)
    assert result.status.success
    exact = [timoshenko_frequency(section, value) for value in result.values]
    errors = np.abs(result.values / exact - 1.0)
    assert np.all(errors <= result.mesh)
    # Rounding is largest for the lowest frequency, and the stated error is not arbitrary.
    assert 1e-6 < result.mesh[0] < 5e-3
    assert not bd.certify_modes(mech, accuracy=1e-7, n=1).status.success


@pytest.mark.slow(reason="five periodic motions")
def test_amplitudes_of_a_periodic_motion_are_covered():
    def driven(**settings):
        mech = bd.Mechanism()
        strip = bd.Section.rectangle(STEEL, width=0.02, height=0.004, damping=1e-3)
        line = bd.Line((0.0, 0.0), (1.0, 0.0))
        beam = mech.add(bd.Beam("beam", line, strip, **{"elements": 2} | settings))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Force("load", beam.at(0.7), (0.0, bd.sine(2.0, frequency=8.0))))
        mech.observe("tip", beam.end)
        return mech

    result = bd.certify_periodic(driven(), 0.125, accuracy=1e-3, columns=["tip.y", "tip.angle"])
    assert result.status.success
    fine = bd.periodic(driven(elements=16, formulation="exact"), 0.125).amplitudes()["half range"]
    for column in ("tip.y [m]", "tip.angle [rad]"):
        row = result.budget.loc[column]
        assert abs(fine[column] - row["value"]) <= row["mesh"] * row["scale"]


@pytest.mark.slow(reason="modes of 32 elements")
def test_regression_formulations_that_fail_are_not_assessed():
    # Lee's frame: the path of beams in a floating frame with the strain of the paper has a limit
    # point below this load, that of geometrically exact beams has none.
    section = bd.Section.rectangle(bd.Material(E=7.2e6, nu=0.3, rho=1.0), width=3.0, height=2.0)
    mech, corner, right = bd.Mechanism(), (0.0, 120.0), (120.0, 120.0)
    column = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), corner), section, 4))
    beam = mech.add(bd.Beam("beam", bd.Line(corner, right), section, 5))
    mech.add(bd.Weld("corner", column.end, beam.start))
    mech.add(bd.Revolute("foot", mech.ground.at(0.0, 0.0), column.start))
    mech.add(bd.Revolute("right", mech.ground.at(*right), beam.end))
    mech.add(bd.Force("press", beam.at(24.0), (0.0, -1000.0)))
    mech.observe("ld", beam.at(24.0))
    with pytest.warns(bd.BeamdaeWarning, match="may be an error of the strains of column"):
        certificate = bd.certify_equilibrium(mech, to=15.0)
    assert certificate.status.success
    assert np.all(np.isnan(certificate.theory_as_written))
    (note,) = certificate.notes
    assert note.startswith("The formulations of the model fail and are not assessed: Newton's")


@pytest.mark.slow(reason="half a second and more")
def test_an_accuracy_beyond_the_meshes_is_refused():
    result = bd.certify_modes(cantilever(), accuracy=1e-12, n=4)
    assert not result.status.success
    assert result.status.sentence == "the estimated error exceeds 1e-12 with up to 32 elements"
    assert repr(result).startswith("<AnalysisCertificate of 1e-12: limited")


def test_an_accuracy_below_the_smallest_stated_error_is_refused_with_this_reason():
    """The reason was that up to 32 elements do not suffice, also without beams."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.PointMass("bob", 1.0, at=(0.0, -1.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), bob.point, 1000.0))
    mech.observe("bob", bob.point)
    result = bd.certify_equilibrium(mech, accuracy=1e-12)
    assert not result.status.success
    assert result.status.sentence == (
        "the estimated error is 1e-08, the smallest that is stated, and exceeds 1e-12"
    )
    assert bd.certify_equilibrium(mech, accuracy=1e-8).status.success


def loaded_at(count, slider=False):
    """Return a cantilever that the loads divide into `count` elements at least."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), STRIP, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    for k in range(1, count):
        mech.add(bd.Force(f"load {k}", beam.at(k / count), (0.0, -5.0 / count)))
    if slider:
        bead = mech.add(bd.PointMass("bead", 0.1, at=(0.5, 0.0)))
        mech.add(bd.SpringDamper("spring", mech.ground.at(0.4, 0.0), bead.point, 100.0))
        mech.add(bd.SlidingOnBeam("slider", bead.point, beam))
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("certify", [bd.certify_equilibrium, bd.certify_modes])
@pytest.mark.parametrize("count", [9, 12, 20])
def test_regression_beams_of_many_elements_have_finite_errors(certify, count, monkeypatch):
    """Only one or two meshes had at most 32 elements, too few for an estimate."""
    # The load at 0.7 of the length is at an element end of 20 equal elements.
    mechanism = cantilever(elements=count) if count == 20 else loaded_at(count)
    if count == 20:  # otherwise, only strongly curved beams begin with so many elements
        monkeypatch.setattr(analyses, "_FIRST_ELEMENTS", count)
    result = certify(mechanism)
    assert result.meshes == 3
    assert result.elements["beam"] == 4 * count
    assert np.isfinite(result.mesh).all()
    assert result.status.success


@pytest.mark.slow(reason="kernels of a slider on 24 elements")
def test_regression_sliders_on_beams_of_many_elements_have_finite_errors():
    """A third mesh would have more elements than a slider permits."""
    result = bd.certify_modes(loaded_at(12, slider=True), n=2)
    assert result.elements == {"beam": 24}
    assert np.isfinite(result.mesh).all()


def test_beams_with_custom_quantities_are_not_assessed():
    mech = cantilever()
    beam = mech.part("beam")
    mech.observe(
        "custom", Quantity((Variable("x", "m"),), (beam.end.piece,), lambda local: local.q[0])
    )
    result = bd.certify_equilibrium(mech)
    assert result.status.kind == "failed"
    assert result.budget["mesh"].isna().all()
    assert result.notes[0].startswith("beam: mesh and theory are not assessed")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: bd.certify_modes(3), "expected a model or a mechanism, got 3"),
        (lambda: bd.certify_modes(cantilever(), accuracy=-1.0), "accuracy must be positive"),
        (lambda: bd.certify_equilibrium(cantilever(), columns="tap"), "no observed column 'tap'"),
        (lambda: bd.certify_equilibrium(cantilever(), columns=3), "columns must be a list"),
        (lambda: bd.certify_periodic(cantilever(), 1.0, columns=[]), "at least one name, got"),
        (lambda: bd.certify_modes(cantilever(), accuracy=1), "must be at most 0.1, got 1; 0.01 is"),
    ],
)
def test_invalid_arguments_are_rejected(call, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        call()


@pytest.mark.slow(reason="half a second")
def test_modes_that_coarse_meshes_do_not_have_are_not_certified():
    beam = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), STRIP, elements=1)
    mech = bd.Mechanism()
    mech.add(beam)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    result = bd.certify_modes(mech, n=1000)
    assert result.status.kind == "limited"
    assert "with up to 32 elements" in result.status.sentence
    # 32 elements have about twice the modes of 16, and four times those of 8.
    assessed = np.isfinite(result.mesh)
    assert np.flatnonzero(assessed).tolist() == list(range(assessed.sum()))
    assert 0.2 < assessed.mean() < 0.3


def test_an_interrupted_periodic_run_raises(monkeypatch):
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
    mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), mass.point, 100.0, 1.0))
    mech.observe("mass", mass.point)
    integrate = bd.Radau.integrate

    def interrupted(self, equations, times, progress=None):
        def stop(t):
            raise KeyboardInterrupt

        return integrate(self, equations, times, stop)

    monkeypatch.setattr(bd.Radau, "integrate", interrupted)
    with pytest.raises(bd.Interrupted):
        bd.certify_periodic(mech, 0.5)


@pytest.mark.filterwarnings("error::beamdae.errors.BeamdaeWarning")
def test_regression_certified_modes_have_no_warning_of_coarse_meshes():
    """Elements of the first mesh were "too long for mode 3"."""
    strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    certificate = bd.certify_modes(mech, accuracy=0.01, n=4)
    assert certificate.status.success
    assert not certificate.result.warnings
