"""Rooms of experiments: found by their folders, each of its files by itself."""

from pathlib import Path

import pytest

import affmap.experiments as rooms
from affmap.report.experiment import PARTS, Room


def test_an_experiment_without_a_folder_has_the_default_room() -> None:
    assert rooms.open_room("mine", None) == Room()
    assert rooms.open_room("replication/exp1", "exp1") == Room(rooms.claims_about("exp1"))


def test_a_page_needs_no_claims(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rooms, "_HERE", tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/page.md").write_text("# Mine\n", "utf-8")
    room = rooms.open_room("mine", None)
    assert room.page == tmp_path / "mine/page.md" and room.folders == (tmp_path / "mine", PARTS)
    assert room.claims == () and list(room.figures) == list(Room().figures)


@pytest.mark.parametrize("name", rooms.ROOMS)
def test_a_room_has_a_page_and_its_claims(name: str) -> None:
    """Each claim once."""
    names = [claim.name for claim in rooms.claims_about(name)]
    assert names and len(names) == len(set(names))
    assert rooms.open_room(name, name).page.parent.name == name
