"""The folder of a report: its `provenance.json` says what it was made of, by which code, with digests of its files."""

import hashlib
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

HERE = Path(__file__).parent


def seal(folder: Path, record: Mapping[str, Any]) -> None:
    """Write the provenance of a report whose other files are complete; what is there when this is there is whole."""
    _write(folder, _complete(folder, record))


def is_sealed(folder: Path, record: Mapping[str, Any]) -> bool:
    """Whether a folder holds the report of a record by this code, and every file is as it was written."""
    path = folder / PROVENANCE
    return path.is_file() and _text(_complete(folder, record)) == path.read_text("utf-8")


def read(folder: Path) -> dict[str, Any]:
    """The provenance of the report in a folder; empty where there is no report.

    Raises:
        ConfigError: it is damaged.
    """
    path = folder / PROVENANCE
    if not path.is_file():
        return {}
    with reading(path):
        record: dict[str, Any] = json.loads(path.read_text("utf-8"))
        record["code"], record["files"].items()
    return record


def problems(folder: Path) -> list[str]:
    """What is wrong with a report, a sentence each.

    Raises:
        ConfigError: its provenance is damaged.
    """
    record = read(folder)
    if not record:
        return [f"{folder} holds no report."]
    found = []
    for name, digest in record["files"].items():
        if not (folder / name).is_file():
            found.append(f"{folder / name} is missing.")
        elif sha256(folder / name) != digest:
            found.append(f"{folder / name} is not as it was written.")
    if record["code"] != code():
        found.append(f"{folder} was made by another version of the report's code; affmap-report makes it anew.")
    return found


def copy(folder: Path, target: Path, without: Sequence[str]) -> None:
    """Copy a report, but for logs and files that match one of `without`, in the stead of what is at `target`."""
    new = target.with_name(f"{target.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    shutil.copytree(folder, new, ignore=shutil.ignore_patterns("jobs", *without))
    for path in folder.glob("*.pdf"):
        shutil.copy(path, new)
    _write(new, {**read(folder), "files": _digests(new)})
    shutil.rmtree(target, ignore_errors=True)
    new.replace(target)


def code() -> str:
    """A digest of this package's own files."""
    files = sorted(path for path in HERE.rglob("*") if path.suffix in (".py", ".typ", ".jinja", ".js", ".css", ".md"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def _complete(folder: Path, record: Mapping[str, Any]) -> dict[str, Any]:
    return {**record, "code": code(), "files": _digests(folder)}


def _digests(folder: Path) -> dict[str, str]:
    return {name: digest for name, digest in digests(folder).items() if Path(name).parts[0] in PARTS}


def _write(folder: Path, record: Mapping[str, Any]) -> None:
    (folder / PROVENANCE).write_text(_text(record), "utf-8", newline="\n")


def _text(record: Mapping[str, Any]) -> str:
    return json.dumps(record, indent=1, ensure_ascii=False, default=dict) + "\n"
