"""Natural modes along equilibrium paths: frequencies under load."""

import numpy as np
import pytest
from mechanisms import driven, hinged_beam, rectangle, truss
from numpy.testing import assert_allclose

import beamdae as bd

STEEL = bd.Material(E=2.0e11, nu=0.3, rho=7800.0)
STRIP = rectangle(0.002, 0.03, material=STEEL)


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
    section = rectangle(0.002, 0.03, material=STEEL)
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
