"""Everything in the catalog satisfies the laws of mechanics, analyses and programs."""

from itertools import product
from random import Random

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, note, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from properties.catalog_analyses import ANALYSES, FRAMES, FUNCTIONS
from properties.catalog_models import ENTRIES, entry_model
from properties.catalog_runs import METHODS, ROWS, RUN_LAWS, difference, reference_run
from properties.drawings import BUILDERS, EXTERNAL_FORCES
from properties.random_drawings import ALL_KINDS, draw_mechanism
from properties.run_laws import RUN_LAWS as MOTIONS
from properties.state_laws import EQUILIBRIUM_LAWS, STATE_LAWS, build_unless_contradictory
from sample_parts import find_public

import beamdae as bd

# What the other names return, base classes, and what has no mechanics: files, pictures, texts.
NOT_SUBJECT = {
    *("Mechanism", "Part", "model", "param", "load_model", "Joint", "Integrator"),
    *("ConstrainedSystem", "equations_of_motion", "load", "plot", "export_fmu", "study", "Case"),
    *("grid", "compare", "verify", "BeamdaeError", "BeamdaeWarning", "Interrupted", "knock_down"),
    *("quantities", "results"),
}


def test_every_public_name_is_subject_to_laws():
    subject = {*ENTRIES, *ANALYSES, *METHODS, "sweep", "gradient", "rotation"}
    assert {*bd.__all__} - subject == NOT_SUBJECT, "add an entry of the new names to a table"


WITHOUT_PLACE = {bd.results.State, bd.Controller}
ALL, PHASES = list(HealthCheck), [Phase.explicit, Phase.generate]
MOTION_LAWS = EQUILIBRIUM_LAWS | MOTIONS
# Kinds of parts that cannot be part of a free mechanism, or of one without external actions.
OUTSIDE = {"momentum": {*EXTERNAL_FORCES}, "ground": {*EXTERNAL_FORCES} - {"skate"}}

SLOW = pytest.mark.slow(reason="several mechanisms or runs")


def every(names, laws, default):
    """Parametrize a test by (law, name); only those of one law are default tests."""
    pairs = [(law, name) for name in names for law in laws]
    return pytest.mark.parametrize(
        ("law", "name"), [pytest.param(*x, marks=[] if x[0] == default else SLOW) for x in pairs]
    )


def random_examples(count):
    """Draw seeds of mechanisms; many of these are rejected, since they contradict or lock."""
    check = settings(max_examples=count, phases=PHASES, suppress_health_check=ALL, database=None)
    return lambda test: check(given(seed=st.integers(0, 2**32))(test))


def check_drawing(check, options, seed, containing=""):
    rng = Random(seed)
    drawing = draw_mechanism(rng, containing=containing, **options)
    note(repr(drawing))
    build_unless_contradictory(drawing.mechanism)
    check(drawing, rng)


@every(ALL_KINDS, STATE_LAWS, default="energy")
@random_examples(2)
def test_random_mechanisms_with_every_kind(law, name, seed):
    """Balance of energy and momentum, and invariance under motion, mirror, units and order."""
    if name not in OUTSIDE.get(law, ()):
        check_drawing(*STATE_LAWS[law], seed, name)


@pytest.mark.slow(reason="runs, and paths of equilibria, of many examples")
@pytest.mark.parametrize("law", MOTION_LAWS)
@random_examples(3)
def test_motions_and_equilibria_of_random_mechanisms(law, seed):
    check_drawing(*MOTION_LAWS[law], seed)


def test_drawings_cover_every_part():
    parts = {x for x in (find_public(name) for name in ENTRIES) if isinstance(x, type)}
    missing = {x for x in parts if issubclass(x, bd.Part)}
    for seed, kind in product(range(9), BUILDERS):
        if missing != WITHOUT_PLACE:
            mech = draw_mechanism(Random(seed), containing=kind).mechanism()
            missing -= {type(part) for part in mech.parts.values()}
    assert missing == WITHOUT_PLACE


@every(ENTRIES, RUN_LAWS, default="storage")
def test_runs_of_every_entry(law, name):
    RUN_LAWS[law](name)


# The data of a fit end with the run.
UNITS_OF_TIME = {"fit": ("mirrored", "mm, g")}


@pytest.mark.slow(reason="two or three analyses")
@pytest.mark.parametrize("name", ANALYSES)
def test_every_analysis_in_other_places_units_and_orders(name):
    drawn = ANALYSES[name]("drawn")
    for frame in UNITS_OF_TIME.get(name, ("mirrored", "all")):
        results = zip(drawn, ANALYSES[name](frame), strict=True)
        for (expected, unit), (actual, _) in results:
            values = np.asarray(actual, float) / FRAMES[frame].number(1.0, unit)
            size = np.max(np.abs(expected))
            assert_allclose(values, expected, rtol=0.0, atol=1e-6 * size, err_msg=frame)


@pytest.mark.slow(reason="four further analyses")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_of_every_analysis_are_differences(name):
    expected = difference(lambda x: np.asarray(FUNCTIONS[name](x), float))
    actual = np.asarray(ANALYSES[name]("drawn")[-1][0], float)
    assert_allclose(actual.ravel(), expected.ravel(), atol=1e-5 * np.max(np.abs(expected)))


@pytest.mark.slow(reason="starts processes")
def test_sweeps_have_the_numbers_of_runs_alone_in_any_order_and_process():
    names = [*ENTRIES][::12]
    for jobs, order in ((1, names), (2, names[::-1])):
        swept = bd.sweep(
            entry_model, {"entry": order}, integrator=bd.Radau(1e-8), output_step=ROWS, jobs=jobs
        )
        for name in names:
            alone = reference_run(name)
            assert np.array_equal(swept.run(entry=name)["tip.y"], alone["tip.y"]), name
