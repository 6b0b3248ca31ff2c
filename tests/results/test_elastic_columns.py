"""Forces of beams and springs between the steps of a run."""

import casadi as ca
import numpy as np
import pytest
from mechanisms import clamped_beam, hinged_body, rectangle

import beamdae as bd

# A filter that matches no message, so that runs are checked although all warnings are ignored.
pytestmark = pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")


def pressed_blade(elements, duration=0.1):
    """A blade of steel that leans on a plate, while its holder is lowered slowly."""
    mech = bd.Mechanism()
    section = rectangle(4e-4, 0.15, damping=1e-4)
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


def bushed_pendulum(stiffness, *event, **options):
    """Two bodies that a stiff bushing connects; an event may follow."""
    mech, arm = hinged_body(1.0, 0.1, name="arm", gravity=9.81)
    bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, (1.0, 0.0)))
    ends = arm.at(0.5, 0.0), bob.at(0.5, 0.0)
    springs = dict.fromkeys(("kx", "ky", "ktheta"), stiffness)
    dampers = dict.fromkeys(("cx", "cy", "ctheta"), 1e-5 * stiffness)
    bushing = mech.add(bd.Bushing("bushing", *ends, **springs, **dampers))
    mech.observe("bushing", bushing.force)
    idle = mech.add(bd.Force("idle", bob.at(1.0, 0.0), (0.0, 0.0)))
    if event:
        do = options.pop("do", None) or bd.deactivate(idle)
        mech.when(*event, do=do, name="limit", **options)
    return mech


def mesh_warnings(run):
    return [x for x in run.warnings if "mesh error" in x]


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    "integrator", [bd.Radau(1e-5), bd.Ida(1e-5), bd.GeneralizedAlpha(rtol=1e-5)]
)
def test_regression_axial_forces_between_steps_are_as_accurate_as_at_steps(integrator):
    """They were wrong by 93 % of the largest value with Radau; at the steps, they are right."""
    coarse, fine = (bd.simulate(pressed_blade(16), x, 0.2) for x in (integrator, bd.Radau(1e-9)))
    balanced = fine.section_forces("blade", s=[0.0])
    for name in ("N", "Q", "M"):
        reference = fine[f"clamp.{name}"].to_numpy()
        largest = np.max(np.abs(reference))
        # Errors at the steps are up to 1e-3.
        np.testing.assert_allclose(
            coarse[f"clamp.{name}"].to_numpy(), reference, atol=3e-3 * largest
        )
        # From the loads, without strains.
        np.testing.assert_allclose(reference, getattr(balanced, name)[:, 0], atol=2e-3 * largest)


@pytest.mark.slow(reason="half a second")
def test_regression_forces_of_stiff_bushings_between_steps_are_accurate():
    """They were wrong by 35 and 49 % of the largest value."""
    coarse, fine = (bd.simulate(bushed_pendulum(1e9), bd.Radau(x), 1.0) for x in (1e-5, 1e-9))
    for name in ("bushing.Fx", "bushing.Fy"):
        reference = fine[name].to_numpy()
        largest = np.max(np.abs(reference))
        np.testing.assert_allclose(coarse[name].to_numpy(), reference, atol=2e-3 * largest)


@pytest.mark.slow(reason="half a second and more")
def test_regression_errors_between_steps_are_no_mesh_errors():
    """Shorter elements were recommended, which make them larger."""
    run = bd.simulate(pressed_blade(16, duration=1.0), bd.Radau(1e-5), 2.0)
    assert not mesh_warnings(run)


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize("integrator", [bd.GeneralizedAlpha(step=0.01), bd.Radau(1e-2)])
def test_largest_stresses_between_steps_are_those_of_both_fibers(integrator, formulation):
    """Polynomials through kinks of magnitudes were negative, and missed their zeros by 8 %."""
    strip = rectangle(0.004, damping=1e-3)
    mech, beam = clamped_beam(strip, curve=0.6, name="strip", formulation=formulation)
    mech.add(bd.Force("shaker", beam.end, (0.0, lambda t: ca.sin(6.0 * np.pi * t + 1.0))))
    for name, exponent in (("largest", None), ("bound", 20.0)):
        mech.observe(name, beam.largest_stress(s=[0.0], exponent=exponent))
    for side in ("top", "bottom"):
        mech.observe(side, beam.stress(0.0, side))
    run = bd.simulate(mech, integrator, t_end=0.9, output_step=5e-4)
    top, bottom = (run[x].to_numpy() for x in ("top", "bottom"))
    both = np.maximum(np.abs(top), np.abs(bottom))
    for name in ("largest.largest", "bound.bound"):
        magnitude = run[name].to_numpy()
        assert magnitude.min() >= 0.0
        # Eleven steps a period interpolate positions and stresses within 2 % of the amplitude.
        np.testing.assert_allclose(magnitude, both, atol=0.02 * both.max())


@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e11])
@pytest.mark.parametrize(
    "integrator", [bd.Radau(1e-4), bd.Radau(1e-6), bd.GeneralizedAlpha(step=2e-3)]
)
def test_events_of_stiff_forces_are_crossings_of_their_columns(integrator, stiffness):
    """Forces at interpolated positions crossed limits that columns never reach, 662 times."""
    free = bd.simulate(bushed_pendulum(stiffness), integrator, 1.0)
    for column in ("bushing.Fx", "bushing.Fy"):
        extremes = free.step_extremes[column]
        middle = 0.5 * (extremes.min + extremes.max)

        for side in (-1.5, 0.0, 1.5):
            limit = middle + side * extremes.half_range
            mech = bushed_pendulum(stiffness, column, limit, do="record")
            run = bd.simulate(mech, integrator, 1.0)
            assert run.events.empty == (side != 0.0)
            if side == 0.0:
                rows = run.at_times(run.events["t [s]"].to_numpy())
                for values in (run.events[f"{column} [N]"], rows[column]):
                    np.testing.assert_allclose(values, limit, atol=1e-9 * extremes.half_range)


@pytest.mark.parametrize("stiffness", [1e9, 1e11])
@pytest.mark.parametrize("rtol", [1e-5, 1e-6])
def test_stiff_forces_are_accurate_where_a_run_restarts(rtol, stiffness):
    """They were wrong by 6 to 41 % of the largest value; transverse ones, by up to four times."""
    free = bd.simulate(bushed_pendulum(stiffness), bd.Radau(1e-8), 1.0)
    run = bd.simulate(bushed_pendulum(stiffness, "t", 0.3137), bd.Radau(rtol), 1.0)
    times = 0.3137 + np.linspace(0.0, 5e-3, 50)
    coarse, fine = (x.at_times(times) for x in (run, free))
    for column in ("bushing.Fx", "bushing.Fy"):
        largest = np.max(np.abs(free[column]))
        np.testing.assert_allclose(coarse[column], fine[column], atol=0.02 * largest)
