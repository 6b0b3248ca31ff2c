"""The page of a study: what is stored in it."""

from __future__ import annotations

import base64
import json
import math
import re
from copy import deepcopy

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import NAMES, T, bar, case, odd_names, study

import beamdae as bd
from beamdae.report.page.page_file import write_page


def stored(path):
    """The data in a file, with packed lists as lists."""
    (text,) = re.findall(
        r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.DOTALL
    )
    return json.loads(text, object_hook=unpacked)


def unpacked(value):
    if "u16" not in value:
        return value
    codes = np.frombuffer(base64.b64decode(value["u16"]), "<u2")
    numbers = value["low"] + value["step"] * codes
    numbers = np.where(codes == 65535, math.nan, 10.0**numbers if value["log"] else numbers)
    return numbers


def test_what_is_written_is_read_again(tmp_path):
    page = study()
    before = deepcopy(page)
    path = write_page(tmp_path / "new" / "page.html", page)
    assert page == before
    data = stored(path)
    for name in ("title", "subtitle", "made", "notes", "columns"):
        assert data[name] == page[name]
    apart = dict.fromkeys(("curves", "series", "rank"))
    for one, given in zip(data["cases"], page["cases"], strict=True):
        assert one | apart == given | apart
    read, given = data["cases"][0]["curves"], page["cases"][0]["curves"]
    # Half of a 65534th of the range.
    assert_allclose(read["t"], T, rtol=0, atol=2.0 / 65534 / 2)
    for name, values in given["observed"].items():
        assert_allclose(read["observed"][name], values, rtol=0, atol=np.ptp(values) / 65534 / 2)
    frames = data["groups"][0]["frames"]
    assert [(b["name"], b["kind"], b["points"]) for b in frames["bodies"]] == [
        ("ground", "ground", 1),
        ("bar", "beam", 3),
        ("bob", "point", 1),
    ]
    places = np.array(page["groups"][0]["frames"]["bodies"][1]["x"])
    assert_allclose(frames["bodies"][1]["x"].reshape(-1, 3), places, atol=2.0 / 65534 / 2)


def test_errors_keep_their_digits_over_many_decades(tmp_path):
    error = [0.0, 1e-15, 3e-9, 2.5e-2]
    page = study()
    page["cases"] = [case(0, "Ida", 1.0, 1.0, curves={"t": [0, 1, 2, 3], "error": error})]
    read = stored(write_page(tmp_path / "page.html", page))["cases"][0]["curves"]["error"]["error"]
    assert math.isnan(read[0])
    # Half a step of 13 decades / 65534, times ln 10.
    assert_allclose(read[1:], error[1:], rtol=13.4 / 65534 / 2 * math.log(10))


def test_missing_and_infinite_numbers(tmp_path):
    odd = [1.0, math.nan, None, math.inf, -math.inf, 3.0]
    page = study()
    page["cases"] = [
        case(0, "Ida", math.nan, math.inf, curves={"t": [*range(6)], "observed": {"x": odd}})
        | {"values": {"steps": -math.inf}},
        case(1, "Ida", 1.0, 1.0, curves={"t": [0, 1], "observed": {"x": [None, math.nan]}}),
    ]
    one, other = stored(write_page(tmp_path / "page.html", page))["cases"]
    assert (one["error"], one["cost"], one["values"]["steps"]) == (None, None, None)
    assert_allclose(one["curves"]["observed"]["x"], [1.0, *[math.nan] * 4, 3.0])
    assert np.isnan(other["curves"]["observed"]["x"]).all()


def test_a_constant_is_stored_exactly(tmp_path):
    drift = [0.1] * 3
    page = study()
    page["cases"] = [case(0, "Ida", 1.0, 1.0, curves={"t": [0, 1, 2], "observed": {"x": drift}})]
    read = stored(write_page(tmp_path / "page.html", page))["cases"][0]["curves"]
    assert read["observed"]["x"].tolist() == drift


def test_no_name_ends_the_data_and_nothing_is_loaded(tmp_path):
    text = write_page(tmp_path / "page.html", study()).read_text()
    assert text.count("</script>") == 2
    assert "<b>" not in text
    assert f"<title>{study()['title']}</title>" not in text
    # The namespace of SVG is a name, not an address.
    assert set(re.findall(r"https?://[^\s\"']*", text)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"\b(src|href)\s*=|@import|url\((?!#)", text)


def test_placeholders_in_names_stay(tmp_path):
    page = study() | {"title": "{{script}} {{data}}"}
    path = write_page(tmp_path / "page.html", page)
    assert stored(path)["title"] == page["title"]
    assert "<title>{{script}} {{data}}</title>" in path.read_text()


def test_sixty_cases_of_two_hundred_points_are_far_less_than_a_megabyte(tmp_path):
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 200).tolist()

    def noise(*names):
        return {name: rng.standard_normal(200).tolist() for name in names}

    drawn = {
        "t": t,
        "observed": noise(*"abcdefgh"),
        "energy": noise("kinetic", "strain", "imbalance"),
        **noise("error", "position drift", "velocity drift"),
    }
    page = study()
    page["cases"] = [case(k, f"Ida(rtol={k})", 1.0, 1.0, curves=drawn) for k in range(60)]
    page["groups"][0]["frames"] = bar(frames=120)
    assert write_page(tmp_path / "page.html", page).stat().st_size < 0.7e6


def test_only_what_is_said_to_be_a_series_is_joined(tmp_path):
    page = study()
    page["cases"] = [case(0, "Ida(rtol=1e-3)", 1.0, 1.0)]
    del page["cases"][0]["series"]
    page["cases"].append(case(1, "Ida(rtol=1e-4)", 1.0, 1.0, series="given"))
    data = stored(write_page(tmp_path / "page.html", page))
    assert [entry["series"] for entry in data["cases"]] == [None, "given"]


def test_all_but_ids_may_be_missing(tmp_path):
    page = {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}]}
    data = stored(write_page(tmp_path / "page.html", page))
    assert data["title"] == ""
    assert data["groups"][0]["frames"] is None
    assert data["cases"][0]["status"] == "ok"
    assert data["cases"][0]["curves"] is None


@pytest.mark.parametrize(
    ("page", "message"),
    [
        (
            {"cases": [{"id": "0", "group": "a"}]},
            r"^page: the case '0' belongs to no group\.$",
        ),
        (
            {"groups": [{"id": "a"}, {"id": "a"}]},
            r"^page: the id 'a' of a group is taken\.$",
        ),
        (
            {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}] * 2},
            r"^page: the id '0' of a case is taken\.$",
        ),
    ],
)
def test_refusals(tmp_path, page, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        write_page(tmp_path / "page.html", page)
    assert not list(tmp_path.iterdir())


def test_page_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(bd.BeamdaeError, match=r"page\.html: it cannot be written"):
        write_page(tmp_path / "file" / "page.html", study())


def test_names_of_users_are_stored_as_they_are(tmp_path):
    text = write_page(tmp_path / "page.html", odd_names()).read_text(encoding="utf-8")
    assert text.count("</script>") == 2
    assert not set(map(chr, [*range(9), *range(14, 32), 0x2028])) & set(text)
    (stored_text,) = re.findall(r'id="data">(.*?)</script>', text, re.DOTALL)
    data = json.loads(stored_text)
    assert data["title"] == "".join(NAMES)
    assert data["cases"][4]["values"]["u16"] == "u16"
