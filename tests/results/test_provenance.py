"""Provenance of results: parts with their parameters, hashes, versions."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest
from conformance import JOINTS, LOADS, NONHOLONOMIC
from mechanisms import EARTH
from support import ARC, SOFT_MATERIAL

import beamdae as bd

EVERYTHING = JOINTS | NONHOLONOMIC | LOADS


def provenance_of(mech):
    """Return the equations in the metadata of a run, as in its JSON file."""
    metadata = bd.simulate(mech, bd.Radau(1e-3), t_end=1e-6).metadata()
    return json.loads(json.dumps(metadata))["equations"]


def mechanism(stiffness=3.0):
    mech = bd.Mechanism(gravity=EARTH)
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, bd.Section.circle(SOFT_MATERIAL, 0.1), elements=2))
    mech.add(bd.Spring("spring", disk.at(0.5, 0.4), beam.end, stiffness))
    return mech, disk, beam


@pytest.mark.parametrize("make", EVERYTHING.values(), ids=EVERYTHING)
def test_every_part_is_described_in_json(make):
    mech, disk, beam = mechanism()
    part = mech.add(make(mech, disk, beam))
    parts = provenance_of(mech)["parts"]
    assert list(parts) == list(mech.parts)
    assert parts[part.name]["class"] == type(part).__name__
    assert len(parts[part.name]) > 1


def test_each_object_is_described_once():
    provenance = provenance_of(mechanism()[0])
    assert provenance["gravity"] == [0.0, -9.81]
    beam = provenance["parts"]["beam"]
    assert beam["curve"] == {
        "class": "Arc",
        "radius": 1.6,
        "length": 2.0,
        "start": [0.3, -0.2],
        "angle": 0.4,
    }
    assert beam["section"]["material"]["E"] == SOFT_MATERIAL.E
    assert beam["mesh"]["elements"] == 2
    assert "curve" not in beam["mesh"]
    spring = provenance["parts"]["spring"]
    assert spring["stiffness"] == 3.0
    assert spring["a"] == {"body": "disk", "at": [0.5, 0.4]}


def test_other_parameters_have_another_hash():
    one, same, other = (provenance_of(mechanism(k)[0])["identity"] for k in (3.0, 3.0, 3.1))
    assert one == same != other


@pytest.mark.slow(reason="a fifth of a second")
def test_metadata_contain_time_parts_and_hash(tmp_path):
    before = datetime.now(UTC).replace(microsecond=0)
    run = bd.simulate(mechanism()[0], bd.Radau(1e-3), t_end=0.01)
    metadata = json.loads(run.to_csv(tmp_path / "a.csv").with_suffix(".json").read_text())
    assert before <= datetime.fromisoformat(metadata["written"]) <= datetime.now(UTC)
    assert metadata["equations"]["parts"]["disk"]["mass"] == 1.3
    assert len(metadata["equations"]["identity"]) == 64


def test_laws_and_long_lists_are_abbreviated():
    mech = bd.Mechanism()
    points = [(np.cos(x), np.sin(x)) for x in np.linspace(0.0, 6.0, 40)]
    plate = mech.add(bd.RigidBody.polygon("plate", points, density=7800.0, thickness=0.01))
    mech.add(bd.Force("push", plate.at(0.0, 0.0), (lambda t: t, 2.0)))
    parts = provenance_of(mech)["parts"]
    assert parts["plate"]["shape"] == "40 entries"
    assert parts["push"]["law"] == ["function", 2.0]
