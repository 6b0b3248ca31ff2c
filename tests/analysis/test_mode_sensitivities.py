"""Derivatives of natural modes: closed forms, scaling laws, differences, repeated eigenvalues."""

import numpy as np
import pytest
from differentiable_models import assert_close, differentiate
from four_bar import four_bar
from mechanisms import clamped_beam, free_ball, hinged, mass_on_rail, rectangle
from numpy.testing import assert_allclose
from ring_mount import ring_mount
from shallow_arch import shallow_arch

import beamdae as bd

G = 9.81
SLOW = pytest.mark.slow(reason="half a second and more")


@bd.model(t_end=1.0)
def oscillator(mass=2.0, stiffness=50.0, damping=3.0):
    return mass_on_rail(mass, 1.0, "bob", spring=(stiffness, damping))[0]


@pytest.mark.parametrize(
    "damping", [3.0, pytest.param(0.0, marks=SLOW), pytest.param(40.0, marks=SLOW)]
)
def test_damped_oscillator_has_a_closed_form(damping):
    values = {"mass": 2.0, "stiffness": 50.0, "damping": damping}
    result = bd.mode_sensitivities(oscillator, list(values), parameters=values)

    def exact(mass, stiffness, damping):
        rate = 0.5 * damping / mass
        root = np.sqrt(rate**2 - stiffness / mass + 0j)
        return np.array([-rate + root, -rate - root])

    def rates(name):
        h = 1e-6 * max(values[name], 1.0)
        change = exact(**{**values, name: values[name] + h})
        return (change - exact(**{**values, name: values[name] - h})) / (2.0 * h)

    for name in values:
        order = [
            int(np.argmin(np.abs(exact(**values) - value))) for value in result.modes.eigenvalues
        ]
        # Central differences of the closed form.
        assert_allclose(result.eigenvalues[name], rates(name)[order], rtol=1e-8)
    if damping == 3.0:
        # -damping / (2 sqrt(k m)) of the ratio.
        ratio = result.sensitivity("damping ratio", "damping")[1]
        assert ratio == pytest.approx(0.5 / np.sqrt(100.0), rel=1e-9)
        assert result.sensitivity("growth rate [1/s]", "mass")[1] == pytest.approx(3.0 / 8.0)


@bd.model(t_end=1.0)
def swing(length=0.5, mass=2.0, stiffness=300.0):
    """Mass on a spring under its weight; it swings at the length of the stretched spring."""
    return free_ball((0.0, -length), mass, "bob", G, spring=(stiffness,))[0]


@pytest.mark.parametrize("about", ["equilibrium", pytest.param("path", marks=SLOW)])
def test_spring_pendulum_about_its_equilibrium_has_a_closed_form(about):
    state = bd.equilibrium(swing()) if about == "path" else about
    result = bd.mode_sensitivities(swing, ["length", "mass", "stiffness"], about=state)
    # w^2 = g / (length + m g / k), and k / m.
    stretched = 0.5 + 2.0 * G / 300.0
    low, high = 2.0 * np.pi * result.modes.frequencies
    assert_allclose([low**2, high**2], [G / stretched, 150.0], rtol=1e-9)
    expected = {
        "length": (-0.5 * low / stretched, 0.0),
        "mass": (-0.5 * low / stretched * G / 300.0, -0.5 * high / 2.0),
        "stiffness": (0.5 * low / stretched * 2.0 * G / 300.0**2, 0.5 * high / 300.0),
    }
    for name, values in expected.items():
        actual = 2.0 * np.pi * result.sensitivity("frequency", name)
        assert_allclose(actual, values, rtol=1e-9, atol=1e-12)


@bd.model(t_end=1.0)
def cantilever(
    E=2e11,
    length=1.0,
    height=0.02,
    width=0.03,
    tip_mass=0.5,
    rho=7800.0,
    damping=1e-5,
    curvature=0.5,
    formulation="exact",
):
    material = bd.Material(E=E, nu=0.3, rho=rho)
    section = rectangle(height, width, damping=damping, material=material)
    mech, beam = clamped_beam(section, 2, bd.Arc(1.0 / curvature, length), formulation=formulation)
    tip = mech.add(bd.PointMass("tip", tip_mass, at=beam.end.point))
    mech.add(bd.Revolute("pin", beam.end, tip.point))
    return mech


@pytest.mark.slow(reason="derivatives of the matrices of beams")
# Rounding errors of the axial stiffness are relative to the bending stiffness.
@pytest.mark.parametrize(("height", "tolerance"), [(0.02, 1e-9), (2e-4, 1e-6)])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_frequencies_of_a_cantilever_obey_its_scaling(formulation, height, tolerance):
    names = ["E", "rho", "tip_mass", "length", "height", "width", "curvature"]
    values = {"formulation": formulation, "height": height, "tip_mass": 25.0 * height}
    result = bd.mode_sensitivities(cantilever, names, n=4, damping=False, parameters=values)
    f = result.modes.frequencies
    share = {
        name: result.sensitivity("frequency", name).to_numpy() * value / f
        for name, value in result.parameters.items()
    }
    # f is proportional to sqrt(E / rho) / L if all lengths scale, and the mass with rho L^3.
    assert_allclose(share["E"], 0.5, rtol=tolerance)
    assert_allclose(share["rho"] + share["tip_mass"], -0.5, rtol=1e-9)
    lengths = share["length"] + share["height"] + share["width"] - share["curvature"]
    assert_allclose(lengths + 3.0 * share["tip_mass"], -1.0, rtol=tolerance)


@bd.model(t_end=1.0)
def pid_stage(kp=30.0, ki=20.0, kd=8.0, mass=2.0, spring=40.0):
    """Mass on a spring under a PID controller, whose integral is a state."""
    mech, stage = mass_on_rail(mass, 1.0, "stage", spring=(spring,))
    x, v = mech.sensor("x", stage.point, "x"), mech.sensor("v", stage.point, "x_dot")
    integral = mech.state("integral", 1.1 - x, unit="m s")
    mech.add(bd.Force("act", stage.point, (kp * (1.1 - x) + ki * integral - kd * v, 0.0)))
    return mech


EXACT, FLOATING = {"formulation": "exact"}, {"formulation": "floating frame"}
CANTILEVER = [name for name, value in cantilever.parameters.items() if isinstance(value, float)]
# Model, parameters, values of others, state.
MODES = {
    "damped cantilever": (cantilever, CANTILEVER, EXACT, "reference"),
    "damped cantilever floating": (cantilever, CANTILEVER, FLOATING, "reference"),
    "rotating blade": (cantilever, CANTILEVER, EXACT, bd.rotation(300.0)),
    "rotating blade floating": (cantilever, CANTILEVER, FLOATING, bd.rotation(300.0)),
    "controlled stage": (pid_stage, list(pid_stage.parameters), {}, "equilibrium"),
    "ring_mount": (ring_mount, ["radius"], EXACT, "equilibrium"),
    "four_bar": (four_bar, ["rise"], EXACT, "equilibrium"),
    # Operators of joints depend on the rise.
    "four_bar floating": (four_bar, ["rise", "height"], FLOATING, "equilibrium"),
    "shallow_arch": (shallow_arch, ["rise"], EXACT, "equilibrium"),
    "shallow_arch floating": (shallow_arch, ["load"], FLOATING, "equilibrium"),
}


@pytest.mark.slow(reason="modes of a model at five values of each parameter")
@pytest.mark.parametrize("case", MODES)
def test_eigenvalues_and_shapes_agree_with_differences_of_modes(case):
    model, names, values, about = MODES[case]
    result = bd.mode_sensitivities(model, names, about, n=4, parameters=values)
    shapes = result.modes.shapes

    def aligned(mechanism):
        modes = bd.modes(mechanism, about, n=4)
        signs = np.sign(np.real(np.einsum("ij,ij->i", shapes.conj(), modes.shapes)))
        return np.hstack([modes.eigenvalues[:, None], signs[:, None] * modes.shapes])

    for name in names:
        expected = differentiate(aligned, model, name, values, 3e-4)
        value = result.parameters[name]
        # Rounding errors of the eigenvalues limit the accuracy of the differences.
        assert_close(
            result.eigenvalues[name], expected[:, 0], value, result.modes.eigenvalues, 1e-6
        )
        sizes = np.maximum(np.abs(shapes), value * np.abs(expected[:, 1:])).max(axis=1)
        error = np.abs(result.shapes[name] - expected[:, 1:]).max(axis=1)
        assert np.all(error <= 1e-6 * sizes / value), name


@bd.model(t_end=1.0)
def twins(one=40.0, other=40.0):
    """Two masses on springs, which do not interact."""
    mech = bd.Mechanism()
    for name, stiffness, y in (("one", one, 0.0), ("other", other, 1.0)):
        hook = mech.ground.at(0.0, y)
        bob = mech.add(bd.PointMass(name, 1.0, at=(1.0, y)))
        mech.add(bd.PointOnLine(f"line {name}", hook, bob.point))
        mech.add(bd.Spring(f"spring {name}", hook, bob.point, stiffness))
    return mech


@bd.model(t_end=1.0)
def ring(height=0.01):
    """Free ring, whose bending modes are in pairs."""
    mech = bd.Mechanism()
    section = rectangle(height)
    curve = bd.Arc(0.5, 0.5 * np.pi)
    half = mech.add(bd.Beam("half", curve, section, 4, formulation="exact"))
    other = bd.Arc(0.5, 0.5 * np.pi, start=half.end.point, angle=np.pi)
    rest = mech.add(bd.Beam("rest", other, section, 4, formulation="exact"))
    mech.add(bd.Weld("first", half.end, rest.start))
    mech.add(bd.Weld("last", rest.end, half.start))
    return mech


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_repeated_eigenvalues_have_no_derivatives():
    with pytest.warns(bd.BeamdaeWarning, match=r"modes 1, 2 of twins are repeated.*damping=False"):
        result = bd.mode_sensitivities(twins, "one")
    assert result.sensitivity("frequency", "one").loc[[1, 2]].isna().all()
    # Also if the mode of the same frequency is not requested.
    for n, names in ((5, "modes 4, 5"), (4, "modes 4")):
        with pytest.warns(bd.BeamdaeWarning, match=rf"{names} of ring are repeated.*n="):
            result = bd.mode_sensitivities(ring, "height", n=n)
        assert result.sensitivity("frequency", "height").isna().all()
    free = bd.mode_sensitivities(ring, "height", n=3)
    assert free.sensitivity("frequency", "height").isna().all()


@pytest.mark.parametrize("gap", [1e-5, -1e-5])
def test_modes_next_to_a_crossing_keep_their_derivatives(gap):
    # The order of the modes changes at the crossing, and with it the order of the derivatives.
    values = {"one": 40.0 * (1.0 + gap)}
    result = bd.mode_sensitivities(twins, ["one", "other"], parameters=values)
    rate = 0.25 / np.pi / np.sqrt(40.0)
    one = result.sensitivity("frequency", "one").to_numpy()
    assert_allclose(one, [0.0, rate] if gap > 0.0 else [rate, 0.0], rtol=1e-4, atol=1e-12)
    total = one + result.sensitivity("frequency", "other").to_numpy()
    assert_allclose(total, rate, rtol=1e-4)


@bd.model(t_end=1.0)
def tilted(angle=0.2):
    """Rigid pendulum that is drawn out of its equilibrium."""
    mech, _ = hinged(
        bd.RigidBody.rod("rod", (0.0, 0.0), (np.sin(angle), -np.cos(angle)), 1.0), gravity=G
    )
    return mech


@pytest.mark.parametrize(
    ("model", "by", "settings", "message"),
    [
        (tilted, "angle", {}, "the state of tilted is not an equilibrium"),
        (
            tilted,
            "angle",
            {"parameters": {"angle": 0.0}},
            "angle of tilted moves the state out of equilibrium",
        ),
        (oscillator, "mas", {}, "no parameter 'mas'"),
        (oscillator, "mass", {"about": "equil"}, "'reference', 'equilibrium'.*mean 'equilibrium'"),
    ],
)
def test_refusals(model, by, settings, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.mode_sensitivities(model, by, **settings)


def test_positions_by_name():
    drawn = bd.mode_sensitivities(oscillator, "mass")
    placed = bd.mode_sensitivities(oscillator, "mass", about={"bob.x": 1.0})
    assert placed.modes.about == "rest at bob.x = 1"
    assert_allclose(placed.eigenvalues["mass"], drawn.eigenvalues["mass"], rtol=1e-12)


def test_table_is_written_as_csv(tmp_path):
    result = bd.mode_sensitivities(oscillator, "mass")
    header, row = result.to_csv(tmp_path / "modes.csv").read_text().splitlines()
    assert header.startswith("mode,frequency [Hz],damping ratio [-],growth rate [1/s],d(frequency)")
    assert "d(damping ratio)/d(mass) [- per unit of mass]" in header
    assert row.startswith("1,")
    with pytest.raises(bd.BeamdaeError, match="must be one of 'mass', got 'damping'"):
        result.sensitivity("frequency", "damping")
    with pytest.raises(bd.BeamdaeError, match="no column 'wavelength'"):
        result.sensitivity("wavelength", "mass")


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("damping", [0.0, 2e-5])
def test_regression_drivers_that_start_with_a_velocity_leave_the_reference_at_rest(damping):
    """The damping forces of their velocity seemed to move the state out of equilibrium."""

    @bd.model(t_end=0.1)
    def leaf(length=0.08):
        section = rectangle(0.0005, 0.015, damping=damping)
        mech, beam = clamped_beam(section, 3, length, name="leaf")
        anchor = mech.ground.at(length, 0.0)
        law = bd.sine(0.004, 5.0)
        mech.add(bd.TranslationalDriver("move", anchor, beam.end, law, (0.0, 1.0)))
        return mech

    result = bd.mode_sensitivities(leaf, "length", n=1)
    frequency = result.modes.frequencies[0]
    # f = sqrt(1 - z^2) w / 2 pi, with z proportional to w, which is proportional to 1 / length^2.
    ratio = result.modes.damping_ratios[0] ** 2
    expected = -2.0 * (1.0 - 2.0 * ratio) / (1.0 - ratio)
    slope = result.sensitivity("frequency", "length")[1] * 0.08 / frequency
    # Shear changes the exponent by 3e-4.
    assert slope == pytest.approx(expected, abs=1e-3)
