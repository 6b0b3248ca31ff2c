"""Verdicts on stability that a mesh does not decide."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae.analysis.statics import mesh_dependence
from beamdae.beams.prolongation import halve_elements, prolongation_matrix

STEEL = bd.Material.of("steel")
FORMULATIONS = [
    {"formulation": "exact"},
    pytest.param({"strain": "exact"}, marks=pytest.mark.slow(reason="two seconds")),
]


def elastica(elements, **options):
    """Return a hinged strip of 1 m under a compressive force of EI / L^2."""
    mech, section = bd.Mechanism(), bd.Section.rectangle(STEEL, width=0.02, height=1e-3)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    strip = mech.add(bd.Beam("strip", line, section, elements, **options))
    mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), strip.end))
    mech.add(bd.Force("press", strip.end, (-section.EI, 0.0)))
    mech.observe("tip", strip.end)
    return mech


def beyond_figure_eight(elements, **options):
    return bd.equilibrium(elastica(elements, **options), to={"tip.x": -0.6}, switch=1)


@pytest.mark.slow(reason="one second and more")
@pytest.mark.parametrize("options", FORMULATIONS)
@pytest.mark.parametrize("elements", [6, 8])
def test_coarse_elastica_is_undecided(elements, options):
    # Beyond the figure eight, one direction is unstable (second variation by a spectral method);
    # its eigenvalue is 1e-3 of the next one. These meshes have a branch point at 76.2 and 90.5.
    with pytest.warns(bd.BeamdaeWarning) as warned:
        path = beyond_figure_eight(elements, **options)
    texts = [str(one.message) for one in warned]
    assert any("is not decided by this mesh" in text for text in texts)
    assert any("the branch point at the load factor" in text for text in texts)
    assert path.status.success
    assert path.unstable[-1] == -1
    assert not path.stable
    assert [round(point.factor, 1) for point in path.critical] == [9.9, 21.5]
    undecided = path.unstable == -1
    assert np.all(path.unstable[~undecided][-3:] == 1)


@pytest.mark.slow(reason="one second and more")
@pytest.mark.filterwarnings("error::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize("options", FORMULATIONS)
def test_finer_elastica_is_decided(options):
    path = beyond_figure_eight(12, **options)
    assert path.unstable[-1] == 1
    assert len(path.critical) == 2


@pytest.mark.parametrize(
    "options",
    [
        {"formulation": "exact"},
        {"formulation": "exact", "nodes": 3},
        {"frame": "chord"},
        {"frame": "tangent"},
        {"elements_shape": "straight", "elements": 40},
    ],
)
def test_motions_on_both_meshes_are_equal(options):
    elements = options.pop("elements", 6)
    curve, section = bd.Arc(0.5, 1.0, angle=1.0), bd.Section.rectangle(STEEL, 0.02, 2e-3)
    coarse = bd.Beam("arch", curve, section, elements, **options)
    fine = coarse.with_mesh(halve_elements(coarse.mesh))
    matrix = prolongation_matrix(coarse, fine)
    # The neglected angles between axes are up to 0.05 for straight elements, times the amplitude.
    amplitude = 1e-3
    rng = np.random.default_rng(1)
    change = amplitude * rng.standard_normal(len(coarse.coordinates))
    q = coarse.initial_position + change
    other = fine.initial_position + matrix @ change
    for s in np.linspace(0.0, 1.0, 4):
        positions = []
        for beam, coordinates in ((coarse, q), (fine, other)):
            point = beam.kinematics.material_point(float(s))
            values = point.motion(point.operator @ coordinates)
            positions.append(np.array(values[0]).ravel())
        assert positions[0] == pytest.approx(positions[1], abs=1e-4)


def test_points_with_large_eigenvalues_are_not_checked(monkeypatch):
    def fail(*_):
        raise AssertionError("the fine mesh is not needed")

    monkeypatch.setattr(mesh_dependence, "RefinedPath", fail)
    assert bd.equilibrium(elastica(4)).stable


def test_regression_section_forces_of_equilibria_are_compared_with_exact_strains():
    """A shear force off by 5.6 % had no warning: its error does not depend on the mesh."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.045, height=4.3e-3)
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.35, 0.0)), section, elements=4))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), leaf.start))
    mech.add(bd.Force("load", leaf.end, (0.0, -600.0)))
    mech.observe("clamp", leaf.section_forces(0.0))
    path = bd.equilibrium(mech)
    (sentence,) = path.warnings
    # The load is normal to the clamped section; the axial force is small beside it.
    found = re.search(
        r"exact strains, clamp.Q is -600.27 N instead of (\S+) N, a ch.* (\S+) %;", sentence
    )
    assert found is not None
    assert float(found[1]) == pytest.approx(path["clamp.Q"].iloc[-1], rel=1e-4)
    assert float(found[2]) == pytest.approx(5.3)
    assert "clamp.N" not in sentence
