"""Data stored in pages."""

from __future__ import annotations

import json
import math
import re
from copy import deepcopy

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import (
    HALF_STEP,
    ODD_NAMES,
    T,
    build_case,
    curve_block,
    odd_page,
    page_with_files,
    read_page,
    study_page,
    sweep_page,
)

import beamdae as bd
from beamdae.report.page.page_file import list_page_files, write_page


def test_pages_store_all_entries(tmp_path):
    page = study_page() | {"title": "{{script}} {{data}}"}
    before = deepcopy(page)
    path = write_page(tmp_path / "new" / "page.html", page)
    assert page == before
    data = read_page(path)
    for name in ("title", "subtitle", "made", "notes", "columns"):
        assert data[name] == page[name]
    ignored = dict.fromkeys(("curves", "series", "rank", "frames", "at", "file"))
    for actual, expected in zip(data["cases"], page["cases"], strict=True):
        assert actual | ignored == expected | ignored
    actual, expected = data["cases"][0]["curves"], page["cases"][0]["curves"]
    assert_allclose(actual["t"], T, rtol=0, atol=2.0 * HALF_STEP)
    for name, values in expected["observed"].items():
        assert_allclose(actual["observed"][name], values, rtol=0, atol=np.ptp(values) * HALF_STEP)
    frames = data["groups"][0]["frames"]
    assert [(b["name"], b["kind"], b["points"]) for b in frames["bodies"]] == [
        ("ground", "ground", 1),
        ("bar", "beam", 3),
        ("bob", "point", 1),
    ]
    x = np.array(page["groups"][0]["frames"]["bodies"][1]["x"])
    assert_allclose(frames["bodies"][1]["x"].reshape(-1, 3), x, atol=2.0 * HALF_STEP)


def test_errors_keep_their_relative_accuracy_over_many_decades(tmp_path):
    error = [0.0, 1e-15, 3e-9, 2.5e-2]
    page = study_page()
    page["cases"] = [build_case(0, "Ida", 1.0, 1.0, curves={"t": [0, 1, 2, 3], "error": error})]
    curves = read_page(write_page(tmp_path / "page.html", page))["cases"][0]["curves"]
    stored = curves["error"]["error"]
    assert math.isnan(stored[0])
    # 13.4 decades in equal steps of the logarithm.
    assert_allclose(stored[1:], error[1:], rtol=13.4 * HALF_STEP * math.log(10))


def test_missing_and_infinite_numbers_are_stored_as_missing(tmp_path):
    odd, constant = [1.0, math.nan, None, math.inf, -math.inf, 3.0], [0.1] * 6
    page = study_page()
    page["cases"] = [
        build_case(
            0,
            "Ida",
            math.nan,
            math.inf,
            curves={"t": [*range(6)], "observed": {"x": odd, "y": constant}},
        )
        | {"values": {"steps": -math.inf}},
        build_case(1, "Ida", 1.0, 1.0, curves={"t": [0, 1], "observed": {"x": [None, math.nan]}}),
    ]
    first, second = read_page(write_page(tmp_path / "page.html", page))["cases"]
    assert (first["error"], first["cost"], first["values"]["steps"]) == (None, None, None)
    assert_allclose(first["curves"]["observed"]["x"], [1.0, *[math.nan] * 4, 3.0])
    assert first["curves"]["observed"]["y"].tolist() == constant
    assert np.isnan(second["curves"]["observed"]["x"]).all()


def test_names_cannot_end_the_data_and_nothing_is_loaded(tmp_path):
    text = write_page(tmp_path / "page.html", study_page()).read_text()
    assert text.count("</script>") == 3
    assert "<b>" not in text
    assert f"<title>{study_page()['title']}</title>" not in text
    # The namespace of SVG is an identifier, not an address.
    addresses = set(re.findall(r"https?://[^\s\"'`]*", text))
    assert all(address.startswith("http://www.w3.org/") for address in addresses)
    own = text.replace(re.findall(r"<script>\s*(var echarts=.*?)</script>", text, re.DOTALL)[0], "")
    assert not re.search(r"\b(src|href)\s*=|@import|url\((?!#)", own)


@pytest.mark.parametrize(
    ("page", "message"),
    [
        (
            {"cases": [{"id": "0", "group": "a"}]},
            r"^page: case '0' refers to the unknown group 'a'; add the group or correct",
        ),
        (
            {"groups": [{"id": "a"}, {"id": "a"}]},
            r"^page: the id 'a' of a group is used twice; use different ids\.$",
        ),
        (
            {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}] * 2},
            r"^page: the id '0' of a case is used twice; use different ids\.$",
        ),
    ],
)
def test_inconsistent_ids_are_rejected(tmp_path, page, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        write_page(tmp_path / "page.html", page)
    assert not list(tmp_path.iterdir())


def test_odd_names_are_stored_unchanged(tmp_path):
    text = write_page(tmp_path / "page.html", odd_page()).read_text(encoding="utf-8")
    assert text.count("</script>") == 3
    own = re.sub(r"<script>\s*var echarts=.*?</script>", "", text, flags=re.DOTALL)
    assert not set(map(chr, [*range(9), *range(14, 32), 0x2028])) & set(own)
    (json_text,) = re.findall(r'id="data">(.*?)</script>', text, re.DOTALL)
    data = json.loads(json_text)
    assert data["title"] == "".join(ODD_NAMES)
    assert data["cases"][4]["values"]["u16"] == "u16"


def test_files_of_curves_are_replaced_and_removed(tmp_path):
    path, folder = tmp_path / "a #1.html", tmp_path / "a #1_curves"
    page = page_with_files()
    assert "'self' file:" in write_page(path, page).read_text()
    assert sorted(x.name for x in folder.iterdir()) == ["curves_0.js", "curves_1.js"]
    assert '"curve_files":["a%20%231_curves/curves_0.js","a%20%231_curves/' in path.read_text()
    (folder / "mine.js").write_text("")
    write_page(path, page | {"curve_files": page["curve_files"][:1]})
    assert list_page_files(path) == [path, folder]
    assert sorted(x.name for x in folder.iterdir()) == ["curves_0.js", "mine.js"]
    (folder / "mine.js").unlink()
    assert "'self' file:" not in write_page(path, sweep_page()).read_text()
    assert not folder.exists()


def test_regression_pages_with_the_same_stem_have_their_own_curves(tmp_path):
    """Each page removed the curves of the other."""
    for name in ("a.html", "a.htm", "a"):
        write_page(tmp_path / name, page_with_files())
    write_page(tmp_path / "a.html", sweep_page())
    assert not (tmp_path / "a_curves").exists()
    for folder in ("a.htm_curves", "a._curves"):
        assert len(list((tmp_path / folder).iterdir())) == 2


def test_regression_links_in_place_of_folders_of_curves_are_not_followed(tmp_path):
    """Files were removed from and written to the folder that the link named."""
    page, path = page_with_files(), tmp_path / "page.html"
    write_page(path, page)
    (tmp_path / "page_curves").rename(tmp_path / "mine")
    names = sorted((tmp_path / "mine").iterdir())
    (tmp_path / "page_curves").symlink_to(tmp_path / "mine")
    with pytest.raises(
        bd.BeamdaeError, match="page_curves: the path must be a folder, but is a link"
    ):
        write_page(path, page | {"curve_files": [curve_block(5)]})
    write_page(path, sweep_page())
    assert sorted((tmp_path / "mine").iterdir()) == names
