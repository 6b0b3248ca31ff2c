"""Warnings about section forces that are wrong between the steps of a run."""

import numpy as np
import pytest

import beamdae as bd

# A filter that matches no message, so that runs are checked although all warnings are ignored.
pytestmark = pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")


def pressed_blade(elements, duration=0.1):
    """A blade of steel that leans on a plate, while its holder is lowered slowly."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.15, 4e-4, damping=1e-4)
    top, up = (0.04, 0.04 * np.sqrt(3.0)), (0.0, 1.0)
    holder = mech.add(bd.RigidBody("holder", mass=0.05, inertia=1e-5, center=top))
    ends = mech.ground.at(*top), holder.at(*top)
    mech.add(bd.Prismatic("guide", *ends, direction=up))

    def travel(t):
        x = t / duration
        return -8e-3 * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)

    law = bd.piecewise((duration, travel), -8e-3)
    mech.add(bd.TranslationalDriver("press", *ends, law, direction=up))
    line = bd.Line(top, (0.0, 0.0))
    blade = mech.add(bd.Beam("blade", line, section, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", holder.at(*top), blade.start))
    mech.add(bd.PointOnLine("plate", mech.ground.at(0.0, 0.0), blade.end, direction=(1.0, 0.0)))
    mech.observe("clamp", blade.section_forces(0.0))
    return mech


def bent_strip(elements):
    """A strip of steel that a moment bends."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.15, 4e-4, damping=1e-4)
    line = bd.Line((0.0, 0.0), (0.08, 0.0))
    strip = mech.add(bd.Beam("strip", line, section, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.Moment("moment", strip.end, bd.table([0.0, 0.1, 0.2], [0.0, 0.5, 0.5], "pchip")))
    mech.observe("clamp", strip.section_forces(0.0))
    return mech


def warnings_of(run):
    return [x for x in run.warnings if "between the steps" in x]


@pytest.mark.slow(reason="half a second and more")
def test_regression_axial_forces_between_steps_have_their_error():
    """They were wrong by 93 % of the largest value in silence; at the steps, they are right."""
    coarse, fine = (bd.simulate(pressed_blade(16), bd.Radau(x), 0.2) for x in (1e-5, 1e-9))
    (warning,) = warnings_of(coarse)
    name = warning.partition(":")[0]
    assert name.startswith("clamp.")
    largest = np.max(np.abs(fine[name].to_numpy()))
    error = np.max(np.abs(coarse[name].to_numpy() - fine[name].to_numpy())) / largest
    stated = float(warning.split("up to ")[1].split()[0]) / 100.0
    assert error > 0.5
    np.testing.assert_allclose(stated, error, rtol=0.2)  # rows are not at the same places in steps
    assert "or solution.section_forces('blade')." in warning
    at_clamp = coarse.section_forces("blade", s=[0.0])
    balanced = getattr(at_clamp, name.removeprefix("clamp."))[:, 0]
    np.testing.assert_allclose(balanced, fine[name].to_numpy(), atol=0.05 * largest)
    recommended = float(warning.split("use rtol=")[1].split(",")[0])
    assert not warnings_of(bd.simulate(pressed_blade(16), bd.Radau(recommended), 0.2))
    assert not warnings_of(fine)


@pytest.mark.slow(reason="half a second and more")
def test_regression_errors_between_steps_are_no_mesh_errors():
    """Shorter elements were recommended, which make them larger."""
    run = bd.simulate(pressed_blade(16, duration=1.0), bd.Radau(1e-5), 2.0)
    assert warnings_of(run)
    assert not [x for x in run.warnings if "mesh error" in x]


@pytest.mark.slow(reason="a fifth of a second")
def test_forces_of_beams_in_pure_bending_have_no_warning():
    assert not warnings_of(bd.simulate(bent_strip(8), bd.Radau(1e-5), 0.2))
