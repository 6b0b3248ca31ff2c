"""Trajectory of a run: accepted steps with dense output."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.equations_of_motion import Configuration, EquationsOfMotion, State
from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    require_finite,
    warn_user,
)
from beamdae.read_only import read_only, read_only_data
from beamdae.symbolic.sparse_operators import assemble_csr

Array = np.ndarray

# Degrees of the interpolating polynomials. With degree 4, interpolated values of BDF up to order 5
# are as accurate as the values at the steps. A vibration that alternates from step to step is
# amplified by 2.2 between the steps (1.6 with degree 3, 3.1 with degree 5).
_DEGREE_OF_MOTION = 4  # for q and v
_DEGREE_OF_REACTIONS = 3  # for a and lam, which may jump from step to step
# Times whose weights are computed together, so that their factors stay in the processor caches.
_MAX_TIMES_AT_ONCE = 10_000
# Largest Legendre coefficient of the highest degree, relative to the range at the nodes, of smooth
# components of a and lam. Jumps have 0.05 to 0.5, vibrations of at most 2 rad between these nodes
# less than 0.04.
_MAX_LEADING_SHARE = 0.04


@read_only_data
@dataclass(frozen=True)
class StepRecord:
    """Energies at all nodes of an interval that stores only some of its steps.

    Attributes
    ----------
    nodes
        Times of all nodes (k,) [s], see `Interval.nodes`.
    values
        Energies, powers and norms at the nodes (k, 11), see `measures.plan_balance`.
    nodes_per_step
        Number of nodes per step.
    """

    nodes: Array
    values: Array
    nodes_per_step: int


class StateWeights(NamedTuple):
    """Weights (times, nodes) of the states at the nodes of an interval in interpolated states.

    Attributes
    ----------
    positions, positions_by_velocities
        Weights of q and of v in q.
    velocities
        Weights of v in v.
    reactions
        Weights of a in a, and of lam in lam.
    """

    positions: sp.csr_array
    positions_by_velocities: sp.csr_array
    velocities: sp.csr_array
    reactions: sp.csr_array


@read_only_data
@dataclass(frozen=True)
class Interval:
    """Accepted steps between two breakpoints or events, with dense output.

    For multistep methods and one-step methods without stages, the dense output within a step is the
    Lagrange polynomial through the states at the end of the step and at the preceding steps
    (Hairer, Norsett & Wanner, Solving ODEs I, 1993, section III.6), of degree 4 for q and v and
    degree 3 for a and lam. Near the start of an interval, it also passes through later states; in
    short intervals, its degree is lower. For methods with stages, the dense output is the
    collocation polynomial through the start of the step and its stages, the last of which is the
    end of the step (Hairer & Wanner, Solving ODEs II, 1996, section IV.8); q is the integral of v,
    one degree higher, with a linear correction that matches q at the end of the step.

    If forces such as dry friction jump within a step, a and lam jump, and polynomials through them
    overshoot. In the results of runs, components whose Legendre coefficient of the highest degree
    exceeds 4 % of their range at the nodes of the polynomial do not leave this range.

    Hermite interpolation is not used: with the step size h, the terms h v and h^2 a contain modes
    that the step does not resolve, and stiff sections would amplify these modes to spurious forces
    far larger than the forces at the steps. For the same reason, observed forces of beams and
    springs are interpolated themselves (`results.run_data`).

    The first state of an interval is consistent with the laws, but fast modes have not yet
    responded to the laws of this interval. The polynomials therefore exclude the first state,
    except before the second node and in intervals with too few nodes.

    At the samples of a controller, a step of length zero leads from the state before the jump of
    held inputs to the state after the jump. Polynomials use only nodes between two jumps.

    Long runs store only some of their steps (`integrators.step_thinning`). Nodes are then the start
    and the end of the interval, the output times and times between them, at which the dense output
    of all steps was evaluated; the polynomials pass through these nodes.

    Attributes
    ----------
    nodes
        Ascending times (k,) [s]: the start of the interval and, for each step, its end or, for
        methods with stages, its stages. All nodes of a step of length zero have the same time.
    rows
        States at the nodes: q (k, n), v (k, n), a (k, n) and lam (k, m).
    branch
        Time inside the interval [s], by which piecewise laws select their piece.
    nodes_per_step
        Number of nodes per step: 1 for methods without stages, otherwise the number of stages.
    configuration
        The active parts. None if `EquationsOfMotion.configurations` is None.
    record
        Energies at all steps if `nodes` contain only some of them; otherwise None.
    """

    nodes: Array
    rows: State
    branch: float
    nodes_per_step: int = 1
    configuration: Configuration | None = None
    record: StepRecord | None = None

    @cached_property
    def t(self) -> Array:
        """Start of the interval and ends of its steps, (steps + 1,) [s]."""
        return self.nodes[:: self.nodes_per_step]

    @cached_property
    def state(self) -> State:
        """States at the times `t`."""
        return State(*(x[:: self.nodes_per_step] for x in self.rows))

    @property
    def inactive(self) -> frozenset[str]:
        """Names of the inactive parts."""
        return frozenset() if self.configuration is None else self.configuration.inactive

    def active_equations(self, whole: EquationsOfMotion) -> EquationsOfMotion:
        """Return the equations of the active parts, given those of all parts."""
        return whole if self.configuration is None else self.configuration.equations

    @property
    def grid(self) -> Interval:
        """Interval with the nodes of all steps, but without states if only some are stored."""
        # Not cached: an interval that refers to itself would stay in memory until the next garbage
        # collection.
        return self if self.record is None else self._grid_of_record

    @cached_property
    def _grid_of_record(self) -> Interval:
        assert self.record is not None
        empty = State(*(np.zeros((len(self.record.nodes), 0)) for _ in self.rows))
        nodes, nodes_per_step = self.record.nodes, self.record.nodes_per_step
        return Interval(nodes, empty, self.branch, nodes_per_step, self.configuration)

    @cached_property
    def step_count(self) -> int:
        """Number of steps, without those of length zero."""
        return int(np.count_nonzero(np.diff(self.t)))

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        """First and last node of each piece between two jumps."""
        (jumps,) = np.nonzero(np.diff(self.t) == 0.0)
        first, last = jumps * self.nodes_per_step, len(self.nodes) - 1
        return np.append(0, first + self.nodes_per_step), np.append(first, last)

    @property
    def times(self) -> Array:
        """Rows (t, branch) of the nodes, (k, 2): the time argument of compiled functions."""
        return self.with_branch(self.nodes)

    def with_branch(self, t: Array) -> Array:
        """Return the rows (t, branch) of times inside the interval (j,) [s]."""
        return _with_branch(t, self.branch)

    def find_steps(self, t: Array) -> Array | None:
        """Return the index in `t` of this interval of each time (j,), or None if one is no step."""
        step = np.minimum(np.searchsorted(self.t, t), len(self.t) - 1)
        return step if np.array_equal(self.t[step], t) else None

    def at(self, t: Array, limited: bool = False) -> State:
        """Return the states at times (j,) [s] inside the interval, one row per time.

        If `limited`, a and lam do not overshoot beside jumps; then, they are no linear functions of
        the states at the nodes.
        """
        if self.nodes_per_step == 1 and np.array_equal(t, self.nodes):
            # Not copied: long runs may store output rows only.
            return self.rows
        step = self.find_steps(t)
        if step is not None:
            # The polynomials pass through the steps.
            return State(*(x[step * self.nodes_per_step] for x in self.rows))
        q, v, a, lam = self.rows
        motion, reaction = self._state_weights(t)
        positions = motion @ q if self.nodes_per_step == 1 else self.positions_at(t)
        reactions = [reaction @ a, reaction @ lam]
        if limited:
            self._limit_overshoot(reaction, reactions, [a, lam])
        return State(positions, motion @ v, *reactions)

    def interpolate_forces(self, values: Array, t: Array) -> Array:
        """Interpolate quantities at times inside the interval like `limited` a and lam of `at`.

        Parameters
        ----------
        values
            Values of c quantities at the nodes, (k, c).
        t
            Times inside the interval (j,) [s].

        Returns
        -------
        ndarray
            Values at the times, (j, c).
        """
        step = self.find_steps(t)
        if step is not None:
            return values[step * self.nodes_per_step]
        weights = self._weights_of_degree(t, _DEGREE_OF_REACTIONS)
        result = weights @ values
        self._limit_overshoot(weights, [result], [values])
        return result

    def force_weights_at(self, t: Array) -> tuple[Array, sp.csr_array]:
        """Return the nodes that `interpolate_forces` uses at times (j,) [s], and their weights.

        The weights (j, nodes) are those without limits of the overshoot beside jumps.
        """
        step = self.find_steps(t)
        if step is None:
            weights = self._weights_of_degree(t, _DEGREE_OF_REACTIONS)
        else:
            shape = (len(t), len(self.nodes))
            indices = step * self.nodes_per_step
            weights = assemble_csr(np.ones(len(t)), indices, np.arange(len(t) + 1), shape)
        nodes = np.flatnonzero(np.bincount(weights.indices, minlength=len(self.nodes)))
        return nodes, weights[:, nodes]

    def force_rates_at(self, values: Array, t: Array) -> Array:
        """Return the time derivatives of `interpolate_forces`, without limits beside jumps."""
        node = _preceding_node(self.nodes, t)
        return self._lagrange_weights(t, node, _DEGREE_OF_REACTIONS, derivative=True) @ values

    def _limit_overshoot(
        self, weights: sp.csr_array, interpolated: Sequence[Array], values: Sequence[Array]
    ) -> None:
        """Remove the overshoot of polynomials of a and lam beside jumps.

        Parameters
        ----------
        weights
            Lagrange weights (j, k) of the nodes at the times.
        interpolated
            Values of polynomials at j times (j, c), which are changed.
        values
            Their values at the nodes (k, c).
        """
        if self._degree(_DEGREE_OF_REACTIONS) < _DEGREE_OF_REACTIONS or not weights.shape[0]:
            return
        through = weights.indices.reshape(weights.shape[0], -1).T
        # Times of the same step have the same polynomials.
        is_first = np.append(True, np.any(np.diff(through, axis=1), axis=0))
        polynomial, through = np.cumsum(is_first) - 1, through[:, is_first]
        x = self.nodes[through]
        degree = len(x) - 1
        distances = x[:, None] - x + np.eye(len(x))[..., None]
        # Short pieces have polynomials of lower degree, which repeat a node.
        is_complete = np.all(np.diff(x, axis=0) > 0.0, axis=0)
        divisors = np.where(is_complete, np.prod(distances, axis=1), np.inf)
        # Legendre coefficients of the highest degree, relative to their limit.
        by_node = (x[-1] - x[0]) ** degree / (_MAX_LEADING_SHARE * comb(2 * degree, degree))
        by_node = (by_node / divisors)[..., None]

        for polynomials, at_nodes in zip(interpolated, values, strict=True):
            at_node = at_nodes[through[0]]
            leading, low, high = by_node[0] * at_node, at_node, at_node
            for node, factor in zip(through[1:], by_node[1:], strict=True):
                at_node = at_nodes[node]
                leading += factor * at_node
                low, high = np.minimum(low, at_node), np.maximum(high, at_node)
            jumps = np.abs(leading) > high - low
            if jumps.any():
                rows, columns = np.nonzero(jumps[polynomial])
                ends = (x[polynomial[rows], columns] for x in (low, high))
                polynomials[rows, columns] = np.clip(polynomials[rows, columns], *ends)

    def positions_at(self, t: Array, coordinates: Sequence[int] | slice | None = None) -> Array:
        """Return the coordinates q of `at` (j, n), or only some of them."""
        columns = slice(None) if coordinates is None else coordinates
        q = self.rows.q[:, columns]
        if self.nodes_per_step == 1:
            if np.array_equal(t, self.nodes):
                return q
            step = self.find_steps(t)
            # The polynomials pass through the steps.
            return self.interpolate(q, t) if step is None else q[step]
        by_q, by_v = self._position_weights(t)
        return by_q @ q + by_v @ self.rows.v[:, columns]

    def derivative_at(self, t: Array) -> State:
        """Return the exact time derivatives of the polynomials of `at` at times (j,) [s].

        The fields of the result are q', v', a' and lam'. At a node, the derivative is that of the
        step that ends there.
        """
        q, v, a, lam = self.rows
        node = _preceding_node(self.nodes, t)
        motion = self._lagrange_weights(t, node, _DEGREE_OF_MOTION, derivative=True)
        reaction = self._lagrange_weights(t, node, _DEGREE_OF_REACTIONS, derivative=True)
        if self.nodes_per_step == 1:
            rates = motion @ q
        else:
            step = _preceding_node(self.t, t)
            # Slope of the linear correction by which `positions_at` matches q at the steps.
            change = np.diff(q[:: self.nodes_per_step], axis=0)
            durations = np.diff(self.t)[:, None]
            slopes = (change - self._integrate_steps(v)) / np.where(durations > 0, durations, 1.0)
            rates = self.interpolate(v, t) + slopes[step]
        return State(rates, motion @ v, reaction @ a, reaction @ lam)

    def weights_at(self, t: Array) -> StateWeights:
        """Return the weights of the nodes in the states of `at` at times (j,) [s]."""
        motion, reaction = self._state_weights(t)
        if self.nodes_per_step == 1:
            return StateWeights(motion, sp.csr_array(motion.shape), motion, reaction)
        return StateWeights(*self._position_weights(t), motion, reaction)

    def _state_weights(self, t: Array) -> tuple[sp.csr_array, sp.csr_array]:
        """Return the Lagrange weights of v, and of a and lam, at times (j,) [s]."""
        motion = self._weights_of_degree(t, _DEGREE_OF_MOTION)
        if self._degree(_DEGREE_OF_REACTIONS) == self._degree(_DEGREE_OF_MOTION):
            return motion, motion
        return motion, self._weights_of_degree(t, _DEGREE_OF_REACTIONS)

    def _weights_of_degree(self, t: Array, degree: int) -> sp.csr_array:
        """Return the Lagrange weights (j, k) of the nodes at times (j,) [s]."""
        return self._lagrange_weights(t, _preceding_node(self.nodes, t), degree)

    def interpolate(self, values: Array, t: Array) -> Array:
        """Interpolate quantities at times inside the interval with the polynomials of v.

        Parameters
        ----------
        values
            Values of c quantities at the nodes, (k, c).
        t
            Times inside the interval (j,) [s].

        Returns
        -------
        ndarray
            Values at the times, (j, c).
        """
        return self._weights_of_degree(t, _DEGREE_OF_MOTION) @ values

    def integrate_to_steps(self, rates: Array) -> Array:
        """Integrate rates from the start of the interval to each of its steps.

        The rates are interpolated like a and lam, with degree 3 for methods without stages. For
        Radau IIA with three stages, the result equals the quadrature of the method, with the
        weights (16 - sqrt 6)/36, (16 + sqrt 6)/36 and 1/9 of the stages, relative to the step.

        Parameters
        ----------
        rates
            Values of c rates at the nodes, (k, c).

        Returns
        -------
        ndarray
            Integrals (steps + 1, c) at the times `t`; the first row is zero.
        """
        integrals = np.zeros((len(self.t), rates.shape[1]))
        np.cumsum(self._integrate_steps(rates), axis=0, out=integrals[1:])
        return integrals

    def integrate_to(self, t: Array, rates: Array, to_steps: Array) -> Array:
        """Integrate rates from the start of the interval to times inside the interval.

        Parameters
        ----------
        t
            Times inside the interval (j,) [s].
        rates
            Values of c rates at the nodes, (k, c).
        to_steps
            Result of `integrate_to_steps` for these rates.

        Returns
        -------
        ndarray
            Integrals at the times, (j, c).
        """
        step = _preceding_node(self.t, t)
        return to_steps[step] + self._integration_weights(t, step) @ rates

    def _integrate_steps(self, rates: Array) -> Array:
        """Integrate rates over each step."""
        integrals = np.empty((len(self.t) - 1, rates.shape[1]))
        # The weights of all steps of a long run would take more memory than its states.
        for k in range(0, len(integrals), _MAX_TIMES_AT_ONCE):
            step = np.arange(k, min(k + _MAX_TIMES_AT_ONCE, len(integrals)))
            integrals[step] = self._integration_weights(self.t[step + 1], step) @ rates
        return integrals

    def _integration_weights(self, t: Array, step: Array) -> sp.csr_array:
        """Return the weights (len(t), k) of the nodes in integrals from the start of the step.

        `step` is the index of the step that contains each time.
        """
        node, start = step * self.nodes_per_step, self.t[step]
        half = 0.5 * (t - start)
        # Gauss points that integrate polynomials of this degree exactly.
        degree = max(self.nodes_per_step, _DEGREE_OF_REACTIONS)
        points, weights = gauss_points(degree // 2 + 1)
        times = (start + (1.0 + x) * half for x in points)
        at_points = self._lagrange_weights(
            np.concatenate(list(times)), np.tile(node, len(points)), _DEGREE_OF_REACTIONS
        )
        # All points of a time have the same nodes.
        ends = at_points.indptr[: len(t) + 1]
        half = np.repeat(half, np.diff(ends))
        terms = at_points.data.reshape(len(points), -1)
        data = weights[0] * half * terms[0]
        for weight, term in zip(weights[1:], terms[1:], strict=True):
            data += weight * half * term
        shape = (len(t), len(self.nodes))
        return assemble_csr(data, at_points.indices[: ends[-1]], ends, shape)

    def _position_weights(self, t: Array) -> tuple[sp.csr_array, sp.csr_array]:
        """Return the weights (j, k) of q and of v at the nodes in the positions at times (j,).

        Positions are the integral of v, with a linear correction that matches q at the steps.
        """
        step, shape = _preceding_node(self.t, t), (len(t), len(self.nodes))
        start, end = self.t[step], self.t[step + 1]
        x = (t - start) / (end - start)
        # All times of a step have the same nodes.
        width = self._degree(_DEGREE_OF_REACTIONS) + 1
        weights = self._integration_weights(np.append(t, end), np.append(step, step))
        to_times, to_ends = np.split(weights.data, 2)
        by_v = assemble_csr(
            to_times - np.repeat(x, width) * to_ends,
            weights.indices[: len(to_times)],
            weights.indptr[: len(t) + 1],
            shape,
        )
        pairs = self.nodes_per_step * np.stack([step, step + 1], axis=1)
        shares, starts = np.stack([1.0 - x, x], axis=1), np.arange(0, 2 * len(t) + 1, 2)
        return assemble_csr(shares.ravel(), pairs.ravel(), starts, shape), by_v

    def _degree(self, degree: int) -> int:
        """Return the degree of polynomials: that of the stages, or at most `degree` without."""
        return min(degree if self.nodes_per_step == 1 else self.nodes_per_step, len(self.nodes) - 1)

    def _lagrange_weights(
        self, t: Array, node: Array, degree: int, derivative: bool = False
    ) -> sp.csr_array:
        """Return the Lagrange weights (len(t), k) of the nodes at the times `t`.

        `node` contains, for each time, the index of an earlier node: the start of the step or one
        of its stages. If `derivative` is True, the weights are differentiated with respect to t.
        """
        if len(t) > _MAX_TIMES_AT_ONCE:
            blocks = (
                slice(k, k + _MAX_TIMES_AT_ONCE) for k in range(0, len(t), _MAX_TIMES_AT_ONCE)
            )
            parts = [self._lagrange_weights(t[x], node[x], degree, derivative) for x in blocks]
            return sp.csr_array(sp.vstack(parts, format="csr"))
        degree = self._degree(degree)
        begins, lasts = self._pieces
        piece = np.searchsorted(begins, node, side="right") - 1
        begin, last = begins[piece], (lasts - begins)[piece]
        node, degrees = node - begin, np.minimum(degree, last)
        end = (node // self.nodes_per_step + 1) * self.nodes_per_step
        least = np.minimum(node, 1)
        first = begin + np.minimum(np.maximum(end - degrees, least), last - degrees)
        order = np.arange(degree + 1)[:, None]
        # Short pieces have polynomials of lower degree: further nodes have no weight.
        through, is_used = first + np.minimum(order, degrees), order <= degrees
        x = self.nodes[through]
        # Factors (t - x_j) / (x_k - x_j) of the weight of node k, (k, j, times).
        is_factor = is_used[:, None] & is_used & ~np.eye(degree + 1, dtype=bool)[..., None]
        distances = np.where(is_factor, x[:, None] - x, 1.0)
        factors = np.where(is_factor, t - x, 1.0) / distances
        if derivative:
            others = (np.delete(factors, j, axis=1).prod(axis=1) for j in order[:, 0])
            slopes = zip(others, is_factor.swapaxes(0, 1), distances.swapaxes(0, 1), strict=True)
            weights = np.sum([x * is_in / distance for x, is_in, distance in slopes], axis=0)
        else:
            weights = factors.prod(axis=1) * is_used
        ends = np.arange(len(t) + 1) * (degree + 1)
        shape = (len(t), len(self.nodes))
        return assemble_csr(weights.T.ravel(), through.T.ravel(), ends, shape)


def _preceding_node(nodes: Array, t: Array) -> Array:
    """Return the index of the last node before each time, or 0 at the first node."""
    return np.clip(np.searchsorted(nodes, t, side="left") - 1, 0, max(len(nodes) - 2, 0))


def _with_branch(t: Array, branch: float | Array) -> Array:
    return np.stack([t, np.broadcast_to(branch, np.shape(t))], axis=-1)


@read_only_data
@dataclass(frozen=True)
class Trajectory:
    """Accepted steps of a run, as consecutive intervals."""

    intervals: tuple[Interval, ...]

    @property
    def start(self) -> float:
        """First time of the run [s]."""
        return float(self.intervals[0].t[0])

    @property
    def end(self) -> float:
        """Last time of the run [s]."""
        return float(self.intervals[-1].t[-1])

    @property
    def steps(self) -> int:
        """Number of accepted steps."""
        return sum(interval.grid.step_count for interval in self.intervals)

    @property
    def stores_all_steps(self) -> bool:
        """True unless a long run has been reduced to some of its steps."""
        return all(interval.record is None for interval in self.intervals)

    @property
    def mean_step(self) -> float:
        """Mean length of the steps [s]; infinite without a step or a duration."""
        duration = self.end - self.start
        return duration / self.steps if self.steps and duration else np.inf

    @property
    def stored_bytes(self) -> int:
        """Memory of the stored states [bytes]."""
        return sum(x.nbytes for interval in self.intervals for x in interval.rows)

    def require_all_steps(self, caller: str) -> None:
        """Raise BeamdaeError if the run stores only some of its steps."""
        if not self.stores_all_steps:
            rows = sum(len(interval.nodes) for interval in self.intervals)
            raise BeamdaeError(
                f"{caller}: all steps are needed, but this long run stores {rows} rows of its "
                f"{self.steps} steps; run it with simulate(..., keep_steps=True)."
            )

    def warn_between_rows(self, caller: str, times: Array) -> None:
        """Warn if the run stores only some of its steps, and times lie between its rows."""
        index = self.interval_index(times)
        for k, interval in enumerate(self.intervals):
            if interval.record is None or np.isin(times[index == k], interval.nodes).all():
                continue
            warn_user(
                f"{caller}: this long run stores only some of its steps, and states between its "
                "rows are interpolated, without the vibrations between them; choose output times, "
                "or simulate(..., keep_steps=True)."
            )
            return

    def interval_index(self, times: Array) -> Array:
        """Return the index of the interval of each time; at a boundary, of the earlier interval."""
        if len(self.intervals) == 1:
            return np.zeros(len(times), int)
        starts = np.array([interval.t[0] for interval in self.intervals])
        return np.clip(np.searchsorted(starts, times, side="left") - 1, 0, None)

    def by_configuration(self, times: Array) -> Iterator[tuple[Configuration | None, Array]]:
        """Yield configurations with different active parts, and masks (k,) of their times (k,)."""
        configurations = [interval.configuration for interval in self.intervals]
        inactive = [interval.inactive for interval in self.intervals]
        if len(set(inactive)) == 1:
            yield configurations[0], np.ones(len(times), bool)
            return
        index = self.interval_index(times)
        for parts in dict.fromkeys(inactive[k] for k in np.unique(index).tolist()):
            here = np.array([x == parts for x in inactive])
            yield configurations[int(np.argmax(here))], here[index]

    def at(self, times: Array, limited: bool = False) -> tuple[Array, State]:
        """Return rows (t, branch), (k, 2), and the states at ascending times (k,) [s].

        See `Interval.at` for `limited`.
        """
        index = self.interval_index(times)
        parts = [x.at(times[index == k], limited) for k, x in enumerate(self.intervals)]
        state = parts[0]
        if len(parts) > 1:
            state = State(*(np.concatenate(x) for x in zip(*parts, strict=True)))
        return self.time_rows(times), state

    def time_rows(self, times: Array) -> Array:
        """Return rows (t, branch), (k, 2), for times (k,) [s]."""
        branches = np.array([interval.branch for interval in self.intervals])
        return _with_branch(times, branches[self.interval_index(times)])

    def derivative_at(self, times: Array) -> State:
        """Return the time derivatives of the states of `at`, see `Interval.derivative_at`.

        Raises
        ------
        BeamdaeError
            If the run stores only some of its steps.
        """
        self.require_all_steps("time derivatives of a run")
        index = self.interval_index(times)
        parts = [x.derivative_at(times[index == k]) for k, x in enumerate(self.intervals)]
        return State(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def positions_at(self, times: Array, coordinates: Sequence[int] | slice | None = None) -> Array:
        """Return the coordinates q (k, n), or only some of them, at ascending times (k,) [s]."""
        index = self.interval_index(times)
        parts = [
            x.positions_at(times[index == k], coordinates) for k, x in enumerate(self.intervals)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


class Instant(NamedTuple):
    """State of a run at one time, see `Solution.at`.

    Attributes
    ----------
    time
        (t, branch): the time t [s], and a time [s] inside the interval that contains t, which
        selects the active piece of piecewise laws.
    state
        Coordinates q (n,), velocities v (n,), accelerations a (n,) and multipliers lam (m,).
    configuration
        The active parts. None if `EquationsOfMotion.configurations` is None.
    doubt
        Reason why the state may be wrong. Empty if the state is reliable.
    """

    time: Array
    state: State
    configuration: Configuration | None = None
    doubt: str = ""

    @property
    def t(self) -> float:
        """Time of the state [s]."""
        return float(self.time[0])

    @classmethod
    def of(cls, trajectory: Trajectory, t: float) -> Instant:
        """Evaluate the dense output at a time [s].

        Raises
        ------
        BeamdaeError
            If the time is not a finite number or lies outside the run.
        """
        t = require_finite("Solution.at", "t", t)
        if not trajectory.start <= t <= trajectory.end:
            start, end, given = format_distinct(trajectory.start, trajectory.end, t)
            raise BeamdaeError(
                f"Solution.at: t must lie within the run, {start} to {end} s, got {given} s."
            )
        times = np.array([t])
        trajectory.warn_between_rows("Solution.at", times)
        rows, state = trajectory.at(times, limited=True)
        interval = trajectory.intervals[int(trajectory.interval_index(times)[0])]
        state = read_only(State(*(x[0] for x in state)))
        return cls(read_only(rows[0]), state, interval.configuration)
