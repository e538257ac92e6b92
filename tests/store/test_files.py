"""Files that are whole or not there: against kills in the middle of writing, and SHA-256 known beforehand.

Files that were made to harm, with sizes that no machine has, are reported before anything is read.
"""

import errno
import fcntl
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from traces import Trace

from affmap.settings import ConfigError
from affmap.store.files import (
    LARGEST_JSON,
    atomic_write,
    check_locks,
    digests,
    locked,
    read_arrays,
    read_json,
    sha256,
    sync,
    write_json,
)


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


def test_a_file_is_flushed_before_it_has_its_name_and_its_folder_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As traced: a power cut at any moment leaves the old file or the new one, and the last one written is there."""
    trace = Trace(monkeypatch)
    for number in range(2):
        write_json(tmp_path / "value.json", number)
        assert trace.renamed == [tmp_path / "value.json"] * (number + 1)
        assert trace.is_flushed(tmp_path)


def npz(path: Path, header: str, content: bytes = bytes(16)) -> Path:
    """An archive of one array with a given header."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + content)
    return path


SHAPES = ["(1000000000000000,)", "(2, -1)", "(-1, -2)", f"(0, {10**30})", "(3,)", "()", "(1.5,)", "'a'", "[2]", "None"]
TYPES = ["'|O'", "'<U2'", "'|V8'", "'<M8[ns]'", "[('a', '<f8')]", "{}", "[]", "None", "'('", "'<U1000000000'"]
HEADERS = [
    *(f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}" for shape in SHAPES),
    *(f"{{'descr': {descr}, 'fortran_order': False, 'shape': (2,)}}" for descr in TYPES),
    *("{'descr': '<f8', 'fortran_order': 7, 'shape': (2,)}", "{'shape': (2,)}", "[]", "", "\0", "'a'.b"),
    *("(" * 9000, "-" * 9000 + "1", "9" * 9000, "[" * 900, "__import__('os').mkdir('canary')"),
]


def test_a_whole_array_comes_back(tmp_path: Path) -> None:
    """The case beside those of the next test: two numbers in 16 bytes."""
    path = npz(
        tmp_path / "a.npz", "{'descr': '<f8', 'fortran_order': False, 'shape': (2,)}", np.array([1.0, 2]).tobytes()
    )
    assert read_arrays(path)["a"].tolist() == [1, 2]


def test_sizes_and_types_in_the_header_of_an_array_are_not_believed(
    tmp_path: Path, tried: Callable[[str, int, str], None]
) -> None:
    """Of 16 bytes: none is allocated for, none is executed, each is one sentence."""
    for header in HEADERS:
        with pytest.raises(ConfigError, match=r"^[^\n]*a\.npz cannot be read \(.*; remove its folder and run again\.$"):
            read_arrays(npz(tmp_path / "a.npz", header))
    np.save(tmp_path / "one.npy", np.zeros(2))
    with pytest.raises(ConfigError, match=r"one\.npy cannot be read"):
        read_arrays(tmp_path / "one.npy")
    tried("crafted header of an array in a stage", len(HEADERS), "reported as damage, nothing allocated or executed")


def test_an_archive_that_explodes_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes in its list that cannot come out of it, or of parts that overlap; and a real one, too large for memory."""
    path = tmp_path / "a.npz"
    header = "{'descr': '|u1', 'fortran_order': False, 'shape': (1000000000000000,)}"
    whole = npz(path, header).read_bytes()
    size = (len(header) + 26).to_bytes(4, "little")
    assert whole.count(size) >= 2
    path.write_bytes(whole.replace(size, (2**32 - 2).to_bytes(4, "little")))
    with pytest.raises(ConfigError, match="cannot come out of so short a file"):
        read_arrays(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", b"a" * 100_000)
        archive.filelist *= 100
    with pytest.raises(ConfigError, match="cannot come out of so short a file"):
        read_arrays(path)
    np.savez_compressed(path, a=np.zeros(100_000))
    assert len(read_arrays(path)["a"]) == 100_000
    monkeypatch.setattr(os, "sysconf", lambda name: 800)
    with pytest.raises(ConfigError, match="it needs more memory than there is; read it on a larger machine or"):
        read_arrays(path)


def test_json_that_is_no_record_of_ours_is_an_error(tmp_path: Path) -> None:
    """A file of holes that is too long, which takes no time; one level too many; and what is no JSON."""
    path = tmp_path / "value.json"
    with path.open("wb") as file:
        file.truncate(LARGEST_JSON + 1)
    with pytest.raises(ValueError, match="134217729 bytes of JSON are too many"):
        read_json(path)
    for text in ("[" * 100_000 + "]" * 100_000, '{"a":' * 100_000, "9" * 5000, "", "{", "\udcff"):
        path.write_bytes(text.encode("utf-8", "surrogateescape"))
        with pytest.raises(ValueError, match=r"."):
            read_json(path)


def test_what_systems_leave_behind_is_none_of_our_files(tmp_path: Path) -> None:
    """Of macOS, Windows, NFS, FUSE, SMB, Synology, editors and Jupyter, in a folder and below it."""
    for name in LEFT_BEHIND:
        for folder in (tmp_path, tmp_path / "tables"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("left behind")
    (tmp_path / "empty").mkdir()
    assert digests(tmp_path) == {}
    (tmp_path / "tables" / "runs.csv").write_bytes(b"abc")
    assert list(digests(tmp_path)) == ["tables/runs.csv"]


LEFT_BEHIND = [
    *(".DS_Store", "._runs.csv", ".AppleDouble/runs.csv", "__MACOSX/._runs.csv", "Icon\r", ".localized"),
    *("Thumbs.db", "desktop.ini", ".nfs0000000000a1b2c3", ".fuse_hidden0000001a00000001", ".smbdelete123"),
    *("@eaDir/runs.csv@SynoEAStream", ".runs.csv.swp", "runs.csv~", "#runs.csv#", ".#runs.csv", ".~lock.runs.csv#"),
    *(".ipynb_checkpoints/runs-checkpoint.csv", ".directory", ".goutputstream-ABC", "lost+found/#1234"),
]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="only Linux has this folder, where nobody makes files")
def test_a_place_without_files_is_an_error_and_no_wait() -> None:
    """A file that cannot be made is none that another process holds."""
    with pytest.raises(OSError, match=r"/proc/a\.lock"), locked(Path("/proc/a.lock"), "another"):
        pytest.fail("it went on")


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_a_disk_without_locks_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    """One sentence with the folder and the remedy; no lock that is a mere file, and would outlive a killed job."""

    def refuse(*_: object) -> NoReturn:
        raise OSError(number, os.strerror(number))

    check_locks(tmp_path / "store")
    assert list((tmp_path / "store").iterdir()) == []
    monkeypatch.setattr(fcntl, "flock", refuse)
    sentence = (
        f"^{tmp_path} is on a disk without locks .* mount it with locks, or say store= and output= with folders of"
    )
    with pytest.raises(ConfigError, match=sentence), locked(tmp_path / "a.lock", "another"):
        pytest.fail("it went on")
    with pytest.raises(ConfigError, match=sentence):
        check_locks(tmp_path)
