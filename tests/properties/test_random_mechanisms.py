"""Random mechanisms satisfy the laws of mechanics, independently of how they are drawn."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import HealthCheck, Phase, given, note, settings
from hypothesis import strategies as st
from properties.drawings import BUILDERS
from properties.equilibrium_laws import EQUILIBRIUM_LAWS
from properties.random_drawings import draw_mechanism
from properties.run_laws import RUN_LAWS
from properties.state_laws import STATE_LAWS, build_unless_contradictory

import beamdae as bd

LAWS = STATE_LAWS | EQUILIBRIUM_LAWS | RUN_LAWS
# Half of the drawings are rejected: they are contradictory, fall without end, or lock.
SETTINGS = {"suppress_health_check": list(HealthCheck), "database": None}


def check_law(name, data):
    """Check one random drawing by the law `name`."""
    law, options = LAWS[name]
    rng = data.draw(st.randoms(use_true_random=False))
    drawing = draw_mechanism(rng, **options)
    note(repr(drawing))
    build_unless_contradictory(drawing.mechanism)
    law(drawing, rng)


# The first example is always one bar.
@pytest.mark.parametrize("name", STATE_LAWS)
@settings(max_examples=2, **SETTINGS)
@given(data=st.data())
def test_state_law(name, data):
    check_law(name, data)


@pytest.mark.slow(reason="many examples")
# The first example is always one bar.
@pytest.mark.parametrize("name", STATE_LAWS)
@settings(max_examples=25, **SETTINGS)
@given(data=st.data())
def test_state_law_with_many_examples(name, data):
    check_law(name, data)


@pytest.mark.slow(reason="runs, and paths of equilibria, of many examples")
@pytest.mark.parametrize("name", EQUILIBRIUM_LAWS | RUN_LAWS)
@settings(max_examples=5, phases=[Phase.generate], **SETTINGS)
@given(data=st.data())
def test_equilibrium_and_run_laws(name, data):
    check_law(name, data)


def test_drawings_cover_every_part():
    """Spring, Damper and TorsionDamper are special cases of parts that are drawn."""
    public = {getattr(bd, name) for name in dir(bd)}
    parts = {x for x in public if isinstance(x, type) and issubclass(x, bd.Part)}
    kinds, covered = set(), {bd.Part, bd.Joint, bd.Spring, bd.Damper, bd.TorsionDamper}
    # They have no place in the plane and exert no forces, so that there is nothing to draw.
    covered |= {bd.State, bd.Controller}
    expected = {*BUILDERS, "bar", "disk", "beam", "particle"}
    for seed in range(400):
        drawing = draw_mechanism(Random(seed))
        drawing_kinds = {piece.kind for piece in (*drawing.bodies, *drawing.pieces)}
        if not drawing_kinds <= kinds:
            kinds |= drawing_kinds
            covered |= {type(part) for part in drawing.mechanism().parts.values()}
        if kinds == expected:
            break
    assert kinds == expected
    assert covered >= parts
