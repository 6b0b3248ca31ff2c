"""Materials and cross-sections: the numbers a beam's constitutive law is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, finite, keep, non_negative, positive, shown


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
    """

    E: float
    nu: float
    rho: float

    def __post_init__(self) -> None:
        keep(
            self,
            E=positive("Material", "E", self.E),
            nu=finite("Material", "nu", self.nu),
            rho=positive("Material", "rho", self.rho),
        )
        if not -1.0 < self.nu <= 0.5:
            raise BeamdaeError(f"Material: nu must lie in (-1, 0.5], got {self.nu:g}.")

    @property
    def G(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2.0 * (1.0 + self.nu))


@dataclass(frozen=True)
class Section:
    """Cross-section of a beam, constant along its length.

    Parameters
    ----------
    material
        The material.
    area
        A [m^2].
    second_moment
        I [m^4] about the axis normal to the plane.
    shear_coefficient
        k_G of the shear stiffness k_G G A (eq. 7); 5/6 for a rectangle.
    damping
        Kelvin-Voigt retardation time [s]: every section force gets damping * stiffness *
        strain rate on top of its elastic part.
    mass_per_length, rotary_inertia_per_length
        rho A [kg/m] and rho I [kg m], where they are not those of the material: for stiffened or
        loaded sections, and for published cases that give them.
    height
        Height [m] in the plane of motion, half of it on either side of the axis, where it is known:
        strains are asked for within it. Rectangles and circles know theirs.

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

    def __post_init__(self) -> None:
        _require_material("Section", self.material)
        sizes = ("area", "second_moment", "shear_coefficient")
        given = ("mass_per_length", "rotary_inertia_per_length", "height")
        needed = (*sizes, *(name for name in given if getattr(self, name) is not None))
        keep(self, **{name: positive("Section", name, getattr(self, name)) for name in needed})
        keep(self, damping=non_negative("Section", "damping", self.damping))
        for name in ("EA", "GA", "EI", "rhoA", "rhoI"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise BeamdaeError(
                    f"Section: {name} must be positive and finite, it is {getattr(self, name):g} "
                    f"with {self.material}, area {self.area:g} and second_moment "
                    f"{self.second_moment:g}."
                )

    @classmethod
    def rectangle(
        cls, material: Material, width: float, height: float, damping: float = 0.0
    ) -> Section:
        """Rectangle of `height` [m] in the plane of motion and `width` [m] normal to it."""
        width = positive("Section.rectangle", "width", width)
        height = positive("Section.rectangle", "height", height)
        area, second_moment = width * height, width * height**3 / 12.0
        return cls(material, area, second_moment, 5.0 / 6.0, damping, height=height)

    @classmethod
    def circle(cls, material: Material, diameter: float, damping: float = 0.0) -> Section:
        """Solid circle of `diameter` [m]; k_G = 6 (1 + nu) / (7 + 6 nu) (Cowper 1966)."""
        diameter = positive("Section.circle", "diameter", diameter)
        nu = _require_material("Section.circle", material).nu
        return cls(
            material,
            np.pi * diameter**2 / 4.0,
            np.pi * diameter**4 / 64.0,
            6.0 * (1.0 + nu) / (7.0 + 6.0 * nu),
            damping,
            height=diameter,
        )

    @property
    def EA(self) -> float:
        """Axial stiffness [N]."""
        return self.material.E * self.area

    @property
    def GA(self) -> float:
        """Shear stiffness with the shear coefficient, k_G G A [N]."""
        return self.shear_coefficient * self.material.G * self.area

    @property
    def EI(self) -> float:
        """Bending stiffness [N m^2]."""
        return self.material.E * self.second_moment

    @property
    def rhoA(self) -> float:
        """Mass per length [kg/m]."""
        own = self.mass_per_length
        return self.material.rho * self.area if own is None else own

    @property
    def rhoI(self) -> float:
        """Rotary inertia per length [kg m]."""
        own = self.rotary_inertia_per_length
        return self.material.rho * self.second_moment if own is None else own


def _require_material(part: str, value: Any) -> Material:
    if not isinstance(value, Material):
        raise BeamdaeError(f"{part}: material must be a Material, got {shown(value)}.")
    return value
