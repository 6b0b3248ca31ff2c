"""Isotropic linear-elastic materials, with a table of common ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    optional,
    require_finite,
    require_positive,
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
