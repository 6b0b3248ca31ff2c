"""Section forces of a beam over a run: tables, stresses, envelopes, safety and diagrams."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.errors import BeamdaeError, require_positive
from beamdae.results.displays import Plot, load_views

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

FORCES = {"N": "N [N]", "Q": "Q [N]", "M": "M [N m]"}
_TIME, _PLACE = "t [s]", "s [m]"


@dataclass(frozen=True)
class Safety:
    """The place of a beam that is nearest to yielding over a run.

    Attributes
    ----------
    factor
        Yield stress over the equivalent stress.
    stress, yield_stress
        Equivalent stress of von Mises there, and what the material bears [Pa].
    t, s
        When [s], and at which arc length [m].
    where
        "top", "bottom" or "axis".
    """

    factor: float
    stress: float
    yield_stress: float
    t: float
    s: float
    where: str


@dataclass(frozen=True, eq=False, repr=False)
class SectionForces:
    """Section forces of a beam at sections and times: N along the section's direction, Q, and M.

    N and Q [N] are along the direction and the left normal of the deformed section, M [N m] is
    positive where it lengthens the left side. They balance everything that acts on the beam up to
    the section (joints, forces at sections and per length, weight and inertia), so that they are
    those of its ends' reactions there, jump where forces act, and are right between nodes where the
    derivatives of displacements, `strained`, are not.

    Attributes
    ----------
    beam
        The beam.
    t, s
        Times (k,) [s] and arc lengths (l,) [m]. Where a force acts at a section, its arc length
        comes twice: before it and beyond it.
    N, Q, M
        Rows of section forces, (k, l).
    strained
        The same from the strains (3, k, l), as `Beam.section_forces` observes them.
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
        """Estimated errors (3, k, l): how far N, Q and M are from those of the strains.

        It has what meshes, integrators and the moderate rotations of a floating frame are off by,
        not a motion that is wrong as a whole (a mesh too coarse for it), and what
        `RayleighDamping` bears, which strains do not know. Of the strains it is the error,
        asymptotically, of order 3; that of N, Q and M is of order 5 to 6 and smaller by far: on the
        hub beam with 2, 4 and 8 elements of any formulation M is off by 1.9e-3, 4e-5 and 7e-7 of
        its largest value, the estimate is 1.3e-2, 1.6e-3 and 2e-4
        (tests/results/test_section_forces.py).
        """
        return np.abs(np.stack([self.N, self.Q, self.M]) - self.strained)

    def table(self) -> pd.DataFrame:
        """One row a time and section: N, Q, M and their errors, with units."""
        import pandas as pd

        columns = dict(zip(FORCES.values(), (self.N, self.Q, self.M), strict=True))
        columns |= {
            f"{name} error [{header.partition(' [')[2]}": error
            for (name, header), error in zip(FORCES.items(), self.error, strict=True)
        }
        return pd.DataFrame(self._by_row() | {k: x.ravel() for k, x in columns.items()})

    def _by_row(self) -> dict[str, Array]:
        return {
            _TIME: np.repeat(self.t, len(self.s)),
            _PLACE: np.tile(self.s, len(self.t)),
        }

    @cached_property
    def _sections(self) -> list[Any]:
        return [self.beam.section.at(s) for s in self.s.tolist()]

    def _of_sections(self, name: str) -> Array:
        return np.array([getattr(section, name) for section in self._sections], float)

    def stress(self, offset: float | str) -> pd.DataFrame:
        """Stresses at a distance `offset` [m] from the axis, "top" or "bottom".

        sigma = N / A + M offset / I, and tau, the largest shear stress of the section,
        `Section.shear_peak` Q / A, which is on the axis. What the curvature of the axis adds to the
        bending stress (Winkler) is left out: h / (3 R) of it on the inner side of a rectangle.
        """
        import pandas as pd

        sigma, error = self._sigma(offset)
        columns = {"sigma [Pa]": sigma, "tau [Pa]": self._tau, "sigma error [Pa]": error}
        return pd.DataFrame(self._by_row() | {k: x.ravel() for k, x in columns.items()})

    def _sigma(self, offset: float | str) -> tuple[Array, Array]:
        name = self.beam.name
        eta = np.array([section.fiber_offset(name, offset) for section in self._sections])
        area, bending = self._of_sections("area"), eta / self._of_sections("second_moment")
        error = self.error[0] / area + self.error[2] * np.abs(bending)
        return self.N / area + self.M * bending, error

    @cached_property
    def _tau(self) -> Array:
        return self._of_sections("shear_peak") * self.Q / self._of_sections("area")

    def envelope(self) -> pd.DataFrame:
        """One row a section: least and largest N, Q, M over the times, and when.

        With the largest and least longitudinal stress on the surfaces, where the section knows its
        height.
        """
        import pandas as pd

        columns: dict[str, Array] = {_PLACE: self.s}
        values = dict(zip(FORCES.values(), (self.N, self.Q, self.M), strict=True))
        if all(section.height is not None for section in self._sections):
            values |= {f"sigma {x} [Pa]": self._sigma(x)[0] for x in ("top", "bottom")}
        for header, rows in values.items():
            name, _, unit = header.partition(" [")
            for word, least in (("min", rows.argmin(axis=0)), ("max", rows.argmax(axis=0))):
                columns[f"{name} {word} [{unit}"] = rows[least, np.arange(len(self.s))]
                columns[f"t of {name} {word} [s]"] = self.t[least]
        return pd.DataFrame(columns)

    def safety(self, yield_stress: float | None = None) -> Safety:
        """Least safety against yielding over all times and sections.

        The equivalent stress (von Mises) is |sigma| on the surfaces and sqrt(sigma^2 + 3 tau^2) on
        the axis.

        Parameters
        ----------
        yield_stress
            What the material bears [Pa]; default `Material.yield_stress`.

        Raises
        ------
        BeamdaeError
            If there is no yield stress, or a section does not know its height.
        """
        name = self.beam.name
        if yield_stress is not None:
            allowed = np.full(len(self.s), require_positive(name, "yield_stress", yield_stress))
        else:
            given = [section.material.yield_stress for section in self._sections]
            if None in given:
                raise BeamdaeError(
                    f"{name}: its material has no yield_stress, give Material yield_stress= or "
                    "safety(yield_stress=)."
                )
            allowed = np.array(given, float)
        axis = np.hypot(self._sigma(0.0)[0], np.sqrt(3.0) * self._tau)
        equivalent = {x: np.abs(self._sigma(x)[0]) for x in ("top", "bottom")} | {"axis": axis}
        used = np.stack([stress / allowed for stress in equivalent.values()])
        which, row, place = map(int, np.unravel_index(np.argmax(used), used.shape))
        where = list(equivalent)[which]
        most = float(used[which, row, place])
        return Safety(
            1.0 / most if most > 0.0 else np.inf,
            float(equivalent[where][row, place]),
            float(allowed[place]),
            float(self.t[row]),
            float(self.s[place]),
            where,
        )

    def diagram(self, what: str = "M", t: float | None = None) -> Plot:
        """Draw "N", "Q" or "M" along the beam at one of the times [s].

        Default the only one, or least and largest over all. The line is what balances the loads,
        dots are what the strains say, and the gray band is the estimated error.
        """
        return load_views().plot_section_forces(self, what, t)
