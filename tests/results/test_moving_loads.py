"""Warnings about section forces from strains in elements that a moving load passes."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

import beamdae as bd

LENGTH, FORCE, SPEED = 2.0, 100.0, 0.5
# Light and damped, so that the bridge hardly vibrates.
LIGHT = bd.Material(E=2e11, nu=0.3, rho=50.0)
STRIP = bd.Section.rectangle(LIGHT, width=0.05, height=0.02, damping=1e-2)


def bridge(elements=4, start=0.0):
    """Return a simply supported beam, at the middle of which a moving load is observed."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("bridge", bd.Line((0, 0), (LENGTH, 0)), STRIP, elements=elements))
    mech.add(bd.Revolute("left", mech.ground.at(0, 0), beam.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(LENGTH, 0), beam.end, direction=(1, 0)))
    mech.add(bd.MovingForce("wheel", beam, (0.0, -FORCE), SPEED, start))
    return mech, beam


def run(mech, t_end):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return bd.simulate(mech, bd.Radau(1e-3), t_end, output_step=t_end / 400)


def about_moving_loads(solution):
    return [x for x in solution.warnings if "passes the element" in x]


@pytest.mark.slow(reason="half a second")
def test_regression_observed_section_forces_below_a_moving_load_have_a_warning():
    mech, beam = bridge()
    mech.observe("middle", beam.section_forces(1.0))
    mech.observe("gauge", beam.stress(1.0, "top"))
    mech.observe("deflection", beam.deflection(1.0))
    mech.observe("later", beam.section_forces(1.9))
    solution = run(mech, 2.8)
    middle, gauge = about_moving_loads(solution)
    # At an element end, strains are those beyond it; "0.5 to 1 m" had no error.
    assert middle.startswith("middle: wheel passes the element of this section (s = 1 to 1.5 m)")
    assert "off by up to half of the load, and M by up to its product with 0.029 m" in middle
    assert "use solution.section_forces('bridge')" in middle
    assert gauge.startswith("gauge: wheel passes")
    # The warning is right: the largest errors are up to those named, and the remedy is exact up to
    # vibrations.
    place = SPEED * solution.t
    moment = 0.5 * np.minimum(place, LENGTH - place) * FORCE
    errors = np.abs(np.abs(solution["middle.M"].to_numpy()) - moment)
    is_named = (place > 1.0) & (place < 1.5)
    assert 0.7 * 0.029 * FORCE < errors[is_named].max() < 1.2 * 0.029 * FORCE
    assert errors[place < 1.0].max() < 0.005 * FORCE
    forces = solution.section_forces("bridge")
    column = np.abs(forces.M[:, np.argmin(np.abs(forces.s - 1.0))])
    place = SPEED * np.asarray(forces.t)
    moment = 0.5 * np.minimum(place, LENGTH - place) * FORCE
    assert np.abs(column - moment)[place > 0.5].max() < 0.015 * 0.5 * FORCE


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    ("elements", "start", "count"),
    [(4, 0.1, 0), (4, 0.6, 0), (4, 1.1, 2), (30, 0.9, 1)],
    ids=["before it", "before its element", "passed", "short elements"],
)
def test_loads_elsewhere_and_stresses_in_short_elements_have_no_warning(elements, start, count):
    mech, beam = bridge(elements, start)
    mech.observe("middle", beam.section_forces(1.0))
    mech.observe("gauge", beam.stress(1.0, "top"))
    assert len(about_moving_loads(run(mech, 0.6))) == count


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("start", "count"), [(0.1, 1), (0.5, 0)])
def test_sliding_points_are_moving_loads(start, count):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    beam = mech.add(bd.Beam("rail", bd.Line((0, 0), (0.5, -0.6)), STRIP, elements=1))
    mech.add(bd.Weld("clamp", mech.ground.at(0, 0), beam.start))
    bead = mech.add(bd.PointMass("bead", 0.1, at=beam.at(start).point))
    mech.add(bd.SlidingOnBeam("slide", bead.point, beam))
    mech.observe("clamp", beam.section_forces(0.0))
    solution = run(mech, 0.45)
    assert len(about_moving_loads(solution)) == count


@pytest.mark.slow(reason="half a second and more")
def test_regression_section_forces_that_sensors_measure_have_a_warning():
    mech, beam = bridge()
    for column in ("N", "Q", "M"):
        mech.sensor(f"sensor {column}", beam.section_forces(1.0), column)
    names = [x.partition(":")[0] for x in about_moving_loads(run(mech, 2.8))]
    assert names == ["sensor Q", "sensor M"]
    mech, beam = bridge(elements=25)
    for column in ("Q", "M"):
        mech.sensor(f"sensor {column}", beam.section_forces(1.0), column)
    names = [x.partition(":")[0] for x in about_moving_loads(run(mech, 2.8))]
    assert names == ["sensor Q"]


def bead_on_arch(elements):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.006, damping=2e-4)
    curve = bd.Parabola(span=1.0, rise=0.2, start=(0.0, 0.0))
    arch = mech.add(bd.Beam("arch", curve, section, elements=elements))
    for k, end in enumerate((arch.start, arch.end)):
        mech.add(bd.Weld(f"clamp {k}", mech.ground.at(*end.point), end))
    bead = mech.add(bd.PointMass("bead", 2.0, at=arch.at(0.7).point))
    ring = mech.add(bd.SlidingOnBeam("ring", bead.point, arch))
    mech.observe("ring", ring.reaction)
    return run(mech, 0.15)


@pytest.mark.slow(reason="two runs with a slider")
def test_regression_mesh_errors_of_the_reactions_of_sliding_points_have_a_warning():
    """The reaction of a bead on an arch of 4 elements was 15 % off without a word."""
    coarse, fine = bead_on_arch(4), bead_on_arch(9)
    (warning,) = (x for x in coarse.warnings if "mesh error of its reaction" in x)
    assert warning.startswith("ring: ")
    assert warning.endswith("use 9 elements.")
    stated = float(warning.partition("is about ")[2].partition(" %")[0])
    forces = [np.array([x["ring.Fx"], x["ring.Fy"]]) for x in (coarse, fine)]
    squares = (
        np.sum((forces[0] - forces[1]) ** 2),
        np.sum(np.var(forces[1], axis=1)) * len(coarse.t),
    )
    error = 100.0 * np.sqrt(squares[0] / squares[1])
    assert 10.0 < error < 25.0
    assert 0.5 * error < stated < 2.0 * error
    assert not any("mesh error of its reaction" in x for x in fine.warnings)


@pytest.mark.parametrize(("elements", "nodes"), [(1, 4), (2, 4), (2, 3), (4, 2)])
def test_regression_deflections_below_moving_loads_on_long_elements_have_a_warning(elements, nodes):
    """The deflection of a bridge of one element was 10 % too small without notice."""

    def bridge(elements, x):
        mech = bd.Mechanism()
        section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.01)
        line = bd.Line((0.0, 0.0), (1.0, 0.0))
        beam = mech.add(bd.Beam("bridge", line, section, elements=elements, nodes=nodes))
        mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.PointOnLine("right", mech.ground.at(1.0, 0.0), beam.end, (1.0, 0.0)))
        mech.add(bd.MovingForce("wheel", beam, (0.0, -0.1), speed=1.0))
        mech.observe("place", beam.at(x))
        # x = a, 1 - x = b: w = F a^2 b^2 / (3 E I).
        exact = -0.1 * (x * (1.0 - x)) ** 2 / (3.0 * section.EI)
        largest = 0.1 / (48.0 * section.EI)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", bd.BeamdaeWarning)
            path = bd.equilibrium(mech, t=x)
        return (path["place.y"].iloc[-1] - exact) / largest, [str(w.message) for w in caught]

    def inner_middle(elements):
        # The middle of the element near the middle of the bridge, where linear elements err most.
        return (elements // 2 + 0.5) / elements

    error, texts = bridge(elements, inner_middle(elements))
    text = next(text for text in texts if "do not bend sharply" in text)
    stated = 0.01 * float(re.search(r"is about (\S+) %", text).group(1))
    assert 0.01 < error < 1.1 * stated < 2.0 * error
    count = int(re.search(r"elements=(\d+)", text).group(1))
    error, texts = bridge(count, inner_middle(count))
    assert abs(error) < 0.01
    assert not any("do not bend sharply" in text for text in texts)


def test_regression_moving_loads_on_one_linear_element_do_not_fail():
    """A path along which no point moves ended with a ZeroDivisionError."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.01)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("bridge", line, section, elements=1, nodes=2))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(1.0, 0.0), beam.end, (1.0, 0.0)))
    mech.add(bd.MovingForce("wheel", beam, (0.0, -0.1), speed=1.0))
    mech.observe("middle", beam.at(0.5))
    with pytest.warns(bd.BeamdaeWarning, match="do not bend sharply"):
        assert bd.equilibrium(mech, t=0.5)["middle.y"].iloc[-1] == pytest.approx(0.0, abs=1e-12)
