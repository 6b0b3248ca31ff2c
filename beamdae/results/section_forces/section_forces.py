"""Section forces N, Q and M of a beam: stresses, envelopes, safety factors and diagrams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae import deferred
from beamdae.beams.beam import Beam
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, require_positive, warn_user
from beamdae.read_only import read_only_data
from beamdae.results.columns import FACTOR
from beamdae.results.displays import HasTable, Plot

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray
_Sample = Callable[[Array, Array, Array], Array]

SECTION_FORCE_HEADERS = {"N": "N [N]", "Q": "Q [N]", "M": "M [N m]"}
_ARC_LENGTH = "s [m]"
# Places between two rows or two sections at which section forces are compared with their extremes.
_SHARES_BETWEEN = np.array([0.25, 0.5, 0.75])
# Estimated error above which `SectionForces.safety` issues a warning, relative to the stress.
_MAX_UNREPORTED_STRESS_ERROR = 0.1
# Stress, including its error, below which this warning is omitted, relative to the yield stress;
# beams without loads have section forces by rounding.
_NEGLIGIBLE_UTILIZATION = 1e-6


@dataclass(frozen=True)
class Safety:
    """Smallest safety factor of a beam against yielding, with its time and position.

    Attributes
    ----------
    factor
        Yield stress divided by the equivalent stress [-]; infinite if the stress is zero.
    stress
        Von Mises equivalent stress [Pa].
    yield_stress
        Yield stress [Pa] passed to `SectionForces.safety`; by default, `Material.yield_stress`.
    t
        Time [s].
    s
        Arc length [m].
    where
        Point of the section: "top", "bottom" or "axis".
    error
        Error of the largest stress at this point [Pa], see `SectionForces.error`, including peaks
        between the times and, if the sections are the default ones, between them. Other sections
        may have larger errors: `lower_bound` covers all of them.
    lower_bound
        Lower bound of the safety factor [-]: the smallest ratio, over all sections, of the yield
        stress to the sum of the largest stress and its error. It may belong to another section than
        `stress`, where the error is larger.
    warning
        Warning if the error exceeds 10 % of the stress, otherwise None.
    """

    factor: float
    stress: float
    yield_stress: float
    t: float
    s: float
    where: str
    error: float
    lower_bound: float
    warning: str | None


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class SectionForces(HasTable):
    """Section forces of a beam: axial force N, shear force Q and bending moment M.

    N [N] and Q [N] are the components, normal and parallel to the deformed section, of the force
    that the beam beyond the section exerts on the beam before the section: N is positive in
    tension, and Q is positive to the left. M [N m] is positive if it stretches the left side of the
    beam.

    The section forces are in equilibrium with all loads on the beam before the section: joint
    reactions, concentrated and distributed forces, weight and inertia. N, Q and M therefore equal
    the reactions at the ends, jump at concentrated forces, and are accurate between nodes, unlike
    section forces computed from strains (`strained`).

    Attributes
    ----------
    beam
        The beam.
    t
        Times (k,) [s].
    s
        Arc lengths (l,) [m]. For a concentrated load that is fixed between the ends of the beam, or
        a jump of the cross-section or of the curvature of the axis at an element end, the default
        arc lengths contain the position twice, for the values before and beyond it.
    N, Q, M
        Section forces (k, l) [N, N, N m].
    strained
        N, Q and M computed from the strains (3, k, l) [N, N, N m], as in `Beam.section_forces`.
    before
        True for sections just before a load or a jump, False for those just beyond it (l,).
    represents_beam
        True if the sections are the default ones, False if they were requested.
    step_times
        Times of the steps of the run between these times [s], at most 10 000; none for equilibria.
    sample
        Function of ascending times [s], replaced by the ends of the run if they are outside, of arc
        lengths [m] and of `before` that returns N, Q and M (3, rows, sections). None after
        unpickling.
    refine
        Function that returns `sample` of the result with everything refined, or None without one.
    """

    beam: Beam
    t: Array
    s: Array
    N: Array
    Q: Array
    M: Array
    strained: Array
    before: Array
    represents_beam: bool
    step_times: Array
    sample: _Sample | None
    refine: Callable[[], _Sample | None] | None

    def __repr__(self) -> str:
        times, sections = self.N.shape
        return (
            f"<SectionForces of {self.beam.name}: {sections} sections at {times} times, "
            f"{self.t[0]:g} to {self.t[-1]:g} s>"
        )

    @property
    def error(self) -> Array:
        """Estimated errors of N, Q and M, (3, k, l) [N, N, N m].

        They are 1.15 times the differences from the result with everything refined, by which the
        `errors` of the result are measured: with finer meshes, exact strains and smaller steps.
        Stopped, resumed and loaded runs, and most cases of sweeps, have no such result: there, they
        are differences from `strained`, which contain neither the error of the strains nor that of
        the overall motion.
        """
        return FACTOR * np.abs(self._forces - self._repeated)

    @property
    def _forces(self) -> Array:
        return np.stack([self.N, self.Q, self.M])

    @cached_property
    def _repeated(self) -> Array:
        """More accurate N, Q and M, or those from the strains, (3, k, l); see `error`."""
        sample = None if self.refine is None else self.refine()
        return self.strained if sample is None else sample(self.t, self.s, self.before)

    @cached_property
    def sampling_error(self) -> Array:
        """Amounts by which N, Q and M exceed their extremes between the times `t`, (3,).

        The section forces are evaluated at the steps of the run, and between the times of the
        largest and the smallest N, Q and M and the adjacent times. The result is zero for a single
        time.
        """
        errors = self._measure_excess_near_extremes(between_sections=False)
        if self.sample is not None and len(self.step_times):
            steps = self.sample(self.step_times, self.s, self.before)
            for k, force in enumerate((self.N, self.Q, self.M)):
                errors[k] = max(errors[k], _excess(steps[k], force))
        return errors

    @cached_property
    def _peak_error(self) -> Array:
        """Amounts by which N, Q and M exceed their extremes between times and sections, (3,)."""
        if not self.represents_beam:
            return self.sampling_error
        between_sections = self._measure_excess_near_extremes(between_sections=True)
        return np.maximum(self.sampling_error, between_sections)

    def _measure_excess_near_extremes(self, between_sections: bool) -> Array:
        errors = np.zeros(3)
        if self.sample is None:
            return errors
        for k, force in enumerate((self.N, self.Q, self.M)):
            for extreme in (np.argmin(force), np.argmax(force)):
                row, section = divmod(int(extreme), len(self.s))
                times = _divide(self.t[max(row - 1, 0) : row + 2])
                s = self.s[section : section + 1]
                if between_sections:
                    s = _divide(self.s[max(section - 1, 0) : section + 2])
                sampled = self.sample(times, s, s >= self.beam.length)[k]
                errors[k] = max(errors[k], _excess(sampled, force))
        return errors

    def __getstate__(self) -> dict[str, Any]:
        # Functions contain whole runs.
        errors = {x: getattr(self, x) for x in ("sampling_error", "_peak_error", "_repeated")}
        return vars(self) | errors | {"sample": None, "refine": None}

    def table(self) -> pd.DataFrame:
        """Return N, Q, M and their estimated errors, one row per time and section."""
        import pandas as pd

        columns = dict(zip(SECTION_FORCE_HEADERS.values(), (self.N, self.Q, self.M), strict=True))
        columns |= {
            f"{name} error [{header.partition(' [')[2]}": error
            for (name, header), error in zip(SECTION_FORCE_HEADERS.items(), self.error, strict=True)
        }
        return pd.DataFrame(self._row_labels() | {k: x.ravel() for k, x in columns.items()})

    def _row_labels(self) -> dict[str, Array]:
        return {
            TIME: np.repeat(self.t, len(self.s)),
            _ARC_LENGTH: np.tile(self.s, len(self.t)),
        }

    @cached_property
    def _arc_lengths_by_side(self) -> list[float]:
        """Arc lengths [m], in the preceding element for sections just before a load or a jump."""
        return np.where(self.before, self.beam.mesh.just_before(self.s), self.s).tolist()

    @cached_property
    def _sections(self) -> list[Any]:
        return [self.beam.section.at(s) for s in self._arc_lengths_by_side]

    def _section_values(self, name: str) -> Array:
        return np.array([getattr(section, name) for section in self._sections], float)

    def stress(self, offset: float | str) -> pd.DataFrame:
        """Return the stresses at a distance from the axis, one row per time and section.

        The longitudinal stress is sigma = N / A + M l / I. The lever l is the offset in straight
        beams; with an initial curvature, it follows from the hyperbolic distribution of Winkler and
        Bach, see `Section.stress_lever`. The shear stress tau is the maximum over the section,
        `Section.shear_peak` Q / A, which occurs on the axis.

        The beams themselves do not follow the theory of Winkler and Bach: their strains result from
        N = EA eps11 and M = EI kappa11 (Pan & Liu 2012, eq. 21) with the stiffness of a straight
        beam, which is 0.15 (h / R)^2 too low for a rectangle of height h and radius of curvature R.
        In statically determinate beams, this affects deflections, not stresses; in a ring under two
        opposite forces, the largest moment differs by h^2 / (12 R^2), which is 2 % at R = 2 h.
        Radial stresses, the effect of curvature on the shear stress, and the distortion of thin
        flanges are neglected.

        Parameters
        ----------
        offset
            Distance from the axis [m], positive to the left, or "top" or "bottom".

        Returns
        -------
        pandas.DataFrame
            Time [s], arc length [m], sigma, tau and the estimated error of sigma [Pa].

        Raises
        ------
        BeamdaeError
            If `offset` is invalid or outside a section, is "top" or "bottom" and a section does not
            define its height, or a section reaches the center of curvature.
        """
        import pandas as pd

        sigma, other = (self._sigma(x, offset) for x in (self._forces, self._repeated))
        columns = {"sigma [Pa]": sigma, "tau [Pa]": self._tau(self.Q)}
        columns["sigma error [Pa]"] = FACTOR * np.abs(sigma - other)
        return pd.DataFrame(self._row_labels() | {k: x.ravel() for k, x in columns.items()})

    def _sigma(self, forces: Array, offset: float | str) -> Array:
        """Return longitudinal stresses by N, Q and M (3, k, l), (k, l) [Pa]."""
        axial, _, moment = forces
        return axial / self._section_values("area") + moment * self._bending_factors(offset)

    def _sigma_peak_error(self, offset: float | str, peak_error: Array) -> Array:
        """Return errors of longitudinal stresses due to errors of N, Q and M, (l,) [Pa]."""
        axial, _, moment = peak_error
        return axial / self._section_values("area") + moment * np.abs(self._bending_factors(offset))

    def _bending_factors(self, offset: float | str) -> Array:
        """Return the longitudinal stress per bending moment, (l,) [1/m^3]."""
        levers = np.array([self.beam.stress_lever(s, offset) for s in self._arc_lengths_by_side])
        return levers / self._section_values("second_moment")

    def _tau(self, shear_forces: Array) -> Array:
        """Return the largest shear stresses [Pa] due to shear forces (..., l)."""
        factors = self._section_values("shear_peak") / self._section_values("area")
        return shear_forces * factors

    def envelope(self) -> pd.DataFrame:
        """Return minima and maxima of N, Q and M over time, one row per section.

        Each extreme has an estimated error and a time. The error is the sum of its difference in
        the refined result, see `error`, and of `sampling_error`.

        If all sections define their height and do not reach the center of curvature, the table
        includes the longitudinal stress at the top and the bottom.
        """
        import pandas as pd

        ours, others, peak_errors = self._forces, self._repeated, self.sampling_error
        rows_of = zip(ours, others, peak_errors, strict=True)
        quantities = dict(zip(SECTION_FORCE_HEADERS.values(), rows_of, strict=True))
        try:
            stresses = {
                x: (
                    self._sigma(ours, x),
                    self._sigma(others, x),
                    self._sigma_peak_error(x, peak_errors),
                )
                for x in ("top", "bottom")
            }
        except BeamdaeError:
            stresses = {}  # not defined for these sections
        quantities |= {f"sigma {x} [Pa]": values for x, values in stresses.items()}
        columns: dict[str, Array] = {_ARC_LENGTH: self.s}
        sections = np.arange(len(self.s))
        for header, (rows, other_rows, peak_error) in quantities.items():
            name, _, unit = header.partition(" [")
            for word, find in (("min", np.argmin), ("max", np.argmax)):
                row, other_row = find(rows, axis=0), find(other_rows, axis=0)
                extreme, other = rows[row, sections], other_rows[other_row, sections]
                columns[f"{name} {word} [{unit}"] = extreme
                errors = FACTOR * np.abs(extreme - other) + peak_error
                columns[f"{name} {word} error [{unit}"] = errors
                columns[f"t of {name} {word} [s]"] = self.t[row]
        return pd.DataFrame(columns)

    def safety(self, yield_stress: float | None = None) -> Safety:
        """Return the smallest safety factor against yielding over all times and sections.

        The von Mises equivalent stress is |sigma| at the top and the bottom, and
        sqrt(sigma^2 + 3 tau^2) on the axis. Its error is that of the largest stress of a section:
        its difference in the refined result, see `error`, and peaks between the times and between
        default sections. After sudden loads, waves
        that no mesh resolves increase peaks by 20 to 80 % of the jump, so that `Safety.factor` is
        too small; apply loads over the period of the shortest waves of interest, or set the damping
        of the section. A `BeamdaeWarning` is issued if the error exceeds 10 % of the stress.

        Parameters
        ----------
        yield_stress
            Yield stress [Pa]. Defaults to `Material.yield_stress`.

        Returns
        -------
        Safety
            The factor, with the stress [Pa], the time [s] and the arc length [m] at which it
            occurs, the estimated error of the stress, and a lower bound of the factor.

        Raises
        ------
        BeamdaeError
            If neither the argument nor the material defines a yield stress, `yield_stress` is not
            positive, or a section does not define its height.
        """
        name = self.beam.name
        if yield_stress is not None:
            yield_stresses = np.full(
                len(self.s), require_positive(name, "yield_stress", yield_stress)
            )
        else:
            of_materials = [section.material.yield_stress for section in self._sections]
            if None in of_materials:
                raise BeamdaeError(
                    f"{name}: the material has no yield_stress; set "
                    "Material(yield_stress=) or pass safety(yield_stress=)."
                )
            yield_stresses = np.array(of_materials, float)
        points = ("top", "bottom", "axis")
        stresses, bounds = map(np.stack, zip(*map(self._equivalent_stresses, points), strict=True))
        utilization = stresses / yield_stresses
        largest = np.unravel_index(np.argmax(utilization), utilization.shape)
        point, row, section = map(int, largest)
        stress, yielding = float(stresses[largest]), float(yield_stresses[section])
        bound = float(np.max(bounds / yield_stresses))
        warning = None
        error = float(bounds[point, section]) - stress
        limit = _MAX_UNREPORTED_STRESS_ERROR * stress
        if error > limit and stress + error > _NEGLIGIBLE_UTILIZATION * yielding:
            share = 100.0 * error / stress if stress else np.inf
            warning = (
                f"{name}: the stress {stress:.4g} Pa of the smallest safety factor, at t = "
                f"{self.t[row]:.4g} s, has an estimated error of {share:.0f} %; use accuracy= of "
                "the analysis, or more times t."
            )
            warn_user(warning)
        return Safety(
            factor=yielding / stress if stress > 0.0 else np.inf,
            stress=stress,
            yield_stress=yielding,
            t=float(self.t[row]),
            s=float(self.s[section]),
            where=points[point],
            error=error,
            lower_bound=1.0 / bound if bound > 0.0 else np.inf,
            warning=warning,
        )

    def _equivalent_stresses(self, point: str) -> tuple[Array, Array]:
        """Return equivalent stresses at a point of the sections, (k, l), and upper bounds, (l,).

        The bounds are the largest stresses over time with their errors [Pa].
        """
        offset: float | str = 0.0 if point == "axis" else point
        # Shear stresses vanish at the surfaces; on the axis, they count sqrt(3) times.
        shear, peaks = np.sqrt(3.0) if point == "axis" else 0.0, self._peak_error
        stresses, others = (
            np.hypot(self._sigma(x, offset), shear * self._tau(x[1]))
            for x in (self._forces, self._repeated)
        )
        largest = stresses.max(axis=0)
        error = FACTOR * np.abs(others.max(axis=0) - largest)
        between = np.hypot(self._sigma_peak_error(offset, peaks), shear * self._tau(peaks[1]))
        return stresses, largest + error + between

    def diagram(self, what: str = "M", t: float | None = None) -> Plot:
        """Plot N, Q or M over the arc length, at one time or as an envelope.

        At one time, the line is the section force in equilibrium with the loads, the dots are
        computed from the strains, and the gray band is the estimated error. The light gray bands of
        an envelope are the estimated errors of the extremes.

        Parameters
        ----------
        what
            The section force: "N", "Q" or "M".
        t
            Time [s]; the nearest available time is used. Defaults to the envelope over all times
            if there are several times.

        Returns
        -------
        Plot
            The figure, displayed by a notebook; `Plot.save` writes it to a file.

        Raises
        ------
        BeamdaeError
            If `what` is invalid, or `t` is too far from the nearest available time.
        """
        return deferred.module("report.pictures.analysis_plots").plot_section_diagram(self, what, t)


def _excess(values: Array, others: Array) -> float:
    """Return the amount by which values exceed the extremes of others; negative if they do not."""
    return float(max(values.max() - others.max(), others.min() - values.min()))


def _divide(x: Array) -> Array:
    """Return ascending numbers and the places between them."""
    return np.unique(
        np.concatenate([x, (x[:-1, None] + np.diff(x)[:, None] * _SHARES_BETWEEN).ravel()])
    )
