"""Pictures of stored results: drawn again only if something that they show has changed."""

from __future__ import annotations

import pytest

from beamdae.studies.store.drawn_files import draw_unless_unchanged


@pytest.fixture
def draw(tmp_path):
    calls = []

    def write():
        calls.append(len(calls))
        paths = [tmp_path / "curve.png", tmp_path / "curve.svg"]
        for path in paths:
            path.write_text(f"picture {len(calls)}")
        return paths

    write.calls = calls
    return write


def test_pictures_of_the_same_content_are_drawn_once(tmp_path, draw):
    first = draw_unless_unchanged(tmp_path, "curve", (1.0, "tip"), draw)
    assert draw_unless_unchanged(tmp_path, "curve", (1.0, "tip"), draw) == first
    assert len(draw.calls) == 1
    assert [path.read_text() for path in first] == ["picture 1"] * 2


@pytest.mark.parametrize("change", ["content", "edit", "removal", "record", "settings"])
def test_pictures_are_drawn_again_after_a_change(tmp_path, draw, change, monkeypatch):
    content, record = (1.0, "tip"), tmp_path / "outcomes" / "curve.drawn"
    paths = draw_unless_unchanged(tmp_path, "curve", content, draw)
    if change == "content":
        content = (1.0 + 1e-15, "tip")
    elif change == "edit":
        paths[1].write_text("another picture")
    elif change == "removal":
        paths[0].unlink()
    elif change == "record":
        record.write_text("[1")
    else:
        (tmp_path / "matplotlibrc").write_text("lines.linewidth: 3")
        monkeypatch.setenv("MATPLOTLIBRC", str(tmp_path))
    draw_unless_unchanged(tmp_path, "curve", content, draw)
    assert len(draw.calls) == 2
    assert paths[0].read_text() == "picture 2"


def test_a_record_cannot_name_files_outside_the_folder(tmp_path, draw):
    (path, *_) = draw_unless_unchanged(tmp_path, "curve", 1.0, draw)
    record = tmp_path / "outcomes" / "curve.drawn"
    record.write_text(record.read_text().replace(path.name, f"../elsewhere/{path.name}"))
    files = draw_unless_unchanged(tmp_path, "curve", 1.0, draw)
    assert {file.parent for file in files} == {tmp_path}
