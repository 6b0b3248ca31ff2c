"""What a part states has to fit: whatever does not is refused by name, nothing is dropped."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose
from support import Numeric

import beamdae as bd
from beamdae.symbolic.statements import (
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    Named,
    Piece,
)


def disk(name="disk", **words):
    return bd.RigidBody(name, mass=2.0, inertia=1.0, **words)


@dataclass(frozen=True, eq=False)
class Pin(bd.Part):
    """Holds x of a point; no `Joint`, and its attachment has a name of its own."""

    name: str
    held_here: bd.Attachment

    def constraints(self):
        local = Local(self.held_here.size, 0, 1)
        kernel = ConstraintKernel(local, self.held_here.position(local.q)[0])
        named = (Named("x", "N"),)
        return [ConstraintStatement(self.name, kernel, (self.held_here.piece,), named)]


@dataclass(frozen=True, eq=False)
class Push(bd.Part):
    """A constant force in x; fields may be changed to make it misfit."""

    name: str
    where: bd.Attachment
    columns: int = 0
    rows: int = 0
    data: tuple = (3.0,)
    told_as: str = ""

    def forces(self, gravity):
        local = Local(self.where.size, 1)
        place = self.where.position(local.q)
        force = -ca.jtimes(place, local.q, ca.vertcat(local.data[0], 0), True)
        operator = self.where.operator
        if self.columns or self.rows:
            shape = (operator.shape[0] + self.rows, operator.shape[1] + self.columns)
            operator = sp.csr_array(np.ones(shape))
        piece = Piece(self.where.body, operator)
        data = np.array(self.data)[:, None]
        name = self.told_as or self.name
        return [ForceStatement(name, ForceKernel(local, force), (piece,), data)]


def pushed(**words):
    """Two disks, the second one pushed."""
    mech = bd.Mechanism()
    mech.add(disk("first"))
    second = mech.add(disk("second", center=(3.0, 0.0)))
    mech.add(Push("push", second.at(3.0, 0.0), **words))
    return mech


def test_regression_a_part_that_holds_something_is_not_dropped_for_being_no_joint():
    mech = bd.Mechanism()
    body = mech.add(disk())
    mech.add(Pin("pin", body.at(1.0, 0.0)))
    assert bd.equations_of_motion(mech).lam_names == ("pin.x",)
    numeric = Numeric(mech)
    assert_allclose(numeric.constraint_matrix(), [[1.0, 0.0, 0.0]], atol=1e-15)


def test_regression_a_load_acts_on_the_body_its_attachment_is_of_whatever_the_field_is_called():
    # Assembled on the first body before.
    assert_allclose(Numeric(pushed()).force(), [0.0, 0.0, 0.0, -3.0, 0.0, 0.0], atol=1e-15)


def test_an_attachment_of_a_body_that_was_not_added_is_refused_at_once():
    stranger = disk("stranger")
    for part in (Push("push", stranger.at(0.0, 0.0)), Pin("pin", stranger.at(0.0, 0.0))):
        with pytest.raises(bd.BeamdaeError, match=f"^{part.name}: it refers to 'stranger', which"):
            bd.Mechanism().add(part)


@dataclass(frozen=True, eq=False)
class Hidden(bd.Part):
    """Refers to a body in a way no field shows."""

    name: str
    where: dict = field(default_factory=dict)

    def forces(self, gravity):
        return Push(self.name, self.where["there"]).forces(gravity)


def test_a_body_hidden_from_the_mechanism_is_refused_when_it_is_assembled():
    mech = bd.Mechanism()
    mech.add(disk())
    mech.add(Hidden("push", {"there": disk("stranger").at(0.0, 0.0)}))
    with pytest.raises(bd.BeamdaeError, match=r"^push: it refers to 'stranger', which must be"):
        bd.equations_of_motion(mech)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"columns": 1}, "push: its operator on 'second' has 4 columns, the body has 3 coord"),
        ({"rows": 1}, "push: its operators have 4 rows for 1 x 3 local coordinates, these must"),
        ({"data": (3.0, 1.0)}, r"push: its data must have shape \(1, 1\), got \(2, 1\)"),
        ({"told_as": "pull"}, "push: its statements must bear its name, got 'pull'"),
    ],
)
def test_statements_that_do_not_fit_are_refused(words, message):
    with pytest.raises(bd.BeamdaeError, match=f"^{message}") as refused:
        bd.equations_of_motion(pushed(**words))
    assert str(refused.value).endswith(".")


class Mute(bd.Part):
    """Says nothing: its author called `forces` something else."""

    name = "mute"

    def force_statements(self, gravity):
        return []


class Confused(bd.Part):
    """States a constraint among its forces."""

    name = "confused"

    def forces(self, gravity):
        mech = bd.Mechanism()
        return Pin("confused", mech.ground.at(0.0, 0.0)).constraints()


class Body(bd.Part):
    """A body whose coordinates are given."""

    name = "body"

    def __init__(self, coordinates, position=(0.0,)):
        self._coordinates, self._position = coordinates, position

    @property
    def coordinates(self):
        return self._coordinates

    @property
    def initial_position(self):
        return np.array(self._position)

    @property
    def initial_velocity(self):
        return np.zeros(1)

    def forces(self, gravity):
        local = Local(1)
        kernel = ForceKernel(local, 2.0 * local.a)
        return [ForceStatement("body", kernel, (Piece(self, sp.eye_array(1)),), np.zeros((0, 1)))]


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (Mute(), "mute: the part has nothing to say"),
        (Confused(), "confused: it must state ForceStatements, got ConstraintStatement"),
        (Body(("x",)), r"body: coordinates must be Named\(name, unit\) each, got \('x',\)"),
        (Body((Named("x", "m"),) * 2), "body: its coordinates must differ, got x, x"),
        (Body((Named("x", "m"),), (0.0, 1.0)), r"body: initial_position must have shape \(1,\)"),
    ],
)
def test_parts_that_do_not_fit_are_refused(part, message):
    mech = bd.Mechanism()
    mech.add(disk())
    mech.add(part)
    with pytest.raises(bd.BeamdaeError, match=f"^{message}") as refused:
        bd.equations_of_motion(mech)
    assert str(refused.value).endswith(".")


def test_regression_scales_come_from_units_and_not_from_names():
    """An angle called psi had the size of the mechanism, a length called phi that of a radian."""
    scales = []
    for name, unit in (("psi", "rad"), ("phi_length", "m")):
        mech = bd.Mechanism()
        mech.add(Body((Named(name, unit),)))
        mech.add(disk("far", center=(7.0, 0.0)))
        mech.add(disk("near"))
        scales.append(bd.equations_of_motion(mech).position_scales[0])
    assert scales == [1.0, 7.0]


def test_a_reaction_of_what_holds_nothing_is_refused():
    mech = pushed()
    joint = bd.Revolute("push", mech.ground.at(0.0, 0.0), mech.part("first").at(0.0, 0.0))
    mech.observe("force", joint.reaction)
    with pytest.raises(bd.BeamdaeError, match=r"^force: 'push' holds nothing, it has no reaction"):
        bd.equations_of_motion(mech)


def test_equations_are_what_they_are_and_no_others():
    """Regression: to compare equations of motion raised, numpy arrays have no truth value."""
    one, other = bd.equations_of_motion(pushed()), bd.equations_of_motion(pushed())
    assert one == one
    assert one != other
    assert len({one, other}) == 2
