"""The folder of a report: its `provenance.json` says what it was made of, and lists the digests of its files."""

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from affmap.files import digests, sha256
from affmap.provenance import PROVENANCE
from affmap.reading import reading

PARTS = ("report.pdf", "report.html", "figures", "tables")
"""What a report is made of, beside its provenance."""


def seal(folder: Path, record: Mapping[str, Any]) -> None:
    """Write the provenance of a report whose other files are complete; what is there when this is there is whole."""
    _write(folder, {**record, "files": _digests(folder)})


def is_sealed(folder: Path, record: Mapping[str, Any]) -> bool:
    """Whether a folder holds the report of a record, and every file is as it was written."""
    path = folder / PROVENANCE
    return path.is_file() and _text({**record, "files": _digests(folder)}) == path.read_text("utf-8")


def problems(folder: Path) -> list[str]:
    """What is wrong with the files of a report, a sentence each.

    Raises:
        ConfigError: there is no readable provenance.
    """
    path = folder / PROVENANCE
    with reading(path):
        files: dict[str, str] = json.loads(path.read_text("utf-8"))["files"]
    found = []
    for name, digest in files.items():
        if not (folder / name).is_file():
            found.append(f"{folder / name} is missing.")
        elif sha256(folder / name) != digest:
            found.append(f"{folder / name} is not as it was written.")
    return found


def copy(folder: Path, target: Path, without: Sequence[str]) -> None:
    """Copy a report, but for logs and files that match one of `without`, in the stead of what is at `target`."""
    new = target.with_name(f"{target.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    shutil.copytree(folder, new, ignore=shutil.ignore_patterns("jobs", *without))
    for path in folder.glob("*.pdf"):
        shutil.copy(path, new)
    path = new / PROVENANCE
    if path.is_file():  # else it is of a comparison or a search
        _write(new, {**json.loads(path.read_text("utf-8")), "files": _digests(new)})
    shutil.rmtree(target, ignore_errors=True)
    new.replace(target)


def _digests(folder: Path) -> dict[str, str]:
    return {name: digest for name, digest in digests(folder).items() if Path(name).parts[0] in PARTS}


def _write(folder: Path, record: Mapping[str, Any]) -> None:
    (folder / PROVENANCE).write_text(_text(record), "utf-8", newline="\n")


def _text(record: Mapping[str, Any]) -> str:
    return json.dumps(record, indent=1, ensure_ascii=False, default=dict) + "\n"
