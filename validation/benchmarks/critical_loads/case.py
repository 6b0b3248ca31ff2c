"""One structure with its critical loads at any slenderness, and the comparison with beamdae."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, NamedTuple

from benchmarks.critical_loads.frame_stability import BeamStiffness, FrameDescription

import beamdae as bd

LENGTH = 1.0  # [m]
WIDTH = 0.02  # [m]
STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
FORMULATIONS: dict[str, dict[str, Any]] = {
    "exact": {"formulation": "exact"},
    "floating frame": {},
    "floating frame, Green's strain": {"strain": "green"},
}
# Joint that fixes displacements along x and y and rotations r.
SUPPORTS: dict[str, tuple[Any, ...]] = {
    "xyr": (bd.Weld,),
    "xy": (bd.Revolute,),
    "x": (bd.PointOnLine, (0.0, 1.0)),
    "y": (bd.PointOnLine, (1.0, 0.0)),
    "xr": (bd.Prismatic, (0.0, 1.0)),
    "yr": (bd.Prismatic, (1.0, 0.0)),
}

LIMIT, BRANCH, FLUTTER = "limit point", "branch point", "flutter point"
# Thick and very slender structures, and their mesh.
SLENDERNESS = (1e2, 1e5)
ELEMENTS = 8
EXACT_STRAINS = ("exact", "floating frame")

# Mesh error of a load relative to the power `order` of the phase angle of the buckling mode per
# element [rad]: measured at 2e-5 for columns of every support.
_MESH_CONSTANT = 4e-5
# Rounding error of a load over EI / L^2, relative to the square of the slenderness: positions of
# size L in double precision determine axial forces of size EA = 12 (L / h)^2 EI / L^2 only to 5e-15
# to 1e-14 of it, depending on the mesh.
ROUNDING = 1e-13
# Accuracy of the search for a critical point on the path.
_SEARCH = 3e-7


def strip(slenderness: float, width: float = 1.0, damping: float = 0.0) -> bd.Section:
    """Return the rectangular section of height L / `slenderness`; `width` is relative."""
    height = LENGTH / slenderness
    return bd.Section.rectangle(STEEL, width=WIDTH * width, height=height, damping=damping)


def stiffness(slenderness: float, strain: str = "exact") -> BeamStiffness:
    """Return the stiffness of the section over EI / L^2."""
    section = strip(slenderness)
    unit = section.EI / LENGTH**2
    return BeamStiffness(section.EA / unit, section.GA / unit, strain)


def build_frame(
    frame: FrameDescription, slenderness: float, elements: int, settings: Mapping[str, Any]
) -> bd.Mechanism:
    """Return the frame under its loads times EI / L^2, with `elements` elements per member."""
    mech = bd.Mechanism()
    unit = strip(slenderness).EI / LENGTH**2
    joints: dict[str, bd.results.Attachment] = {}
    for k, member in enumerate(frame.members):
        a, b = (tuple(LENGTH * x for x in frame.nodes[node]) for node in (member.a, member.b))
        section = strip(slenderness, member.width)
        name = f"{member.a}-{member.b}"
        beam = mech.add(bd.Beam(name, bd.Line(a, b), section, elements, **settings))
        for end, node, attachment in (("a", member.a, beam.start), ("b", member.b, beam.end)):
            if node not in joints:
                joints[node] = attachment
                if end in member.hinges:
                    raise ValueError(f"{node}: the first member at a node cannot be hinged")
                continue
            joint = bd.Revolute if end in member.hinges else bd.Weld
            mech.add(joint(f"joint {node} {k}", joints[node], attachment))
    for node, axes in frame.supports.items():
        ground = mech.ground.at(*joints[node].point)
        kind, *direction = SUPPORTS[axes]
        mech.add(kind(f"support {node}", ground, joints[node], *direction))
    for node, (kx, ky, kr) in frame.springs.items():
        ground = mech.ground.at(*joints[node].point)
        stiffnesses = {"kx": kx * unit / LENGTH, "ky": ky * unit / LENGTH}
        mech.add(
            bd.Bushing(
                f"spring {node}", ground, joints[node], **stiffnesses, ktheta=kr * unit * LENGTH
            )
        )
    for node, (fx, fy) in frame.loads.items():
        mech.add(bd.Force(f"load {node}", joints[node], (fx * unit, fy * unit)))
    return mech


class CriticalLoad(NamedTuple):
    """Kind of a critical point and its load factor."""

    kind: str
    load: float


def branches(loads: Iterable[float]) -> tuple[CriticalLoad, ...]:
    """Return branch points at the loads."""
    return tuple(CriticalLoad(BRANCH, load) for load in loads)


@dataclass(frozen=True, eq=False)
class CriticalLoadCase:
    """A structure and all critical points on its path up to a load or a displacement.

    Attributes
    ----------
    group, name, source
        Family, name, and publication or closed form.
    build
        Maps slenderness, number of elements and the settings of the formulation to a mechanism.
    reference
        Maps slenderness and the strain measure ("exact" or "green") to the critical points in
        order along the path.
    path
        Maps the slenderness to the arguments of `bd.equilibrium`.
    phase
        Maps a load to the phase angle of the buckling mode in a member [rad].
    published
        Value of the first load for a slender structure as published, or None.
    digits
        Relative accuracy of `published`.
    order
        Order of the mesh error in the element length; 0 for structures without beams.
    mesh_constant
        See `mesh_error`.
    departure
        Coefficient c of the relative difference c / slenderness^2 of a reference for slender
        structures.
    green_departure
        The same for the reference for Green's strains in a floating frame.
    axial_force
        Maps a load to the axial force whose rounding limits its accuracy [EI / L^2].
    formulations
        Formulations for which the reference holds.
    slenderness
        Values to compare.
    """

    group: str
    name: str
    source: str
    build: Callable[[float, int, Mapping[str, Any]], bd.Mechanism]
    reference: Callable[[float, str], tuple[CriticalLoad, ...]]
    path: Callable[[float], Mapping[str, Any]]
    phase: Callable[[float], float]
    published: float | None = None
    digits: float = 1e-3
    order: int = 6
    mesh_constant: float = _MESH_CONSTANT
    departure: float = 0.0
    green_departure: float = 0.0
    axial_force: Callable[[float], float] = abs
    formulations: tuple[str, ...] = tuple(FORMULATIONS)
    slenderness: tuple[float, ...] = SLENDERNESS

    def all_rows(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of every slenderness and formulation."""
        for slenderness, formulation in product(self.slenderness, self.formulations):
            for row in self.rows(slenderness, ELEMENTS, formulation):
                yield {"slenderness": slenderness, "formulation": formulation, **row}

    def tolerance(self, slenderness: float, elements: int, formulation: str, load: float) -> float:
        """Return the largest relative error allowed of a load."""
        mesh = self.mesh_constant * (self.phase(load) / elements) ** self.order
        rounding = ROUNDING * slenderness**2 / self.axial_force(load)
        departure = self.departure
        if formulation not in EXACT_STRAINS:
            departure += self.green_departure
        return float(mesh + rounding + departure / slenderness**2 + _SEARCH)

    def expected(self, slenderness: float, formulation: str) -> tuple[CriticalLoad, ...]:
        """Return the reference for a formulation."""
        strain = "exact" if formulation in EXACT_STRAINS else "green"
        return _cached_reference(self, slenderness, strain)

    def solve(self, slenderness: float, elements: int, formulation: str) -> bd.results.Equilibrium:
        """Return the path computed by beamdae."""
        mech = self.build(slenderness, elements, FORMULATIONS[formulation])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            return bd.equilibrium(mech, **self.path(slenderness))

    def rows(self, slenderness: float, elements: int, formulation: str) -> Iterator[dict[str, Any]]:
        """Yield one row per expected and per computed critical point, in pairs along the path.

        The column "verdict" is "ok", or states what is wrong: "missed", "invented", "kind" or
        "load" of a point, "ended" for a path that ends early, or "unstable" for a wrong number of
        unstable directions at its end.
        """
        expected = self.expected(slenderness, formulation)
        try:
            path = self.solve(slenderness, elements, formulation)
            status = "" if path.status.success else path.status.sentence
            unstable = int(path.unstable[-1])
            found = [CriticalLoad(point.kind, point.factor) for point in path.critical]
        except Exception as error:  # An error and a defect of the engine become rows.
            status, found = f"{type(error).__name__}: {error}", []
        pairs = _pair(expected, found)
        if not pairs and not status:
            yield {"verdict": "ok"}
        for reference, computed in pairs:
            row = {"expected": reference, "computed": computed, "verdict": "ok"}
            if reference and computed:
                tolerance = self.tolerance(slenderness, elements, formulation, reference.load)
                row["relative"] = abs(computed.load / reference.load - 1.0)
                if computed.kind != reference.kind:
                    row["verdict"] = "kind"
                elif row["relative"] > tolerance:
                    row["verdict"] = "load"
            else:
                row["verdict"] = "missed" if reference else "invented"
            yield row
        if status:
            yield {"verdict": "ended", "reason": status}
        elif "control" not in self.path(slenderness):
            # Without limit points, each branch adds an unstable direction and each flutter two.
            count = sum(2 if point.kind == FLUTTER else 1 for point in expected)
            if unstable != count:
                reason = f"{unstable} unstable directions at the end instead of {count}"
                yield {"verdict": "unstable", "reason": reason}


# Computed points farther from a reference than this are another point.
_SAME_POINT = 0.2


def _pair(
    expected: tuple[CriticalLoad, ...], found: list[CriticalLoad]
) -> list[tuple[CriticalLoad | None, CriticalLoad | None]]:
    """Return pairs of expected and computed points in order; None where one is missing.

    Among all alignments that keep the order, the one with the smallest sum of relative
    differences is chosen; an unpaired point costs `_SAME_POINT`, and half of it a wrong kind.
    """

    @cache
    def align(i: int, j: int) -> tuple[float, tuple]:
        if i == len(expected) and j == len(found):
            return 0.0, ()
        options = []
        if i < len(expected):
            cost, rest = align(i + 1, j)
            options.append((cost + _SAME_POINT, ((expected[i], None), *rest)))
        if j < len(found):
            cost, rest = align(i, j + 1)
            options.append((cost + _SAME_POINT, ((None, found[j]), *rest)))
        if i < len(expected) and j < len(found):
            cost, rest = align(i + 1, j + 1)
            difference = abs(found[j].load / expected[i].load - 1.0)
            difference += 0.5 * _SAME_POINT * (found[j].kind != expected[i].kind)
            options.append((cost + difference, ((expected[i], found[j]), *rest)))
        return min(options, key=lambda option: option[0])

    return list(align(0, 0)[1])


@cache
def _cached_reference(
    case: CriticalLoadCase, slenderness: float, strain: str
) -> tuple[CriticalLoad, ...]:
    return case.reference(slenderness, strain)
