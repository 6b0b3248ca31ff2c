"""Public names are defined where the catalog says, and generated files agree with it."""

from operator import attrgetter
from pathlib import Path

import pytest
from sample_parts import SAMPLES

import beamdae as bd
from beamdae import catalog

PACKAGE = Path(bd.__file__).parent


@pytest.mark.parametrize("package", ["", *catalog.PACKAGES])
def test_type_stubs_are_up_to_date(package):
    stub = PACKAGE / package / "__init__.pyi"
    assert stub.read_text() == catalog.stub_text(package), "run `python beamdae/catalog.py`"


@pytest.mark.parametrize("public", catalog.NAMES.values(), ids=lambda public: public.name)
def test_public_name_is_defined_in_its_module(public):
    value = attrgetter(public.path)(bd)
    assert getattr(value, "__module__", public.module).startswith(public.module)


def test_every_public_name_is_listed_once_in_the_reference():
    names = [public.name for group in catalog.GROUPS for public in group.names]
    assert sorted(names) == sorted(set(names))
    packages = [getattr(bd, name) for name in catalog.PACKAGES]
    public = [*bd.__all__, *(name for package in packages for name in package.__all__)]
    assert sorted([*names, *catalog.PACKAGES]) == sorted(public)
    assert {group.page for group in catalog.GROUPS} == set(catalog.PAGES)


def test_sample_calls_belong_to_public_names_in_the_order_of_the_catalog():
    assert list(SAMPLES) == [name for name in catalog.NAMES if name in SAMPLES]


def test_integrators_of_the_command_line_are_integrators():
    assert len(catalog.INTEGRATORS) >= 4
    for public in catalog.INTEGRATORS.values():
        assert issubclass(getattr(bd, public.name), bd.Integrator)
