"""Versions of installed packages."""

from importlib import metadata

import pytest

from beamdae import package_versions


@pytest.mark.parametrize("name", ["beamdae", "scikit-sundae", "SciPy", "import_linter"])
def test_versions_agree_with_the_metadata(name):
    assert package_versions.installed_version(name) == metadata.version(name)


def test_a_package_that_is_not_installed_has_no_version():
    assert package_versions.installed_version("beamdae-that-nobody-wrote") is None


def test_the_first_folder_of_the_path_wins(tmp_path, monkeypatch):
    for folder, version in (("one", "2.0"), ("two", "1.0")):
        (tmp_path / folder / f"two_part.name-{version}.dist-info").mkdir(parents=True)
    monkeypatch.setattr("sys.path", [str(tmp_path / "none"), *map(str, sorted(tmp_path.iterdir()))])
    package_versions._versions_by_folder.cache_clear()
    try:
        assert package_versions._versions_by_folder() == {"two_part_name": "2.0"}
    finally:
        package_versions._versions_by_folder.cache_clear()
