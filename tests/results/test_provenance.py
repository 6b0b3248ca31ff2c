"""Provenance of results: parts, hashes, versions."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import pytest
from support import ARC, SOFT_MATERIAL

import beamdae as bd


def provenance_of(mech):
    """Return the equations in the metadata of a run, as in its JSON file."""
    metadata = bd.simulate(mech, bd.Radau(1e-3), t_end=1e-6).metadata()
    return json.loads(json.dumps(metadata))["equations"]


def mechanism(stiffness=3.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, bd.Section.circle(SOFT_MATERIAL, 0.1), elements=2))
    mech.add(bd.Spring("spring", disk.at(0.5, 0.4), beam.end, stiffness))
    return mech, disk, beam


def test_parts_are_listed_with_their_classes():
    assert provenance_of(mechanism()[0])["parts"] == {
        "disk": "RigidBody",
        "beam": "Beam",
        "spring": "Spring",
    }


def test_other_parameters_have_another_hash():
    one, same, other = (provenance_of(mechanism(k)[0])["identity"] for k in (3.0, 3.0, 3.1))
    assert one == same != other


@pytest.mark.slow(reason="a fifth of a second")
def test_metadata_contain_time_parts_and_hash(tmp_path):
    before = datetime.now(UTC).replace(microsecond=0)
    run = bd.simulate(mechanism()[0], bd.Radau(1e-3), t_end=0.01)
    metadata = json.loads(run.to_csv(tmp_path / "a.csv").with_suffix(".json").read_text())
    assert before <= datetime.fromisoformat(metadata["written"]) <= datetime.now(UTC)
    assert metadata["equations"]["parts"]["disk"] == "RigidBody"
    assert len(metadata["equations"]["identity"]) == 64
