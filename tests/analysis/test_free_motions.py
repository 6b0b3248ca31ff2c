"""Free motions of thin structures, counted exactly, and natural modes along equilibrium paths."""

import numpy as np
import pytest
from mechanisms import STEEL, driven, hinged, hinged_beam, rectangle, truss
from numpy.testing import assert_allclose

import beamdae as bd

# Roots of cos(x) cosh(x) = 1: frequencies of a free beam are x^2 / (2 pi L^2) sqrt(EI / rhoA).
FREE_BEAM_ROOTS = np.array([4.730040745, 7.853204624, 10.995607838])
# Number of free motions by support.
SUPPORTS = {"free": 3, "hinged": 1, "guided": 1, "sliding hinge": 2}
FORMULATIONS = {"exact": {"formulation": "exact"}, "floating frame": {}}


def strip(support, height, damping, elements=8, material=STEEL, length=1.0, **options):
    """Return a steel strip with structural damping [s] on the given support."""
    mech = bd.Mechanism()
    section = rectangle(height, 0.02 * length, damping=damping, material=material)
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("strip", line, section, elements, **options))
    origin = mech.ground.at(0.0, 0.0)
    if support == "hinged":
        mech.add(bd.Revolute("support", origin, beam.start))
    if support == "guided":
        mech.add(bd.Prismatic("support", origin, beam.start))
    if support == "sliding hinge":
        mech.add(bd.PointOnLine("support", origin, beam.start))
    return mech


@pytest.mark.parametrize(
    ("height", "damping"),
    [
        (1e-3, 1e-5),
        *(
            pytest.param(height, damping, marks=pytest.mark.slow(reason="a second each"))
            for height in (1e-1, 5e-3, 1e-3, 2e-4)
            for damping in (0.0, 1e-5)
            if (height, damping) != (1e-3, 1e-5)
        ),
    ],
)
@pytest.mark.parametrize("support", SUPPORTS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.filterwarnings(
    "error::beamdae.errors.BeamdaeWarning",
    "ignore:(frequency|growth rate) .* the error is|errors. not checked",
)
def test_free_motions_do_not_depend_on_the_number_of_modes(formulation, support, height, damping):
    mech = strip(support, height, damping, **FORMULATIONS[formulation])
    reference = None
    for n in (1, 3, 4, 6, 8, 10, 12, None):
        modes = bd.modes(mech, n=n)
        count = SUPPORTS[support] if n is None else min(n, SUPPORTS[support])
        assert np.sum(modes.eigenvalues == 0.0) == count
        assert "unstable" not in modes.kinds
        vibrations = modes.eigenvalues[count:][:1]
        if reference is None and len(vibrations):
            reference = vibrations
        elif len(vibrations):
            # Rounding of the axial stiffness is 1e-5 of the lowest squared frequency at 0.2 mm.
            assert_allclose(vibrations.imag, reference.imag, rtol=1e-4)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_damped_free_strip_has_the_frequencies_of_theory(formulation):
    mech = strip("free", 1e-3, 1e-5, **FORMULATIONS[formulation])
    modes = bd.modes(mech, n=6)
    section = rectangle(1e-3)
    expected = FREE_BEAM_ROOTS**2 * np.sqrt(section.EI / section.rhoA)
    # The mesh of eight elements raises the third frequency by 8e-5.
    assert_allclose(np.abs(modes.eigenvalues[3:]), expected, rtol=1e-4)
    # Damping proportional to the stiffness: the decay rate is damping * frequency^2 / 2.
    assert_allclose(-modes.eigenvalues[3:].real, 0.5e-5 * expected**2, rtol=2e-4)


def hub_with_booms(height):
    """Return a free hub with two thin elastic booms."""
    mech = bd.Mechanism()
    section = rectangle(height, damping=1e-5)
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01, (0.0, 0.0)))
    for name, side in (("right", 1.0), ("left", -1.0)):
        line = bd.Line((0.1 * side, 0.0), (1.1 * side, 0.0))
        boom = mech.add(bd.Beam(name, line, section, 8, formulation="exact"))
        mech.add(bd.Weld(f"{name} root", hub.at(0.1 * side, 0.0), boom.start))
    return mech


@pytest.mark.parametrize("height", [1e-2, 1e-3, 1e-4])
def test_free_hub_with_thin_booms_has_three_free_motions_and_rests(height):
    modes = bd.modes(hub_with_booms(height), n=6)
    assert np.sum(modes.eigenvalues == 0.0) == 3
    # Rounding errors of the booms accelerate the hub, which has no stiffness of its own.
    assert modes.warnings == ()


def ring(height, damping, formulation):
    """Return a free circular ring of two halves."""
    radius, section = 0.2, rectangle(height, damping=damping)
    mech = bd.Mechanism()
    one, other = (
        mech.add(
            bd.Beam(
                name,
                bd.Arc(radius, np.pi * radius, start=(x, 0.0), angle=angle),
                section,
                # The exact ring uses sparse matrices, the other dense ones.
                12 if formulation == "exact" else 4,
                formulation=formulation,
            )
        )
        for name, x, angle in (("upper", radius, 0.5 * np.pi), ("lower", -radius, -0.5 * np.pi))
    )
    mech.add(bd.Weld("left", one.end, other.start))
    mech.add(bd.Weld("right", other.end, one.start))
    return mech


@pytest.mark.slow(reason="half a second each")
@pytest.mark.parametrize("damping", [0.0, 1e-6])
@pytest.mark.parametrize("height", [1e-2, 1e-3])
@pytest.mark.parametrize("speed", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_spinning_free_ring_is_neutral(height, damping, speed, formulation):
    # The translations of a free body are a double eigenvalue at the speed of the frame.
    modes = bd.modes(ring(height, damping, formulation), about=bd.rotation(speed), n=8)
    assert "unstable" not in modes.kinds
    assert modes.kinds.count("free motion") == 1
    translations = np.sort(np.abs(np.abs(modes.eigenvalues) - speed))[:2]
    # The square root of rounding errors splits the pair, by at most 1e-2 1/s.
    assert np.all(translations < 1e-2)


def rotor(is_clamped, formulation="exact"):
    """Return a hub on a shaft with a blade, which is not clamped if its joint is forgotten."""
    mech, hub = hinged(bd.RigidBody.disk("hub", (0.0, 0.0), 0.1, mass=5.0))
    section = rectangle(0.005, 0.03)
    line = bd.Line((0.1, 0.0), (0.6, 0.0))
    blade = mech.add(bd.Beam("blade", line, section, elements=2, formulation=formulation))
    if is_clamped:
        mech.add(bd.Weld("clamp", hub.at(0.1, 0.0), blade.start))
    return mech


@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_regression_rotations_name_bodies_without_a_joint(formulation):
    """No steady state of a rotation had no reason."""
    mech = rotor(False, formulation)
    assert set(bd.modes(mech, n=4).kinds) == {"free motion"}
    with pytest.raises(bd.BeamdaeError, match="because no joint or spring holds blade; add"):
        bd.campbell(mech, [10.0])


@pytest.mark.slow(reason="half a second")
def test_free_motions_of_held_mechanisms_and_of_free_structures_have_no_warning():
    # With warnings as errors: the rotation of a hub, and a structure that is free as a whole.
    assert bd.modes(rotor(True), n=2).warnings == ()
    assert bd.modes(strip("free", 0.005, 0.0), n=4).warnings == ()


# Natural modes along equilibrium paths: frequencies under load.

HEAVY_STEEL = bd.Material(E=2.0e11, nu=0.3, rho=7800.0)
STRIP = rectangle(0.002, 0.03, material=HEAVY_STEEL)


def stiffness(y):
    """Return the tangent stiffness [N/m] at the height y, along x and y."""
    length, free_length = np.hypot(1.0, y), np.hypot(1.0, 0.2)
    tension = 1000.0 * (1.0 - free_length / length)
    return 2.0 * np.array([1000.0 / length**2, 1000.0 * y**2 / length**2]) + 2.0 * tension * (
        np.array([y**2, 1.0]) / length**2
    )


@pytest.mark.parametrize("height", [0.15, 0.05])
def test_truss_has_the_frequencies_of_its_tangent_stiffness(height):
    path = bd.equilibrium(truss(), to={"crown.y": height})
    modes = bd.modes(truss(), about=path)
    squares = np.sort((-(modes.eigenvalues**2)).real)
    assert_allclose(squares, np.sort(stiffness(height)), rtol=1e-7)
    # The limit point is at a height of 0.115 m.
    assert ("unstable" in modes.kinds) == (height < 0.115)
    assert path.stable == (height > 0.115)
    assert modes.about.startswith("equilibrium at load factor")


@pytest.mark.slow(reason="paths of two columns")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_compressed_column_frequency_falls_linearly_with_load(formulation):
    """Hinged at both ends: w^2 = w0^2 (1 - P / Pcr) (Blevins 1979); loads act in two stages."""
    mech, beam = hinged_beam(STRIP, 4, 0.5, formulation=formulation)
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), beam.end))
    critical = (np.pi / 0.5) ** 2 * STRIP.EI
    mech.add(bd.Force("push", beam.end, (-critical, 0.0)))
    mech.add(bd.Force("pull", beam.end, (0.5 * critical, 0.0)))
    path = bd.equilibrium(mech, loads=[["pull"], ["push"]], to=[0.3, 0.9])
    first = -(bd.modes(mech, n=1, about=path.at(0)).eigenvalues[0] ** 2).real
    for row, factors in enumerate(path.factors):
        eigenvalue = bd.modes(mech, n=1, about=path.at(row)).eigenvalues[0]
        # Axial shortening and shear of a strip of slenderness 433 contribute (pi / 433)^2.
        load = factors[1] - 0.5 * factors[0]
        assert_allclose(-(eigenvalue**2).real / first, 1.0 - load, rtol=0.0, atol=2e-4)


@bd.model(t_end=1.0)
def driven_crank(angle=0.0, stiffness=200.0):
    """Return a pendulum on a driven crank, and a spring that its angle stretches."""
    mech, crank = driven(bd.RigidBody("crank", 1.0, 0.02, center=(0.1, 0.0)), angle, gravity=9.81)
    section = rectangle(0.002, 0.03, material=HEAVY_STEEL)
    line = bd.Line((0.2, 0.0), (0.2, -0.5))
    rod = mech.add(bd.Beam("rod", line, section, elements=2))
    mech.add(bd.Revolute("pin", crank.at(0.2, 0.0), rod.start))
    mech.add(bd.Spring("spring", mech.ground.at(0.5, -0.9), rod.end, stiffness, free_length=0.4))
    push = mech.input("push", unit="N")
    mech.add(bd.Force("push on rod", rod.end, (push, 0.0)))
    mech.observe("tip", rod.end)
    return mech


@pytest.mark.parametrize(("over", "value"), [("motor", 0.6), ("push", 30.0), ("stiffness", 500.0)])
def test_ends_of_paths_over_a_quantity_are_those_of_the_model_with_its_value(over, value):
    """Paths over a driver, an input or a parameter were refused as states of linear analyses."""
    path = bd.equilibrium(driven_crank, over=over, to=value)
    if over == "motor":
        fixed = driven_crank(angle=value)
    elif over == "push":
        fixed = driven_crank().with_inputs({"push": value})
    else:
        fixed = driven_crank(stiffness=value)
    given = driven_crank if over == "stiffness" else driven_crank()
    modes, expected = bd.modes(given, path, n=3), bd.modes(fixed, "equilibrium", n=3)
    assert_allclose(modes.eigenvalues, expected.eigenvalues, rtol=1e-7)
    assert abs(modes.frequencies[0] / bd.modes(given, path.at(0), n=1).frequencies[0] - 1.0) > 1e-3
    assert_allclose(modes.errors.total, expected.errors.total, rtol=1e-3, atol=1e-9)
    names = {"inputs": ["push"], "outputs": ["tip.x"]}
    linear, other = bd.linearize(given, path, **names), bd.linearize(fixed, "equilibrium", **names)
    one, another = (x.frequency_response([0.3, 2.0]) for x in (linear, other))
    assert_allclose(one, another, rtol=1e-6)
    assert over in modes.about


def test_path_of_another_model_is_rejected():
    path = bd.equilibrium(truss(), to=0.5)
    other = bd.Mechanism()
    other.add(bd.PointMass("bob", 1.0, at=(0.0, 0.2)))
    with pytest.raises(bd.BeamdaeError, match="crown"):
        bd.modes(other, about=path)


def test_regression_analyses_of_the_end_of_a_failed_path_warn():
    # Load control stops at the limit point, at a load factor of 3.02.
    failed = bd.equilibrium(truss(), to=4.0)
    assert failed.status.kind == "failed"
    for result in (bd.modes(truss(), failed), bd.linearize(truss(), failed)):
        (warning,) = result.warnings
        assert warning.startswith("the equilibrium path ended before its target")
        assert f"load factor {failed.factor:.6g}" in warning
    # Every row is an equilibrium, and a chosen row is meant.
    row = failed.at(len(failed.q) - 2)
    assert row.status.success
    assert bd.modes(truss(), row).warnings == ()
    limited = bd.equilibrium(truss(), to=1.0, max_points=2)
    assert "max_points" in bd.modes(truss(), limited).warnings[0]
    with pytest.warns(bd.BeamdaeWarning, match="the earlier run ended early"):
        bd.simulate(truss(), bd.Radau(), 0.01, start=failed)


def test_regression_modes_about_the_end_of_a_failed_run_warn():
    mech = truss()
    tear = bd.Force("tear", mech.parts["crown"].point, (0.0, lambda t: (0.05 - t) ** 0.5))
    mech.add(tear)  # not a number after 0.05 s
    run = bd.simulate(mech, bd.Radau(), 0.1)
    assert run.status.kind == "failed"
    end = run.trajectory.end
    assert "failed run" in bd.modes(mech, run.at(end)).warnings[0]
    assert "failed run" not in " ".join(bd.modes(mech, run.at(0.5 * end)).warnings)
