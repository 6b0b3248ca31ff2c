"""Misuse of event actions: no part, foreign parts, inactive parts, the same instant twice."""

from contextlib import suppress

import pytest
from sample_parts import SAMPLES, SampleMechanism, find_public

import beamdae as bd

PARTS = {
    name: arguments
    for name, arguments in SAMPLES.items()
    if isinstance(find_public(name), type) and issubclass(find_public(name), bd.Part)
}
ACTIONS = {
    "activate": bd.activate,
    "activate as it is": lambda *parts: bd.activate(*parts, as_is=True),
    "deactivate": bd.deactivate,
    "change_law": lambda *parts: bd.change_law(*parts, lambda t: t),
    "impact": lambda *parts: bd.impact(*parts),
}
EVENT_TIME, END = 0.005, 0.01  # s


def sample(kind):
    """Return a mechanism with a sample part, and a ball that crosses x = 5 mm at 5 ms."""
    source = SampleMechanism()
    part = find_public(kind)(**PARTS[kind](source))
    mech = source.mechanism
    mech.add(part)
    clock = mech.add(bd.PointMass("clock", 1.0, at=(0.0, 9.0), velocity=(1.0, 0.0)))
    mech.observe("clock", clock.point)
    return mech, part


def create_action(name, part):
    """Return the action on a part; None if the action rejects parts of this kind."""
    with suppress(bd.BeamdaeError):
        return ACTIONS[name](part)
    return None


def add_events(mech, *actions):
    for k, action in enumerate(actions):
        mech.when("clock.x", EVENT_TIME, "up", action, f"event {k}")


def run(mech):
    """Return the solution, or the message of the error that assembly raises."""
    try:
        return bd.simulate(mech, bd.Radau(1e-4, max_steps=2000), END)
    except bd.BeamdaeError as error:
        return str(error)


@pytest.mark.parametrize("kind", PARTS)
@pytest.mark.parametrize("name", ACTIONS)
def test_parts_of_other_mechanisms_are_rejected(name, kind):
    """The other part has the name and the numbers of a part of this mechanism."""
    mech, part = sample(kind)
    _, foreign_part = sample(kind)
    if create_action(name, part) is None:
        return
    with pytest.raises(bd.BeamdaeError, match=f"event 0: '{part.name}' is not part of this"):
        add_events(mech, create_action(name, foreign_part))


def test_foreign_parts_are_rejected_if_the_part_of_this_name_is_added_later():
    empty = bd.Mechanism()
    disk = empty.add(bd.RigidBody("disk", 1.0, 0.1, (0.5, 0.4)))
    empty.observe("disk", disk.at(0.5, 0.4))
    part = bd.Revolute("joint", empty.ground.at(0.1, 0.2), disk.at(0.1, 0.2))
    other, foreign_part = sample("Revolute")
    assert other.part(part.name) is foreign_part
    empty.when("disk.x", 0.0, do=bd.deactivate(foreign_part), name="late")
    empty.add(part)
    with pytest.raises(bd.BeamdaeError, match=f"late: '{part.name}' is not part of this mechanism"):
        bd.equations_of_motion(empty)


@pytest.mark.slow(reason="compiles and runs every part of the catalog several times")
@pytest.mark.parametrize("kind", PARTS)
def test_actions_on_active_and_inactive_parts_end_with_a_result_or_a_reason(kind):
    for name in ACTIONS:
        for starts_inactive in (False, True):
            for count in (1, 2):
                mech, part = sample(kind)
                action = create_action(name, part)
                if action is None:
                    continue
                if starts_inactive:
                    mech.deactivate(part)
                add_events(mech, *(action,) * count)
                outcome = run(mech)
                if isinstance(outcome, str):
                    assert outcome.endswith("."), outcome
                    assert part.name in outcome
                    continue
                assert outcome.status.sentence
                if outcome.status.kind == "ok":
                    assert len(outcome.event_records) == count


@pytest.mark.slow(reason="compiles and runs every part of the catalog")
@pytest.mark.parametrize("kind", PARTS)
def test_opposite_events_at_the_same_instant_occur_in_the_order_of_their_definition(kind):
    for first, second, is_inactive in (
        ("activate", "deactivate", True),
        ("deactivate", "activate", False),
    ):
        mech, part = sample(kind)
        add_events(mech, create_action(first, part), create_action(second, part))
        outcome = run(mech)
        if isinstance(outcome, str):
            assert part.name in outcome
            continue
        if outcome.status.kind == "ok":
            assert [record.name for record in outcome.event_records] == ["event 0", "event 1"]
            configuration = outcome.trajectory.intervals[-1].configuration
            assert (part.name in configuration.inactive) == is_inactive
