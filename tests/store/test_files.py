"""Files that are whole or not there: against kills in the middle of writing, and SHA-256 known beforehand."""

import json
from pathlib import Path

import pytest

from affmap.store.files import atomic_write, digests, sha256, sync, write_json


def test_a_file_is_the_old_one_until_it_is_the_new_one(tmp_path: Path) -> None:
    """Written twice, the second time interrupted: the first content stands, and the third attempt replaces it."""
    path = tmp_path / "file.txt"
    with atomic_write(path) as place:
        place.write_text("first")
        assert not path.exists()

    def interrupted() -> None:
        with atomic_write(path) as place:
            place.write_text("half of the sec")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "first" and [each.name for each in tmp_path.iterdir()] == ["file.txt"]
    with atomic_write(path) as place:
        place.write_text("third")
    assert path.read_text() == "third" and [each.name for each in tmp_path.iterdir()] == ["file.txt"]


def test_json_comes_back(tmp_path: Path) -> None:
    value = {"a": [1, 2.5, None], "b": "ä"}
    write_json(tmp_path / "value.json", value)
    assert json.loads((tmp_path / "value.json").read_text("utf-8")) == value


def test_digests_are_those_of_the_standard(tmp_path: Path) -> None:
    """The empty text and "abc" (FIPS 180-4), in the order of names, folders included."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "z").write_bytes(b"")
    (tmp_path / "sub" / "a").write_bytes(b"abc")
    empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
    abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert list(digests(tmp_path).items()) == [("sub/a", abc), ("z", empty)]
    assert sha256(tmp_path / "z") == empty
    sync(tmp_path)
