"""Section forces N, Q and M of a beam: stresses, envelopes, safety factors and diagrams."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, require_positive
from beamdae.read_only import read_only_data
from beamdae.results.displays import Plot, load_views

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

SECTION_FORCE_HEADERS = {"N": "N [N]", "Q": "Q [N]", "M": "M [N m]"}
_ARC_LENGTH = "s [m]"


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
    """

    factor: float
    stress: float
    yield_stress: float
    t: float
    s: float
    where: str


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class SectionForces:
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
        Arc lengths (l,) [m]. For a concentrated load that is fixed between the ends of the beam,
        the default arc lengths contain its position twice, for the section forces before and beyond
        the load.
    N, Q, M
        Section forces (k, l) [N, N, N m].
    strained
        N, Q and M computed from the strains (3, k, l) [N, N, N m], as in `Beam.section_forces`.
    """

    beam: Beam
    t: Array
    s: Array
    N: Array
    Q: Array
    M: Array
    strained: Array

    def __repr__(self) -> str:
        times, sections = self.N.shape
        return (
            f"<SectionForces of {self.beam.name}: {sections} sections at {times} times, "
            f"{self.t[0]:g} to {self.t[-1]:g} s>"
        )

    @cached_property
    def error(self) -> Array:
        """Estimated errors of N, Q and M, (3, k, l) [N, N, N m]: differences from `strained`.

        The estimate covers the errors of the mesh, the integrator and the moderate-rotation
        assumption of a floating frame. It excludes errors of the overall motion, for example due to
        a coarse mesh, and the forces of `RayleighDamping`, which do not appear in the strains.
        Asymptotically, the estimate equals the error of `strained`, of order 3; the error of N, Q
        and M is of order 5 to 6 and much smaller. For a hub-mounted beam with 2, 4 and 8 elements
        of any formulation, the error of M is 1.9e-3, 4e-5 and 7e-7 of the largest M, and the
        estimate is 1.3e-2, 1.6e-3 and 2e-4 (tests/results/test_section_forces.py).
        """
        return np.abs(np.stack([self.N, self.Q, self.M]) - self.strained)

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
    def _sections(self) -> list[Any]:
        return [self.beam.section.at(s) for s in self.s.tolist()]

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
        In statically determinate beams, this affects deflections, not stresses. Radial stresses,
        the effect of curvature on the shear stress, and the distortion of thin flanges are
        neglected.

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

        sigma, error = self._sigma(offset)
        columns = {"sigma [Pa]": sigma, "tau [Pa]": self._tau, "sigma error [Pa]": error}
        return pd.DataFrame(self._row_labels() | {k: x.ravel() for k, x in columns.items()})

    def _sigma(self, offset: float | str) -> tuple[Array, Array]:
        lever = np.array([self.beam.stress_lever(s, offset) for s in self.s.tolist()])
        area, bending = self._section_values("area"), lever / self._section_values("second_moment")
        error = self.error[0] / area + self.error[2] * np.abs(bending)
        return self.N / area + self.M * bending, error

    @cached_property
    def _tau(self) -> Array:
        return self._section_values("shear_peak") * self.Q / self._section_values("area")

    def envelope(self) -> pd.DataFrame:
        """Return minima and maxima of N, Q and M over time, and their times, one row per section.

        If all sections define their height, the table includes the longitudinal stress at the top
        and the bottom.
        """
        import pandas as pd

        columns: dict[str, Array] = {_ARC_LENGTH: self.s}
        values = dict(zip(SECTION_FORCE_HEADERS.values(), (self.N, self.Q, self.M), strict=True))
        if all(section.height is not None for section in self._sections):
            values |= {f"sigma {x} [Pa]": self._sigma(x)[0] for x in ("top", "bottom")}
        for header, rows in values.items():
            name, _, unit = header.partition(" [")
            for word, extreme in (("min", rows.argmin(axis=0)), ("max", rows.argmax(axis=0))):
                columns[f"{name} {word} [{unit}"] = rows[extreme, np.arange(len(self.s))]
                columns[f"t of {name} {word} [s]"] = self.t[extreme]
        return pd.DataFrame(columns)

    def safety(self, yield_stress: float | None = None) -> Safety:
        """Return the smallest safety factor against yielding over all times and sections.

        The von Mises equivalent stress is |sigma| at the top and the bottom, and
        sqrt(sigma^2 + 3 tau^2) on the axis.

        Parameters
        ----------
        yield_stress
            Yield stress [Pa]. Defaults to `Material.yield_stress`.

        Returns
        -------
        Safety
            The factor, with the stress [Pa], the time [s] and the arc length [m] at which it
            occurs.

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
        axis = np.hypot(self._sigma(0.0)[0], np.sqrt(3.0) * self._tau)
        equivalent = {x: np.abs(self._sigma(x)[0]) for x in ("top", "bottom")} | {"axis": axis}
        utilization = np.stack([stress / yield_stresses for stress in equivalent.values()])
        largest = np.unravel_index(np.argmax(utilization), utilization.shape)
        point, row, section = map(int, largest)
        where, ratio = list(equivalent)[point], float(utilization[largest])
        return Safety(
            factor=1.0 / ratio if ratio > 0.0 else np.inf,
            stress=float(equivalent[where][row, section]),
            yield_stress=float(yield_stresses[section]),
            t=float(self.t[row]),
            s=float(self.s[section]),
            where=where,
        )

    def diagram(self, what: str = "M", t: float | None = None) -> Plot:
        """Plot N, Q or M over the arc length, at one time or as an envelope.

        At one time, the line is the section force in equilibrium with the loads, the dots are
        computed from the strains, and the gray band is the estimated error.

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
        return load_views().plot_section_forces(self, what, t)
