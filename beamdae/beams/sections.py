"""Materials and cross-sections: stiffnesses, inertias, damping; sections that vary along a beam."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    as_real,
    convert_fields,
    format_distinct,
    format_exception,
    optional,
    require_choice,
    require_finite,
    require_non_negative,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
    suggest,
    warn_user,
)

# Shorter beginnings of names are probably typing errors.
_MIN_BEGINNING = 4
# E [Pa], nu, rho [kg/m^3] and yield stress [Pa] at 20 °C. Sources: see `Material.of`.
_TABLE: dict[str, tuple[float, float, float, float | None]] = {
    "steel": (210e9, 0.3, 7850.0, None),
    "steel S235": (210e9, 0.3, 7850.0, 235e6),
    "steel S355": (210e9, 0.3, 7850.0, 355e6),
    "stainless steel": (200e9, 0.3, 7900.0, None),
    "stainless steel 1.4301": (200e9, 0.3, 7900.0, 210e6),
    "aluminum": (70e9, 0.3, 2700.0, None),
    "aluminum 6082-T6": (70e9, 0.3, 2700.0, 250e6),
    "titanium Ti-6Al-4V": (113.8e9, 0.342, 4430.0, 830e6),
    "brass": (110e9, 0.375, 8530.0, None),
    "copper": (115e9, 0.343, 8940.0, None),
}
# Numbers of one pascal and of one kg/m^3 in units in which data sheets state them.
_MODULUS_UNITS = {"Pa": 1.0, "MPa": 1e-6, "GPa": 1e-9, "psi": 1.450377e-4, "ksi": 1.450377e-7}
_DENSITY_UNITS = {
    "kg/m^3": 1.0,
    "g/cm^3": 1e-3,
    "kg/mm^3": 1e-9,
    "t/mm^3": 1e-12,
    "lb/in^3": 3.612729e-5,
}
# Largest relative difference of E and rho from a material of the table that is recognized.
_MAX_DIFFERENCE = 0.1
# Largest Young's modulus of a material [Pa]: that of diamond is at most 1.22e12.
_MAX_MODULUS = 1.3e12


@dataclass(frozen=True)
class Material:
    """Isotropic linear-elastic material.

    Parameters
    ----------
    E
        Young's modulus [Pa].
    nu
        Poisson's ratio, -1 < nu <= 0.5; the shear modulus is G = E / (2 (1 + nu)).
    rho
        Density [kg/m^3].
    yield_stress
        Yield stress [Pa], optional: the default of `SectionForces.safety`, and the limit of linear
        elasticity, beyond which results have a warning.

    Raises
    ------
    BeamdaeError
        If `E`, `rho` or `yield_stress` is not positive and finite, or `nu` is not in (-1, 0.5].

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.Material.of("steel").E
    210000000000.0
    >>> alloy = bd.Material(E=69e9, nu=0.33, rho=2700.0, yield_stress=270e6)
    """

    E: float
    nu: float
    rho: float
    yield_stress: float | None = None

    def __post_init__(self) -> None:
        convert_fields(
            self,
            E=require_positive,
            nu=require_finite,
            rho=require_positive,
            yield_stress=optional(require_positive),
        )
        if not -1.0 < self.nu <= 0.5:
            raise BeamdaeError(f"Material: nu must lie in (-1, 0.5], got {self.nu:g}.")
        self._warn_of_units()
        if self.E > _MAX_MODULUS:
            warn_user(
                f"Material: E = {self.E:g} Pa is larger than that of diamond (1.2e+12 Pa); check "
                "its unit, or use bd.RigidBody for parts that do not deform."
            )

    def _warn_of_units(self) -> None:
        """Warn of numbers that are those of a material of the table in other units."""
        for name, (modulus, _, density, _) in _TABLE.items():
            stiff = _find_unit(self.E / modulus, _MODULUS_UNITS)
            dense = _find_unit(self.rho / density, _DENSITY_UNITS)
            if stiff == "Pa" and dense == "kg/m^3":
                return
            if stiff and dense:
                warn_user(
                    f"Material: E = {self.E:g} Pa and rho = {self.rho:g} kg/m^3 are those of "
                    f"{name} in {stiff} and {dense}; pass E in Pa and rho in kg/m^3, such as "
                    f"E={modulus:g} and rho={density:g}."
                )
                return

    @classmethod
    def of(cls, name: str) -> Material:
        """Return a material from a table of design values at 20 °C.

        ======================== ======= ===== ==== ====== =========================================
        name                     E [GPa] nu    rho  yield  source
        ======================== ======= ===== ==== ====== =========================================
        "steel"                  210     0.3   7850        EN 1993-1-1, 3.2.6; EN 1991-1-1, A.4
        "steel S235"             210     0.3   7850 235    EN 1993-1-1, table 3.1, to 40 mm
        "steel S355"             210     0.3   7850 355    EN 1993-1-1, table 3.1, to 40 mm
        "stainless steel"        200     0.3   7900        EN 10088-1, E.1, 1.4301; EN 1993-1-4
        "stainless steel 1.4301" 200     0.3   7900 210    EN 1993-1-4, table 2.1, hot rolled
        "aluminum"               70      0.3   2700        EN 1999-1-1, 3.2.5, wrought alloys
        "aluminum 6082-T6"       70      0.3   2700 250    EN 1999-1-1, table 3.2b, extruded
        "titanium Ti-6Al-4V"     113.8   0.342 4430 830    ASM Handbook vol. 2 (1990), annealed
        "brass"                  110     0.375 8530        ASM Handbook vol. 2, C26000, annealed
        "copper"                 115     0.343 8940        ASM Handbook vol. 2, C11000, nu of Cu
        ======================== ======= ===== ==== ====== =========================================

        The unit of rho is kg/m^3, that of the yield stress MPa. Without a grade, `yield_stress` is
        None, because it depends on grade and temper; pass it to `SectionForces.safety`. Values
        differ by a few percent between alloys and tempers; create a `Material` from measured values
        if available.

        Parameters
        ----------
        name
            One of the names in the table, also with "aluminium", or a beginning of at least four
            letters of one name, or of one name and its grades.

        Returns
        -------
        Material
            The material, with the yield stress of a grade.

        Raises
        ------
        BeamdaeError
            If the name is not in the table, or the beginning of several names.

        Examples
        --------
        >>> import beamdae as bd
        >>> bd.Material.of("steel S355").yield_stress
        355000000.0
        """
        if isinstance(name, str) and len(name) >= _MIN_BEGINNING and name not in _TABLE:
            beginning = name.replace("alumini", "alumin")
            first, *grades = [x for x in _TABLE if x.startswith(beginning)] or [name]
            name = first if all(x.startswith(first) for x in grades) else name
        if not isinstance(name, str) or name not in _TABLE:
            raise BeamdaeError(
                f"Material.of: the name must be one of {', '.join(map(repr, _TABLE))}, "
                f"got {short_repr(name)}{suggest(name, _TABLE)}."
            )
        return cls(*_TABLE[name])

    @property
    def G(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2.0 * (1.0 + self.nu))


def _find_unit(ratio: float, units: Mapping[str, float]) -> str:
    """Return the unit in which a number is `ratio` times that in the SI unit, or ""."""
    return next((x for x, one in units.items() if abs(ratio / one - 1.0) < _MAX_DIFFERENCE), "")


def require_material(part: str, value: object) -> Material:
    """Return `value` if it is a material, or raise BeamdaeError."""
    if not isinstance(value, Material):
        raise BeamdaeError(f"{part}: material must be a Material, got {short_repr(value)}.")
    return value


class CenteredShape(NamedTuple):
    """Rectangle or circle whose center is on the axis of a section.

    Attributes
    ----------
    outline
        "rectangle" or "circle".
    height_ratio
        Height of the shape divided by the height of the section [-].
    share
        Second moment of area of the shape divided by that of the section [-]; negative for a hole.
    """

    outline: Literal["rectangle", "circle"]
    height_ratio: float = 1.0
    share: float = 1.0

    def curvature_factor(self, half_height: float) -> float:
        """Return the integral of eta^2 / (1 - kappa eta) dA divided by the second moment of area.

        `half_height` is half the height of the section times the curvature kappa [-].
        """
        z2 = (half_height * self.height_ratio) ** 2
        if self.outline == "circle":
            return float(4.0 / (1.0 + np.sqrt(1.0 - z2)) ** 2)
        # Imported here because the import takes as long as a short run, and few models need it.
        from scipy.special import hyp2f1

        # 3 (artanh(z) / z - 1) / z^2, without cancellation for small z.
        return float(hyp2f1(1.0, 1.5, 2.5, z2))


_RECTANGLE = (CenteredShape("rectangle"),)


@dataclass(frozen=True)
class Section:
    """Cross-section of a beam.

    Shear correction factors of the class methods are those of G. R. Cowper, J. Appl. Mech. 33, 335
    (1966), doi:10.1115/1.3625046, except that of rectangles, which does not depend on nu.

    A section that varies along the beam is given as a function of arc length s [m] that returns a
    `Section`, such as ``lambda s: bd.Section.rectangle(alloy, width=0.03, height=0.01 - 0.002 *
    s)``, or as a `taper`.

    Parameters
    ----------
    material
        The material.
    area
        Area A [m^2].
    second_moment
        Second moment of area I [m^4] about the centroidal axis normal to the plane of motion.
    shear_coefficient
        Shear correction factor k_G of the shear stiffness k_G G A; 5/6 (default) for a rectangle.
    damping
        Kelvin-Voigt retardation time [s]: each section force is stiffness * (strain + damping *
        strain rate). A vibration with the frequency f [Hz] has the damping ratio pi f damping.
    mass_per_length, rotary_inertia_per_length
        rho A [kg/m] and rho I [kg m], for sections with stiffeners or nonstructural mass. Default
        to the values of the material and the shape.
    height
        Height [m] in the plane of motion, half on either side of the axis. Required for strains and
        stresses at "top" and "bottom"; set by the class methods such as `rectangle`.
    shear_peak
        Largest shear stress (on the axis) relative to the mean Q / A; 3/2 (default) for a
        rectangle. Set by the other class methods, such as `circle`.
    shapes
        Shapes whose sum is the section, for the stresses in curved beams (`stress_lever`). Set by
        the class methods such as `rectangle`; if empty (default), the section is treated as a
        rectangle of the given height and second moment of area.

    Raises
    ------
    BeamdaeError
        If `material` is not a Material, a value is not positive (or `damping` is negative), a
        stiffness or an inertia is not finite, or `shapes` contains anything but `CenteredShape`.

    Examples
    --------
    >>> import beamdae as bd
    >>> steel = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
    >>> strip = bd.Section.rectangle(steel, width=0.02, height=0.001)
    >>> from dataclasses import replace
    >>> replace(strip, mass_per_length=1.2, rotary_inertia_per_length=6e-4).rhoA
    1.2
    """

    material: Material
    area: float
    second_moment: float
    shear_coefficient: float = 5.0 / 6.0
    damping: float = 0.0
    mass_per_length: float | None = None
    rotary_inertia_per_length: float | None = None
    height: float | None = None
    shear_peak: float = 1.5
    shapes: tuple[CenteredShape, ...] = ()
    # Arc lengths [m] in beams, see `VaryingSection`.
    kinks: ClassVar[tuple[float, ...]] = ()
    breaks: ClassVar[tuple[float, ...]] = ()
    jumps: ClassVar[tuple[float, ...]] = ()

    def __post_init__(self) -> None:
        require_material("Section", self.material)
        required = ("area", "second_moment", "shear_coefficient", "shear_peak")
        optional = ("mass_per_length", "rotary_inertia_per_length", "height")
        positive = (*required, *(name for name in optional if getattr(self, name) is not None))
        # Functions of arc length return hundreds of sections for each beam.
        for name in positive:
            value = getattr(self, name)
            if (number := require_positive("Section", name, value)) is not value:
                set_fields(self, **{name: number})
        convert_fields(self, damping=require_non_negative)
        if not (
            isinstance(self.shapes, tuple)
            and all(isinstance(shape, CenteredShape) for shape in self.shapes)
        ):
            raise BeamdaeError(
                f"Section: shapes must be a tuple of CenteredShape, got {short_repr(self.shapes)}."
            )
        for name in ("EA", "GA", "EI", "rhoA", "rhoI"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise BeamdaeError(
                    f"Section: {name} must be positive and finite, got {getattr(self, name):g} "
                    f"from {self.material}, area {self.area:g} m^2 and "
                    f"second_moment {self.second_moment:g} m^4."
                )

    @classmethod
    def rectangle(
        cls, material: Material, width: float, height: float, damping: float = 0.0
    ) -> Section:
        """Return a rectangular section.

        Width w and height h give A = w h, I = w h^3 / 12 and k_G = 5/6.

        Parameters
        ----------
        material
            The material.
        width
            Width normal to the plane of motion [m].
        height
            Height in the plane of motion [m].
        damping
            Kelvin-Voigt retardation time [s].

        Raises
        ------
        BeamdaeError
            If `material` is not a Material, a size is not positive, or `damping` is negative.
        """
        width = require_positive("Section.rectangle", "width", width)
        height = require_positive("Section.rectangle", "height", height)
        area, second_moment = width * height, width * height**3 / 12.0
        return cls(
            material, area, second_moment, 5.0 / 6.0, damping, height=height, shapes=_RECTANGLE
        )

    @classmethod
    def circle(cls, material: Material, diameter: float, damping: float = 0.0) -> Section:
        """Return a solid circular section.

        k_G = 6 (1 + nu) / (7 + 6 nu) (Cowper 1966).

        Parameters
        ----------
        material
            The material.
        diameter
            Diameter [m].
        damping
            Kelvin-Voigt retardation time [s].

        Raises
        ------
        BeamdaeError
            If `material` is not a Material, `diameter` is not positive, or `damping` is negative.
        """
        diameter = require_positive("Section.circle", "diameter", diameter)
        nu = require_material("Section.circle", material).nu
        return cls(
            material,
            np.pi * diameter**2 / 4.0,
            np.pi * diameter**4 / 64.0,
            6.0 * (1.0 + nu) / (7.0 + 6.0 * nu),
            damping,
            height=diameter,
            shear_peak=4.0 / 3.0,
            shapes=(CenteredShape("circle"),),
        )

    @classmethod
    def pipe(
        cls, material: Material, diameter: float, wall: float, damping: float = 0.0
    ) -> Section:
        """Return the section of a round pipe.

        k_G = 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2) (Cowper 1966)
        with m the ratio of the inner to the outer diameter.

        Parameters
        ----------
        material
            The material.
        diameter
            Outer diameter [m].
        wall
            Wall thickness [m].
        damping
            Kelvin-Voigt retardation time [s].

        Raises
        ------
        BeamdaeError
            If `material` is not a Material, a size is not positive, `wall` is not less than half
            the diameter, or `damping` is negative.
        """
        diameter = require_positive("Section.pipe", "diameter", diameter)
        wall = require_positive("Section.pipe", "wall", wall)
        _require_less("Section.pipe", "wall", wall, "half the diameter", 0.5 * diameter)
        nu, inner = require_material("Section.pipe", material).nu, diameter - 2.0 * wall
        m = inner / diameter
        m2 = m**2
        square = (1.0 + m2) ** 2
        area = np.pi * wall * (diameter - wall)
        # 1 - m^4 without cancellation; it is 0 if the area underflows, which is rejected below.
        hollow = (1.0 + m2) * 4.0 * wall * (diameter - wall) / diameter**2
        outer = 1.0 / hollow if hollow else np.inf
        return cls(
            material,
            area,
            area * (diameter**2 + inner**2) / 16.0,
            6.0 * (1.0 + nu) * square / ((7.0 + 6.0 * nu) * square + (20.0 + 12.0 * nu) * m2),
            damping,
            height=diameter,
            shear_peak=4.0 / 3.0 * (1.0 + m + m2) / (1.0 + m2),
            shapes=(CenteredShape("circle", 1.0, outer), CenteredShape("circle", m, 1.0 - outer)),
        )

    @classmethod
    def i_profile(
        cls,
        material: Material,
        width: float,
        height: float,
        flange: float,
        web: float,
        damping: float = 0.0,
    ) -> Section:
        """Return an I-profile bent about its strong axis, with the web in the plane of motion.

        The profile has no fillets. k_G is taken from Cowper (1966) for thin walls: flanges and web
        are idealized as lines, with the flanges a distance height - flange apart.

        Parameters
        ----------
        material
            The material.
        width
            Width of the flanges [m].
        height
            Overall height [m].
        flange
            Thickness of the flanges [m].
        web
            Thickness of the web [m].
        damping
            Kelvin-Voigt retardation time [s].

        Raises
        ------
        BeamdaeError
            If `material` is not a Material, a size is not positive, `flange` is not less than half
            the height, `web` is not less than the width, or `damping` is negative.
        """
        sizes = {"width": width, "height": height, "flange": flange, "web": web}
        width, height, flange, web = (
            require_positive("Section.i_profile", name, value) for name, value in sizes.items()
        )
        _require_less("Section.i_profile", "flange", flange, "half the height", 0.5 * height)
        _require_less("Section.i_profile", "web", web, "the width", width)
        nu = require_material("Section.i_profile", material).nu
        web_height, overhang = height - 2.0 * flange, width - web
        area = 2.0 * width * flange + web_height * web
        second_moment = (width * height**3 - overhang * web_height**3) / 12.0
        outer = width * height**3 / (12.0 * second_moment)
        first_moment_of_half = 0.5 * width * flange * (height - flange) + web * web_height**2 / 8.0
        return cls(
            material,
            area,
            second_moment,
            _shear_coefficient_of_thin_i(nu, width, height - flange, flange, web),
            damping,
            height=height,
            shear_peak=area * first_moment_of_half / (second_moment * web),
            shapes=(
                CenteredShape("rectangle", 1.0, outer),
                CenteredShape("rectangle", web_height / height, 1.0 - outer),
            ),
        )

    def at(self, s: float) -> Section:
        """Return the section itself for any `s`; the counterpart of `VaryingSection.at`."""
        return self

    def fiber_offset(self, part: str, offset: float | str) -> float:
        """Return the distance of a fiber from the axis [m], positive to the left of the curve.

        `offset` is this distance, "top" (left surface) or "bottom" (right surface). `part` is the
        name of the beam in error messages.

        Raises
        ------
        BeamdaeError
            If `offset` is another text or not finite, the section has no height for "top" or
            "bottom", or the fiber lies outside the section.
        """
        if isinstance(offset, str):
            require_choice(part, "offset", offset, ("top", "bottom"))
            if self.height is None:
                raise BeamdaeError(
                    f"{part}: offset {offset!r} requires the height of the section; "
                    "set height= of the Section."
                )
            return 0.5 * self.height if offset == "top" else -0.5 * self.height
        offset = require_finite(part, "offset", offset)
        if self.height is not None and abs(offset) > 0.5 * self.height * (1.0 + 1e-9):
            half, given = format_distinct(0.5 * self.height, offset)
            raise BeamdaeError(
                f"{part}: offset must lie within half the height of the section ({half} m), got "
                f"{given} m."
            )
        return offset

    def stress_lever(self, part: str, offset: float | str, curvature: float) -> float:
        """Return the lever l [m] of a fiber, with the longitudinal stress sigma = N / A + M l / I.

        In a straight beam, l is the offset eta of the fiber. In a beam whose stress-free axis has
        the curvature kappa, plane sections and the shorter fibers on the inner side give the
        hyperbolic distribution of Winkler and Bach (Timoshenko, Strength of Materials II, 1956,
        chapter XII):

            l = I (eta / (J (1 - kappa eta)) - kappa / A),
            J = integral of eta^2 / (1 - kappa eta) dA.

        For a rectangle of height h on the radius R, the stress on the inner side is approximately
        1 + h / (3 R) times that of a straight beam. J is exact for `shapes`; for a section without
        `height`, J = I.

        Parameters
        ----------
        part
            Name of the beam in error messages.
        offset
            See `fiber_offset`.
        curvature
            Curvature kappa of the stress-free axis [1/m], positive to the left.

        Raises
        ------
        BeamdaeError
            If `offset` is invalid, or the section reaches the center of curvature.
        """
        eta = self.fiber_offset(part, offset)
        half_height = abs(eta) if self.height is None else 0.5 * self.height
        if not half_height * abs(curvature) < 1.0:
            extent, radius = format_distinct(half_height, 1.0 / abs(curvature))
            raise BeamdaeError(
                f"{part}: the section extends {extent} m from the axis and reaches the "
                f"center of curvature at {radius} m, so stresses are undefined; "
                "reduce the height or the curvature."
            )
        factor = 1.0
        if self.height is not None:
            factor = sum(
                shape.share * shape.curvature_factor(half_height * curvature)
                for shape in self.shapes or _RECTANGLE
            )
        inner = eta / (factor * (1.0 - curvature * eta))
        return inner - curvature * self.second_moment / self.area

    @property
    def EA(self) -> float:
        """Axial stiffness [N]."""
        return self.material.E * self.area

    @property
    def GA(self) -> float:
        """Shear stiffness k_G G A [N] with the shear correction factor k_G."""
        return self.shear_coefficient * self.material.G * self.area

    @property
    def EI(self) -> float:
        """Bending stiffness [N m^2]."""
        return self.material.E * self.second_moment

    @property
    def rhoA(self) -> float:
        """Mass per length [kg/m]."""
        if self.mass_per_length is not None:
            return self.mass_per_length
        return self.material.rho * self.area

    @property
    def rhoI(self) -> float:
        """Rotary inertia per length [kg m]."""
        if self.rotary_inertia_per_length is not None:
            return self.rotary_inertia_per_length
        return self.material.rho * self.second_moment


def _require_less(part: str, name: str, value: float, what: str, limit: float) -> None:
    if not value < limit:
        bound, given = format_distinct(limit, value)
        raise BeamdaeError(f"{part}: {name} must be less than {what} ({bound} m), got {given} m.")


def _shear_coefficient_of_thin_i(
    nu: float, width: float, height: float, flange: float, web: float
) -> float:
    """Return k_G of a thin-walled I-profile (Cowper 1966, table 1).

    `height` is the distance between the center lines of the flanges.
    """
    m, n2 = 2.0 * width * flange / (height * web), (width / height) ** 2
    return (
        10.0
        * (1.0 + nu)
        * (1.0 + 3.0 * m) ** 2
        / (
            12.0
            + 72.0 * m
            + 150.0 * m**2
            + 90.0 * m**3
            + nu * (11.0 + 66.0 * m + 135.0 * m**2 + 90.0 * m**3)
            + 30.0 * n2 * (m + m**2)
            + 5.0 * nu * n2 * (8.0 * m + 9.0 * m**2)
        )
    )


SectionLaw = Callable[[float], Section]

_MAX_CACHED_SECTIONS = 10_000  # of a beam
# A prime number: kinks in the middle of a beam, or at a quarter, are no ends of parts.
_SEARCHED_PARTS = 97
_MIN_BEND = 1e-4  # of parts, in which stresses change by a ten thousandth
_MAX_SMOOTH_RATIO = 3.0  # of bends of halved parts: 4 at smooth places, 2 at kinks, 1 at jumps
# Derivatives need precise places; bends of much shorter parts are rounding errors.
_HALVINGS, _CHECKED_HALVINGS = 36, 10
_SAMPLES = 1025  # in which narrow places are searched
_MIN_NARROWING = 1e-9  # of the section modulus between two samples, above rounding errors

_SECTION_ATTRIBUTES = {field.name for field in fields(Section)} | {"EA", "GA", "EI", "rhoA", "rhoI"}
_DIMENSION_REQUIREMENT = "a number, a pair (at the start, at the end) or a list of numbers"
_SECTION_REQUIREMENT = (
    "section must be a Section, a taper or a function of s that returns a Section"
)


@dataclass(frozen=True, eq=False)
class VaryingSection:
    """Section that varies along a beam.

    Attributes
    ----------
    part
        Name of the beam in error messages.
    law
        Function of arc length s [m] that returns the `Section` at s.
    length
        Length of the beam [m].
    kinks
        Ascending arc lengths [m] of the kinks of a taper; None for a function, see `breaks`.
    """

    part: str
    law: SectionLaw
    length: float
    kinks: tuple[float, ...] | None = None

    # A cached property because fingerprints of models omit these.
    @cached_property
    def _sections(self) -> dict[float, Section]:
        """Sections by arc length [m]; beams evaluate most points several times."""
        return {}

    @property
    def breaks(self) -> tuple[float, ...]:
        """Ascending arc lengths [m] of kinks and jumps, and of the narrow places of a function."""
        if self.kinks is not None:
            return self.kinks
        return tuple(sorted({*self._bends_at_breaks, *self._narrow_places}))

    @property
    def jumps(self) -> tuple[float, ...]:
        """Arc lengths [m] just beyond the jumps of a function."""
        return tuple(s for s, bend in self._bends_at_breaks.items() if bend > _MIN_BEND)

    @cached_property
    def _bends_at_breaks(self) -> dict[float, float]:
        """Bends at the kinks and jumps of a function, by arc length [m].

        In each of 97 equal parts, the largest bend of the logarithms of stiffnesses and section
        modulus is followed as the part is halved: at smooth places, bends decrease to a quarter.
        """
        if self.kinks is not None:
            return {}
        ends = np.linspace(0.0, self.length, _SEARCHED_PARTS + 1).tolist()
        breaks = (self._find_break(*pair) for pair in pairwise(ends))
        return dict(x for x in breaks if x is not None)

    def _find_break(self, start: float, end: float) -> tuple[float, float] | None:
        bend = self._measure_bend(start, end)
        if bend < _MIN_BEND:
            return None
        for k in range(_HALVINGS):
            quarter = 0.25 * (end - start)
            parts = [(start + x * quarter, start + (x + 2) * quarter) for x in range(3)]
            bends = [self._measure_bend(*part) for part in parts]
            if k < _CHECKED_HALVINGS and max(bends) < bend / _MAX_SMOOTH_RATIO:
                return None
            bend = max(bends)
            start, end = parts[bends.index(bend)]
        # Places given by users have few digits, but may lie before a jump.
        rounded = float(f"{end:.12g}")
        is_found = start <= rounded <= end and self._measure_bend(rounded, end) < 0.5 * bend
        return (rounded if is_found else end), bend

    @cached_property
    def _narrow_places(self) -> tuple[float, ...]:
        """Arc lengths [m] at which the section modulus of a function is smallest nearby."""
        places = np.linspace(0.0, self.length, _SAMPLES)
        modulus = np.array([self._modulus(s) for s in places.tolist()])
        left, middle, right = modulus[:-2], modulus[1:-1], modulus[2:]
        limit = 1.0 - _MIN_NARROWING
        is_narrow = (middle < limit * left) & (limit * middle <= right)
        ends = [tuple(places[[k, k + 2]].tolist()) for k in np.flatnonzero(is_narrow)]
        kinks = self._bends_at_breaks
        return tuple(
            self._find_narrowest(start, end)
            for start, end in ends
            if not any(start <= s <= end for s in kinks)
        )

    def _find_narrowest(self, start: float, end: float) -> float:
        for _ in range(_HALVINGS):
            places = np.linspace(start, end, 5).tolist()
            k = min(range(1, 4), key=lambda k: self._modulus(places[k]))
            start, end = places[k - 1], places[k + 1]
        return 0.5 * (start + end)

    def _modulus(self, s: float) -> float:
        return _section_modulus(self.at(s))

    def _measure_bend(self, start: float, end: float) -> float:
        places = (self.at(s) for s in (start, 0.5 * (start + end), end))
        rows = np.log([(x.EA, x.EI, _section_modulus(x)) for x in places])
        return float(np.max(np.abs(rows[0] - 2.0 * rows[1] + rows[2])))

    def at(self, s: float) -> Section:
        """Return the section at arc length s [m].

        Raises
        ------
        BeamdaeError
            If the law fails or does not return a `Section`.
        """
        section = self._sections.get(s)
        if section is None:
            section = _call_law(self.part, self.law, s, f"at s = {s:g} m")
            if len(self._sections) < _MAX_CACHED_SECTIONS:
                self._sections[s] = section
        return section

    def __getattr__(self, name: str) -> Any:
        if name in _SECTION_ATTRIBUTES:
            raise BeamdaeError(
                f"{self.part}: the section varies along the beam; use section.at(s).{name}."
            )
        raise AttributeError(name)

    def law_from(self, start: float) -> SectionLaw:
        """Return the section as a function of the arc length measured from `start` [m]."""
        return lambda s: self.at(start + s)


@dataclass(frozen=True)
class Taper:
    """Section whose dimensions are piecewise linear along a beam; created by `taper`.

    Attributes
    ----------
    shape, material
        See `taper`.
    dimensions
        (name, values at equidistant points from the start to the end) of each dimension.
    """

    shape: Callable[..., Section]
    material: Material
    dimensions: tuple[tuple[str, tuple[float, ...]], ...]

    def section_law(self, length: float) -> SectionLaw:
        """Return the section as a function of arc length, for a beam of `length` [m]."""

        def section(s: float) -> Section:
            fraction = s / length
            sizes = {name: _interpolate(values, fraction) for name, values in self.dimensions}
            return self.shape(self.material, **sizes)

        return section

    def kinks(self, length: float) -> tuple[float, ...]:
        """Return the arc lengths [m] at which the slope of a dimension may change."""
        shares = {k / (len(x) - 1) for _, x in self.dimensions for k in range(1, len(x) - 1)}
        return tuple(share * length for share in sorted(shares))


def _interpolate(values: tuple[float, ...], fraction: float) -> float:
    """Return the piecewise linear function of `values` at a fraction of the length."""
    place = fraction * (len(values) - 1)
    k = min(max(int(place), 0), len(values) - 2)
    share = place - k
    return (1.0 - share) * values[k] + share * values[k + 1]


def taper(shape: Callable[..., Section], material: Material, **dimensions: Any) -> Taper:
    """Return a section whose dimensions are linear or piecewise linear along a beam.

    Lists of dimensions can be parameters of `optimize`. Elements end at the points where dimensions
    are given.

    Parameters
    ----------
    shape
        Function of the material and the dimensions that returns a `Section`, such as
        ``bd.Section.rectangle``.
    material
        The material.
    **dimensions
        Arguments of `shape`: each a number, a pair of numbers (at the start, at the end), or a list
        of numbers at equidistant points from the start to the end, with linear sections between.

    Returns
    -------
    Taper
        Value for the parameter `section` of `Beam`.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, or `shape` rejects the dimensions at one of the points.

    Examples
    --------
    >>> import beamdae as bd
    >>> steel = bd.Material.of("steel")
    >>> blade = bd.taper(bd.Section.rectangle, steel, width=0.03, height=(0.004, 0.002))
    >>> beam = bd.Beam("blade", bd.Line((0.0, 0.0), (1.0, 0.0)), blade)
    >>> round(beam.section.at(0.5).height, 6)
    0.003
    >>> leaf = bd.taper(bd.Section.rectangle, steel, width=0.03, height=(0.004, 0.006, 0.002))
    >>> beam = bd.Beam("leaf", bd.Line((0.0, 0.0), (1.0, 0.0)), leaf)
    >>> [round(beam.section.at(s).height, 6) for s in (0.25, 0.5, 0.75)]
    [0.005, 0.006, 0.004]
    """
    if not callable(shape):
        raise BeamdaeError(
            f"taper: shape must be a function such as Section.rectangle, got {short_repr(shape)}."
        )
    require_material("taper", material)
    pairs = tuple((name, _parse_dimension(name, value)) for name, value in dimensions.items())
    section = Taper(shape, material, pairs)
    law = section.section_law(1.0)
    for share in sorted({x for _, values in pairs for x in np.linspace(0.0, 1.0, len(values))}):
        _call_law("taper", law, share, f"at {100.0 * share:.3g} % of the length")
    return section


def _section_modulus(section: Section) -> float:
    """Return half the section modulus [m^3], or the second moment [m^4] without a height."""
    return section.second_moment / (section.height or 1.0)


def _call_law(part: str, law: SectionLaw, s: float, place: str) -> Section:
    """Return the section that a law returns for `s`, which errors describe by `place`."""
    requirement = f"{part}: {_SECTION_REQUIREMENT}"
    try:
        section = law(float(s))
    except BeamdaeError as problem:
        raise BeamdaeError(f"{part}, section {place}: {problem}") from None
    except Exception as problem:
        raise BeamdaeError(
            f"{requirement}, but the call failed {place}: {format_exception(problem)}."
        ) from problem
    if not isinstance(section, Section):
        raise BeamdaeError(f"{requirement}, got {short_repr(section)} {place}.")
    return section


def _parse_dimension(name: str, value: Any) -> tuple[float, ...]:
    if as_real(value) is None and not isinstance(value, str):
        values = require_sequence("taper", name, value, _DIMENSION_REQUIREMENT)
        if len(values) < 2:
            raise BeamdaeError(
                f"taper: {name} must be {_DIMENSION_REQUIREMENT}, got {short_repr(value)}."
            )
        places = ["at the start", *(f"[{k}]" for k in range(1, len(values) - 1)), "at the end"]
        return tuple(
            require_finite("taper", f"{name} {place}", x)
            for place, x in zip(places, values, strict=True)
        )
    size = require_finite("taper", name, value)
    return size, size


def require_section(part: str, value: Any, length: float) -> Section | VaryingSection:
    """Return `value` as the section of a beam with the given length [m].

    Raises
    ------
    BeamdaeError
        If `value` is not a `Section`, a `Taper` or a function.
    """
    if isinstance(value, Section):
        return value
    if isinstance(value, Taper):
        return VaryingSection(part, value.section_law(length), length, value.kinks(length))
    if not callable(value) or isinstance(value, type):
        raise BeamdaeError(f"{part}: {_SECTION_REQUIREMENT}, got {short_repr(value)}.")
    return VaryingSection(part, value, length)
