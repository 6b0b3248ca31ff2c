"""Beam variants, small models, and equations of motion as numpy functions, for the tests."""

import itertools
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import pytest

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.formulations.sums import InputLayout, assemble_reactions
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.integrators.ida import ida as stepper
from beamdae.native.object_code import is_native_enabled
from beamdae.sundials import UnavailableError
from beamdae.symbolic.sums.kernel_sums import evaluate_sum

compiled = pytest.mark.skipif(not is_native_enabled(), reason="without machine code")
# Stiffness, mass and damping of order one, so that finite differences have eight correct digits.
SOFT_MATERIAL = bd.Material(E=60.0, nu=0.3, rho=1.3)


class Variant(NamedTuple):
    """Settings of a beam element."""

    strain: str
    shape: str
    quadrature: str
    frame: str
    damping: float
    continuity: str = "cartesian"
    nodes: int = 4
    formulation: str = "floating frame"

    @property
    def section(self):
        return bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05, damping=self.damping)

    def beam(self, curve, elements=2, section=None, name="beam", **more):
        of_floating_frame = {"strain": self.strain, "continuity": self.continuity}
        return bd.Beam(
            name,
            curve,
            section or self.section,
            elements=elements,
            elements_shape=self.shape,
            nodes=self.nodes,
            quadrature=self.quadrature,
            frame=self.frame,
            formulation=self.formulation,
            **(of_floating_frame if self.formulation == "floating frame" else {}),
            **more,
        )

    def __str__(self):
        if self.formulation != "floating frame":
            return self.formulation
        damping = "damped" if self.damping else "undamped"
        shape = self.shape if self.continuity == "cartesian" else f"{self.shape}-local"
        nodes = "" if self.nodes == 4 else f"-{self.nodes}-nodes"
        return f"{self.strain}-{shape}-{self.quadrature}-{self.frame}-{damping}{nodes}"


VARIANTS = [
    Variant(*choice)
    for choice in itertools.product(
        ("nonlinear", "linear"),
        ("curved", "straight"),
        ("reduced", "full"),
        ("tangent", "chord"),
        (0.0, 0.03),
    )
]
# The continuity only changes the constant operator of the mesh, which the frames share.
VARIANTS += [
    Variant("nonlinear", "curved", "reduced", f, 0.03, "local") for f in ("tangent", "chord")
]
VARIANTS += [
    Variant(strain, "curved", "reduced", f, d)
    for strain in ("green", "exact")
    for f, d in (("tangent", 0.0), ("chord", 0.03))
]
# Elements with fewer nodes have shorter sums of the same terms; some other settings suffice.
VARIANTS += [
    Variant("nonlinear", "curved", "reduced", "tangent", 0.03, nodes=3),
    Variant("nonlinear", "curved", "full", "chord", 0.03, nodes=3),
    Variant("nonlinear", "straight", "reduced", "chord", 0.0, nodes=3),
    Variant("linear", "curved", "reduced", "tangent", 0.0, nodes=3),
    Variant("green", "curved", "reduced", "tangent", 0.0, nodes=3),
    Variant("nonlinear", "straight", "reduced", "chord", 0.03, nodes=2),
    Variant("nonlinear", "straight", "full", "tangent", 0.03, nodes=2),
    Variant("linear", "straight", "reduced", "tangent", 0.0, nodes=2),
]
# Every second variant of the full product: the others contain each combination of any four of the
# five settings.
_SLOW_VARIANTS = {v for k, v in enumerate(VARIANTS[:32]) if k.bit_count() % 2}
# For tests of assembled equations, their forms and the start. These depend on an element only
# through the size of its kernel and the operator of its mesh; the kernels are tested with all
# variants. These variants differ in all settings that determine size and operator (shape, frame,
# continuity, nodes), and contain every strain, quadrature and damping.
EXACT_VARIANT = Variant("exact", "curved", "reduced", "tangent", 0.03, formulation="exact")
REPRESENTATIVE_VARIANTS = [
    Variant("nonlinear", "curved", "reduced", "tangent", 0.03),
    Variant("linear", "straight", "full", "chord", 0.0),
    Variant("nonlinear", "curved", "reduced", "chord", 0.03, "local"),
    Variant("green", "curved", "reduced", "tangent", 0.0, nodes=3),
    EXACT_VARIANT,
]
# One variant per dependence of the section motion on the coordinates, which strain, quadrature and
# damping do not affect.
MOTION_VARIANTS = list({(v.shape, v.frame, v.continuity, v.nodes): v for v in VARIANTS}.values())
ARC = bd.Arc(radius=1.6, length=2.0, start=(0.3, -0.2), angle=0.4)
# Two elements of different lengths that end at none of the points to which tests attach loads.
UNEVEN_ELEMENTS = (0.0, 0.8, ARC.length)


def parametrize_variants(variants, slow=_SLOW_VARIANTS):
    """Parametrize a test by `variant`; the variants in `slow` are marked as slow tests."""
    return pytest.mark.parametrize(
        "variant",
        [
            pytest.param(v, marks=[pytest.mark.slow(reason="several runs")] if v in slow else [])
            for v in variants
        ],
        ids=str,
    )


class NumericEquations:
    """Equations of motion of a mechanism as functions of numpy arrays."""

    def __init__(self, mechanism, time=(0.0, 0.0)):
        self.mechanism = mechanism
        self.equations = bd.equations_of_motion(mechanism)
        self.time = np.array(time, float)
        self.n, self.m = self.equations.n, self.equations.m

    @cached_property
    def _evaluator(self):
        return StateEvaluator(self.equations)

    def _complete(self, q, v, a, lam, time):
        """Return [time, q, v, a, lam]; q defaults to the start, v, a and lam to zero."""
        values = [self.time if time is None else time, self.equations.q0 if q is None else q]
        values += [np.zeros(self.n) if x is None else x for x in (v, a)]
        values += [np.zeros(self.m) if lam is None else lam]
        return [np.asarray(x, float) for x in values]

    def force(self, q=None, v=None, a=None, lam=None, time=None):
        """Return the generalized forces F, (n,)."""
        return self._evaluator.force(*self._complete(q, v, a, lam, time)[:4])

    def _force_jacobian(self, c, q, v, a, lam, time):
        inputs = self._complete(q, v, a, lam, time)[:4]
        return self._evaluator.force_matrix(*inputs, c).toarray()

    def stiffness(self, q=None, v=None, a=None, lam=None, time=None):
        """Return the stiffness matrix dF/dq, (n, n)."""
        return self._force_jacobian((1.0, 0.0, 0.0), q, v, a, lam, time)

    def damping(self, q=None, v=None, a=None, lam=None, time=None):
        """Return the damping matrix dF/dv, (n, n)."""
        return self._force_jacobian((0.0, 1.0, 0.0), q, v, a, lam, time)

    def mass(self, q=None, v=None, a=None, lam=None, time=None):
        """Return the mass matrix dF/da, (n, n)."""
        return self._force_jacobian((0.0, 0.0, 1.0), q, v, a, lam, time)

    def _balance(self, q=None, v=None, a=None, lam=None, time=None):
        """Return energies, powers and norms at a state, see `measures.plan_balance`."""
        inputs = self._complete(q, v, a, lam, time)
        return measures.BalanceRows(self.equations)(*(x[None] for x in inputs))[0]

    def energies(self, *state, **more):
        """Return (kinetic, strain, gravity) energy, power of the loads and dissipated power."""
        return self._balance(*state, **more)[[0, 1, 2, 3, 5]]

    def driver_power(self, *state, **more):
        """Return the power of the drivers."""
        return self._balance(*state, **more)[4]

    @property
    def levels(self):
        """Functions of g, g_dot and g_ddot."""
        return [partial(self._level, k) for k in range(3)]

    def _level(self, k, q=None, v=None, a=None, lam=None, time=None):
        return self._evaluator.constraint_levels(*self._complete(q, v, a, lam, time)[:4])[k]

    def constraint_matrix(self, q=None, v=None, a=None, lam=None, time=None):
        """Return G = dg/dq, (m, n)."""
        inputs = self._complete(q, v, a, lam, time)
        return ConsistencySolver(self.equations).constraint_matrix(*inputs[:2]).toarray()

    def reaction(self, q=None, v=None, a=None, lam=None, time=None):
        """Return the generalized reactions G^T lam, (n,)."""
        time, q, _, _, lam = self._complete(q, v, a, lam, time)
        plan = assemble_reactions(self.equations.structure, InputLayout(q=0, lam=self.n)).vector()
        total, result = plan.sum(False, self.equations.p), np.zeros(self.n)
        total.shared[:] = time
        evaluate_sum(total, np.concatenate([q, lam]), result)
        return result

    def _observed(self, q=None, v=None, a=None, lam=None, time=None):
        inputs = self._complete(q, v, a, lam, time)
        return measures.ObservedRows(self.equations)(*(x[None] for x in inputs))[0]

    def observed(self, name, **state):
        """Return the columns of one observable."""
        first = 0
        values = self._observed(**state)
        for observable in self.equations.observables:
            count = len(observable.columns)
            if observable.name == name:
                return values[first : first + count]
            first += count
        raise KeyError(name)

    def index(self, name):
        return self.equations.q_names.index(name)


def directional_derivative(function, x, direction, step=1e-3):
    """Return the derivative of `function` at `x` along `direction`, by five points.

    It is exact for polynomials of degree four, such as the strain energy.
    """
    far, near = (
        np.asarray(function(x + k * step * direction)) - function(x - k * step * direction)
        for k in (2, 1)
    )
    return (8.0 * near - far) / (12.0 * step)


def finite_differences(function, x):
    """Return the Jacobian (or gradient) of `function` at `x`, one column per variable."""
    return np.stack([directional_derivative(function, x, d) for d in np.eye(len(x))], axis=-1)


def assert_derivative(jacobian, function, x, seed=0):
    """Assert that `jacobian` is that of `function` at `x`, along three random directions.

    The finite differences have a truncation error of step^4 / 30 = 3e-14 and a rounding error of
    1e-16 / step = 1e-13, relative to the terms of a row; 1e-9 allows for cancellation.
    """
    rng = np.random.default_rng(seed)
    for direction in rng.standard_normal((3, len(x))):
        terms = np.abs(jacobian) @ np.abs(direction)
        error = np.abs(jacobian @ direction - directional_derivative(function, x, direction))
        worst = int(np.argmax(error / (terms + 1.0)))
        assert error[worst] <= 1e-9 * (terms[worst] + 1.0), f"row {worst}: off by {error[worst]:g}"


def free_beam(variant, curve=ARC, elements=2, gravity=(0.0, 0.0), section=None):
    """Return a mechanism of one beam without joints."""
    mech = bd.Mechanism(gravity=gravity)
    mech.add(variant.beam(curve, elements, section))
    return mech


def random_state(numeric, seed, size=0.15):
    """Return coordinates near the drawing, and velocities and accelerations of order one."""
    rng = np.random.default_rng(seed)
    q = numeric.equations.q0 + size * rng.standard_normal(numeric.n)
    return q, rng.standard_normal(numeric.n), rng.standard_normal(numeric.n)


def use_scikit_sundae(monkeypatch):
    """Make Ida use scikit-sundae's class, as on machines where its libraries cannot be loaded."""

    def unavailable(*arguments):
        raise UnavailableError("the libraries cannot be loaded")

    monkeypatch.setattr(stepper, "CompiledIda", unavailable)


def differences_of_runs(model, name, rtol, step=1e-3):
    """Return the derivative of each last value of runs, by the differences of four runs."""
    value = model.parameters[name]
    runs = [
        bd.simulate(model(**{name: value * (1.0 + k * step)}), bd.Radau(rtol=rtol))
        for k in (-2, -1, 1, 2)
    ]
    weights = np.array([1 / 12, -2 / 3, 2 / 3, -1 / 12]) / (step * value)
    return {column: weights @ [x.columns[column][-1] for x in runs] for column in runs[0].columns}
