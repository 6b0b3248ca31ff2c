"""Every argument of every public call is accepted or rejected with one clear message."""

import math
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from itertools import product

import casadi as ca
import numpy as np
import pytest
from mechanisms import EARTH
from robustness.inputs.bad_input import BAD_VALUES
from robustness.inputs.catalog import USER_BASE_CLASSES, public_name_of
from robustness.inputs.model_calls import (
    MECHANISM_CALLS,
    NUMBER_CALLS,
    PART_CALLS,
    SYSTEM_CALLS,
    VARIANT_CALLS,
)
from robustness.inputs.run_calls import CONTROL_CALLS, INTEGRATOR_CALLS
from robustness.inputs.sandbox import Sandbox
from robustness.judge import check_sentence

import beamdae as bd

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
STRIP = bd.Section.rectangle(STEEL, width=0.02, height=0.001)
ARC = bd.Arc(radius=1.0, length=1.0)
BEAM = bd.Beam("beam", ARC, STRIP, elements=1)
DISK = bd.RigidBody("disk", mass=1.0, inertia=0.1)
GROUND = bd.Mechanism().ground
T, Q, V = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
LAM = ca.SX.sym("lam")
SYSTEM = {"t": T, "q": Q, "v": V, "mass": [1, 1], "force": [0, 0], "q0": [0, 0], "v0": [0, 0]}


def disk_mechanism():
    mech = bd.Mechanism()
    mech.add(DISK)
    return mech


def failing(*args, **kwargs):
    raise ZeroDivisionError


# Readers of files take long.
OTHERS = {"table_from_csv"}
# Calls that build something, without a run of it.
CALLS = {
    name: replace(call, use=None)
    for calls in (PART_CALLS, VARIANT_CALLS, NUMBER_CALLS, MECHANISM_CALLS, SYSTEM_CALLS)
    for name, call in (calls | INTEGRATOR_CALLS | CONTROL_CALLS).items()
    if public_name_of(name) not in USER_BASE_CLASSES | OTHERS
}
# Not every argument of these is used, or has a check before the analysis.
CHECKED_LATER = {"EquilibriumValue", "EquilibriumErrors", "CriticalLoad", "ConstrainedSystem"}


def require_sentence(text):
    assert check_sentence(text) == ""


@pytest.mark.parametrize("name", CALLS)
def test_every_value_of_every_argument_is_accepted_or_rejected_with_one_sentence(name):
    call, rejected = CALLS[name], Counter()
    arguments = {*call.arguments(Sandbox())}
    for argument, value in product(arguments, BAD_VALUES.values()):
        sandbox = Sandbox()
        try:
            call.make(name, sandbox, call.arguments(sandbox) | {argument: value(sandbox)})
        except bd.BeamdaeError as problem:
            rejected[argument] += 1
            require_sentence(str(problem))
    # Most of the values are invalid in place of any argument.
    accepting = {x for x in arguments if rejected[x] < 0.7 * len(BAD_VALUES)}
    assert public_name_of(name) in CHECKED_LATER or not accepting


# Numbers, points and names ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "value", [{1, 2}, {1: 0, 2: 0}, "12", (x for x in (1, 2)), (1, 2, 3), ((1, 2), (3, 4)), b"12"]
)
def test_regression_unordered_values_are_rejected_as_points(value):
    with pytest.raises(bd.BeamdaeError, match="disk: center"):
        bd.RigidBody("disk", 1.0, 1.0, center=value)


@pytest.mark.parametrize("value", [(1, 2), [1, 2], np.array([1, 2]), range(1, 3)])
def test_points_are_stored_as_floats(value):
    body = bd.RigidBody("disk", np.array(2.0), Fraction(1, 2), center=value)
    assert (body.mass, body.inertia, body.center) == (2.0, 0.5, (1.0, 2.0))
    assert type(body.mass) is type(body.inertia) is float


@pytest.mark.parametrize(
    "name",
    [
        "a" * 101,
        "a\nb",
        "a\0b",
        "a\tb",
        "=SUM(A1)",
        "+a",
        "-a",
        "@a",
        "a [m]",
        " a",
        "a ",
        "a\u202e",
    ],
)
def test_names_that_break_a_table_are_rejected(name):
    for make in (
        lambda: bd.RigidBody(name, 1.0, 1.0),
        lambda: disk_mechanism().observe(name, DISK.at(0.0, 0.0)),
        lambda: bd.ConstrainedSystem(**SYSTEM, names=("x", name)),
        lambda: bd.ConstrainedSystem(**SYSTEM, observe={f"{name} [m]": T}),
    ):
        with pytest.raises(bd.BeamdaeError, match="a name must"):
            make()


@pytest.mark.parametrize("name", ["a" * 100, "gauge 1", "mid-point", "at 0.5", "Ventil ä", "a=b"])
def test_ordinary_names_are_accepted(name):
    assert bd.RigidBody(name, 1.0, 1.0).name == name


# Meaningless mechanics -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: bd.Force("push", GROUND.at(0, 0), (1.0, 0.0)),
            "push: ground at .* belongs to the ground",
        ),
        (
            lambda: bd.Moment("push", GROUND.at(0, 0), 1.0),
            "push: ground at .* belongs to the ground",
        ),
        (
            lambda: bd.PointMass("m", 1.0, on=GROUND.at(0, 0)),
            "m: ground at .* belongs to the ground",
        ),
        (
            lambda: BEAM.strain(0.5, offset=0.0006),
            "offset must lie within half the height of the section .0.0005 m., got",
        ),
        (lambda: BEAM.strain(0.5, offset=-1.0), "offset must lie within half the height"),
        (lambda: bd.Curve(abs, x=(-1, 1)), "a kink, a jump, .* near x = "),
        (lambda: bd.Curve(lambda x: 0.05 * abs(x - 0.123), x=(-1, 1)), "a kink.* x = 0.12"),
        (lambda: bd.Curve(lambda x: abs(x) ** 1.5, x=(-1, 1)), "a kink, a jump, .* near x = "),
        (lambda: bd.Parabola(1.0, 1e6), "Parabola: the curve folds onto itself"),
        (lambda: bd.Section(bd.Material(1e75, 0, 1), 1, 1e-40).EI, None),
        (lambda: bd.Section.circle(STEEL, 1e74), "Section: area must not exceed 1e"),
        (lambda: bd.Section.rectangle(STEEL, 1e-30, 1e-30), "Section: second_moment must be at"),
        (lambda: bd.Section(bd.Material(1e-75, 0, 1), 1.0, 1e-75), None),
        (lambda: bd.Beam("b", bd.Arc, STRIP), "b: curve must be a Line, Arc.* got <class"),
        (lambda: bd.Beam("b", ARC, STRIP, kinematics=str), "kinematics must be a function of"),
    ],
)
def test_meaningless_mechanics_is_rejected(make, message):
    if message is None:
        make()
        return
    with pytest.raises(bd.BeamdaeError, match=message) as problem:
        make()
    require_sentence(str(problem.value))


@pytest.mark.parametrize("f", [np.sin, lambda x: x * abs(x), lambda x: 0.05 * np.sin(30 * x)])
def test_curves_with_a_tangent_everywhere_are_accepted(f):
    assert bd.Curve(f, x=(-1.0, 1.0)).length > 2.0


def test_a_joint_of_a_removed_body_is_rejected_with_the_name_of_the_body():
    mech = bd.Mechanism()
    disk, bob = mech.add(DISK), mech.add(bd.PointMass("bob", 1.0, at=(0.0, 0.0)))
    mech.add(bd.Revolute("pin", disk.at(0.0, 0.0), bob.point))
    del mech.parts["bob"]
    with pytest.raises(bd.BeamdaeError, match="'bob'"):
        bd.equations_of_motion(mech)


class FailingPart(bd.Part):
    name = "own"

    def forces(self, gravity):
        return ca.SX.sym("x", 2) + ca.SX.sym("y", 3)


def test_the_error_of_a_failing_user_part_names_the_part():
    mech = disk_mechanism()
    mech.add(FailingPart())
    with pytest.raises(bd.BeamdaeError, match=r"own: forces\(\) failed: RuntimeError: sha"):
        bd.equations_of_motion(mech)


@pytest.mark.parametrize("kinematics", [failing, lambda q: q, lambda: 1])
def test_the_error_of_failing_kinematics_names_the_attachment(kinematics):
    place = DISK.at(1.0, 0.0)
    attachment = bd.results.Attachment(DISK, (1.0, 0.0), 0.0, place.operator, kinematics)
    mech = disk_mechanism()
    mech.add(bd.Force("push", attachment, (1.0, 0.0)))
    with pytest.raises(bd.BeamdaeError, match=r"disk at \(1, 0\): kinematics must") as problem:
        bd.equations_of_motion(mech)
    require_sentence(str(problem.value))


# Constrained systems -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q0": "x"}, "q0 must have length 2 and finite entries, got 'x'"),
        ({"q0": [0, 10**400]}, "q0 must be finite, got 1000"),
        ({"names": 1}, "names must be a list of 2 strings, got 1"),
        ({"names": ("x",)}, "names must have length 2, got length 1"),
        ({"units": ("m", 10**400)}, "units must be strings such as 'm' and 'rad', got 1000"),
        (
            {"mass": [[1, 0], [1]]},
            "mass must consist of numbers and SX expressions .* equal length",
        ),
        ({"mass": ca.SX.zeros(2, 3)}, r"mass must have shape \(2, 2\), got \(2, 3\)"),
        ({"force": ca.MX.sym("f", 2)}, "force must consist of numbers and SX expressions"),
        ({"force": [0.0, ca.SX.sym("q_1")]}, "force must depend only on t, q and v, not on q_1"),
        ({"t": 2 * T}, "t must be a CasADi symbol, a column"),
        ({"v": Q}, "t, q and v must be different symbols"),
        ({"v": ca.MX.sym("v", 2)}, "t, q and v must be all SX or all MX symbols"),
        ({"breakpoints": 1.0}, "breakpoints must be a list of times, got 1.0"),
        ({"observe": {3: T}}, "the name must be a non-empty string, got 3"),
        ({"observe": {"x []": T}}, "units must be strings such as 'm' and 'rad', got ''"),
        ({"observe": {"x [deg]": T}}, "angles must be in 'rad', got 'deg'"),
        ({"observe": {"x [m]": T, "x [s]": T}}, "names must be unique, got q0, q1, x, x"),
        ({"observe": {"lam": LAM}}, "lam must depend only on t, q and v, not on lam"),
        ({"lam": LAM}, "lam must have size 0, the number of constraints, got size 1"),
        ({"constraints": {"rod [N]": V[0]}}, "constraints must not depend on v"),
        (
            {"constraints": {"a": Q, "a0": Q[0]}},
            "constraints must be unique, but some are repeated: a0",
        ),
        ({"constraints": {"rod": "x"}}, "the constraint rod must consist of numbers"),
        ({"parameters": {"m": 1.0}}, r"parameters must be a dict from symbols .* got {'m': 1.0}"),
        ({"parameters": {ca.SX.sym("m"): "x"}}, "the parameter m must be a number, got 'x'"),
        ({"parameters": {T: 1.0}}, "t, q, v and parameters must be different symbols"),
        (
            {"parameters": {ca.SX.sym("m"): 1.0}, "force": [ca.SX.sym("k"), 0]},
            "force must depend only on t, q, v and parameters, not on k",
        ),
        ({"strain_energy": Q}, r"strain_energy must have shape \(1, 1\), got \(2, 1\)"),
        ({"gravity_energy": V[0]}, "gravity_energy must depend only on t and q, not on v_0"),
    ],
)
def test_errors_in_constrained_systems_are_reported_by_beamdae_and_not_by_casadi(change, message):
    with pytest.raises(bd.BeamdaeError, match=f"^ConstrainedSystem: {message}") as problem:
        _ = bd.ConstrainedSystem(**(SYSTEM | change)).equations
    require_sentence(str(problem.value))
    assert problem.value.__cause__ is None


def test_an_empty_list_of_constraints_is_accepted():
    system = bd.ConstrainedSystem(**SYSTEM, constraints=[])
    assert system.equations.m == 0


def test_expressions_that_sx_cannot_expand_are_rejected():
    t, q, v = ca.MX.sym("t"), ca.MX.sym("q", 1), ca.MX.sym("v", 1)
    matrix = ca.vertcat(ca.horzcat(2.0 + t, 1.0), ca.horzcat(1.0, 3.0))
    solution = ca.solve(matrix, ca.vertcat(1.0, t))[0]
    arguments = {"t": t, "q": q, "v": v, "mass": [1.0], "q0": [0.0], "v0": [0.0]}
    with pytest.raises(bd.BeamdaeError, match="force uses a function that SX cannot expand"):
        _ = bd.ConstrainedSystem(**arguments, force=solution).equations


# Laws --------------------------------------------------------------------------------------------


def jump(t):
    if t > 1.0:
        return 1.0
    return 0.0


def raises_key_error(t):
    raise KeyError("x")


def converts_to_float(t):
    return 1.0 if float(t) > 0.2 else 0.0


FORMULAS_MESSAGE = (
    r"without branches on t \(if, .*\), float, int, .* numpy functions .* bd.table .* bd.piecewise"
)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (jump, f"the law jump must be a formula in t, {FORMULAS_MESSAGE}"),
        (lambda t: t > 1 and 3.0, FORMULAS_MESSAGE),
        (lambda t: max(t, 1.0), FORMULAS_MESSAGE),
        (math.sin, f"the law sin .*{FORMULAS_MESSAGE}"),
        (lambda t: math.sin(t), FORMULAS_MESSAGE),
        (int, FORMULAS_MESSAGE),
        (lambda t: np.where((t > 1.0) & (t < 2.0), np.sin(t), 0.0), FORMULAS_MESSAGE),
        (lambda t: np.where(t < 1.0, 0.0, t), "must be smooth, but uses <, np.where;"),
        (converts_to_float, f"the law converts_to_float .*{FORMULAS_MESSAGE}"),
        (lambda t: np.random.default_rng().random(), FORMULAS_MESSAGE),
        (lambda t: np.polyval([1.0, 2.0], t), FORMULAS_MESSAGE),
        (raises_key_error, "the law raises_key_error must .* failed at t = 0 s: KeyError: 'x'"),
        (lambda t: t[3], "failed at t = 0 s: TypeError"),
        (lambda t: ca.SX.sym("x", 2) + ca.SX.sym("y", 3), "of CasADi expressions do not match"),
        (lambda t: [t], r"the law must return one number, got \[SX"),
        (lambda t: np.array([1.0]), "the law must return one number, got array"),
        (lambda t: True, "the law must return one number, got True"),
        (lambda t: ca.MX.sym("x"), r"the law must return one number, got MX\(x\)"),
        (lambda t: ca.SX.sym("t_0"), "the law must depend only on t, not on t_0"),
        (lambda t: 1e300, r"the law at t = 0 s must not exceed 1e\+75"),
        (lambda t: round(t), FORMULAS_MESSAGE),
    ],
)
def test_the_error_of_a_law_that_is_not_a_formula_gives_the_reason(law, message):
    with pytest.raises(bd.BeamdaeError, match=f"^twist: .*{message}") as problem:
        bd.Moment("twist", DISK.at(0.0, 0.0), law)
    require_sentence(str(problem.value))


@pytest.mark.parametrize(
    "law",
    [
        Fraction(1, 3),
        lambda t: Fraction(1, 3),
        lambda t: np.array(t),
        lambda t: math.pi * t,
        lambda t: ca.sin(t),
        lambda t: np.sqrt(1.0 - t),
        lambda t: 1.0 / (t + 1e-3),
        lambda t: np.sin(1e6 * t) * np.exp(-t),
        ca.Function("f", [T], [T**2]),
    ],
)
def test_formulas_and_numbers_are_accepted_as_laws(law):
    assert len(bd.Moment("twist", DISK.at(0.0, 0.0), law).laws) == 1


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: bd.verify(None), "verify: solution must be a Solution of a run, got None."),
        (lambda s: s.to_csv(3), "to_csv: path must be the path of a file, got 3."),
        (lambda s: s.to_csv("a\0b"), "to_csv: path must be the path of a file, got 'a\\x00b'."),
        (lambda s: bd.simulate(s.equations, t_end=1.0, progress=3), "simulate: progress must be"),
        (
            lambda s: bd.simulate(s.equations, t_end=1.0, progress=lambda: None),
            "simulate: progress must be a function that accepts 1 argument",
        ),
        (lambda s: bd.compare(np.array(1.0)), "compare: cases must be a list of at least one"),
        (lambda s: bd.grid(mass=ca.MX.sym("x")), "grid: mass must be a list of values"),
        (lambda s: bd.results.Model(3, 1.0, {}), "model: build must be a function, got 3."),
    ],
)
def test_wrong_arguments_of_functions_of_runs_are_rejected(call, words):
    mech = bd.Mechanism(gravity=EARTH)
    mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    solution = bd.simulate(mech, bd.GeneralizedAlpha(step=0.01), 0.02)
    with pytest.raises(bd.BeamdaeError) as problem:
        call(solution)
    assert str(problem.value).startswith(words)
