"""Forces of beams and springs between the steps of a run."""

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.elastic_columns import find_elastic_columns, observe_elastic_columns

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


def dropped_blade():
    """A blade that falls on its tip: an event begins a new interval."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 2e-3, damping=1e-4)
    line = bd.Line((0.0, 0.0), (0.3, 0.0))
    blade = mech.add(bd.Beam("blade", line, section, 4))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), blade.start))
    load = mech.add(bd.Force("load", blade.end, (0.0, -5.0)))
    mech.when("t", crosses=0.02, do=bd.deactivate(load))
    mech.observe("clamp", blade.section_forces(0.0))
    mech.observe("gauge", blade.strain(0.1, "top"))
    mech.observe("tip", blade.end)
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

    def pendulum():
        mech = bd.Mechanism(gravity=(0.0, -9.81))
        arm = mech.add(bd.RigidBody("arm", 1.0, 0.1, (0.0, 0.0)))
        mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0)))
        bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, (1.0, 0.0)))
        ends = arm.at(0.5, 0.0), bob.at(0.5, 0.0)
        stiffness = {"kx": 1e9, "ky": 1e9, "ktheta": 1e9, "cx": 1e4, "cy": 1e4, "ctheta": 1e4}
        bushing = mech.add(bd.Bushing("bushing", *ends, **stiffness))
        mech.observe("bushing", bushing.force)
        return mech

    coarse, fine = (bd.simulate(pendulum(), bd.Radau(x), 1.0) for x in (1e-5, 1e-9))
    for name in ("bushing.Fx", "bushing.Fy"):
        reference = fine[name].to_numpy()
        largest = np.max(np.abs(reference))
        np.testing.assert_allclose(coarse[name].to_numpy(), reference, atol=2e-3 * largest)


@pytest.mark.slow(reason="half a second and more")
def test_regression_errors_between_steps_are_no_mesh_errors():
    """Shorter elements were recommended, which make them larger."""
    run = bd.simulate(pressed_blade(16, duration=1.0), bd.Radau(1e-5), 2.0)
    assert not mesh_warnings(run)


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize("integrator", [bd.Radau(1e-5), bd.Ida(1e-5), bd.GeneralizedAlpha(1e-3)])
def test_sections_between_steps_are_interpolated_like_accelerations(integrator):
    run = bd.simulate(dropped_blade(), integrator, 0.05, 1e-4)
    assert len(run.trajectory.intervals) == 2
    indices = find_elastic_columns(run.equations)
    names = [list(run.columns)[k] for k in indices]
    assert [x.partition(".")[0].partition(" ")[0] for x in names] == ["clamp"] * 3 + ["gauge"]
    for interval in run.trajectory.intervals:
        # At the nodes, they are those of the states, also at both sides of the event.
        at_nodes = run._observe(interval.times, *interval.rows)[:, indices]
        inside = interval.t[:-1] + 0.4 * np.diff(interval.t)
        times = np.concatenate([interval.t[1:], inside])
        times.sort()
        between = run.at_times(times)
        columns = np.column_stack([between.columns[x] for x in names])
        expected = interval.interpolate_forces(at_nodes, times)
        np.testing.assert_array_equal(columns, expected)
        is_step = np.isin(times, interval.t)
        np.testing.assert_allclose(
            columns[is_step], at_nodes[:: interval.nodes_per_step][1:], rtol=1e-12
        )
        a = interval.interpolate_forces(interval.rows.a, times)
        np.testing.assert_array_equal(a, interval.at(times, limited=True).a)


@pytest.mark.slow(reason="a second")
def test_sections_are_observed_in_blocks_of_nodes():
    run = bd.simulate(dropped_blade(), bd.Radau(1e-5), 0.05)
    whole = observe_elastic_columns(run.equations, run.trajectory, 10**6)
    assert [len(x) for x in whole] == [len(x.nodes) for x in run.trajectory.intervals]
    for max_rows in (1, 7, 50):
        blocks = observe_elastic_columns(run.equations, run.trajectory, max_rows)
        for one, other in zip(whole, blocks, strict=True):
            # Kernels of several rows round differently.
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_runs_without_sections_are_not_observed_again():
    mech = dropped_blade()
    for name in ("clamp", "gauge"):
        del mech.observables[name]
    run = bd.simulate(mech, bd.Radau(1e-5), 0.05)
    assert len(run._elastic_at_nodes[1]) == 0
    assert np.all(np.isfinite(run["tip.y"]))
