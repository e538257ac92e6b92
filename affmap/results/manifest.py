"""The manifest of a report: `provenance.json` lists its stages, and its files with their digests.

A report is not bound to the code that drew it. A digest of that code lies beside it in a file that is not published,
and only decides whether `affmap-report` draws again.
"""

import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from affmap.settings.messages import ConfigError
from affmap.store.files import digests, guarded_read, sha256
from affmap.store.provenance import PROVENANCE
from affmap.store.stage import Stage

PARTS = ("report.md", "report.pdf", "report.html", "figures", "tables")
"""Parts of a report, besides its provenance."""

DRAWN_BY = ".drawn_by"
"""File of a report's folder: the digest of the code that drew it."""


def write(folder: Path, record: Mapping[str, Any]) -> None:
    """Write the manifest of a report whose other files are complete; a folder with a manifest is complete."""
    _write(folder, {**record, "files": _digests(folder)})
    (folder / DRAWN_BY).write_text(code(), "utf-8")


def is_current(folder: Path, record: Mapping[str, Any]) -> bool:
    """Whether a folder holds the report of a record, drawn by this code, with every file intact."""
    path, drawn_by = folder / PROVENANCE, folder / DRAWN_BY
    if not path.is_file() or not drawn_by.is_file() or drawn_by.read_text("utf-8") != code():
        return False
    return _text({**record, "files": _digests(folder)}) == path.read_text("utf-8")


def read(folder: Path) -> dict[str, Any]:
    """The manifest of the report in a folder; empty if there is no report.

    Raises:
        ConfigError: it is corrupted.
    """
    path = folder / PROVENANCE
    if not path.is_file():
        return {}
    with guarded_read(path):
        record: dict[str, Any] = json.loads(path.read_text("utf-8"))
        record["files"].items()
    return record


def stage_digests(folder: Path) -> set[str]:
    """Digests of the stages of the report in a folder; none if it has no stages or does not exist.

    Raises:
        ConfigError: its manifest is corrupted.
    """
    record = read(folder)
    with guarded_read(folder / PROVENANCE):
        return {stage["digest"] for stage in record.get("stages", ())}


def check_output(output: Path, stages: Iterable[Stage]) -> None:
    """Make sure that a report never replaces one of other results; one of older rules may be replaced.

    Args:
        output: the report's folder.
        stages: of the new report.

    Raises:
        ConfigError: the folder holds a report of other stages.
    """
    record = read(output)
    with guarded_read(output / PROVENANCE):
        old = {stage.get("configuration", stage["digest"]) for stage in record.get("stages", ())}
    if not old <= {stage.configuration for stage in stages}:
        raise ConfigError(f"{output} holds the report of other results; say output=runs/<name>, or remove that folder.")


def same_results(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two manifests are of the same results: stages, trials, and compared key."""
    return bool(one) and _results(one) == _results(other)


def _results(record: Mapping[str, Any]) -> tuple[Any, ...]:
    parts = [record, *record.get("experiments", {}).values()]
    stages = {stage["digest"] for part in parts for stage in part.get("stages", ())}
    return record.get("compare"), record.get("trials"), stages


def problems(folder: Path) -> list[str]:
    """Errors in the files of a report, a sentence each.

    Raises:
        ConfigError: its manifest is corrupted.
    """
    record = read(folder)
    if not record:
        return [f"{folder} holds no report."]
    sentences = []
    for name, digest in record["files"].items():
        if not (folder / name).is_file():
            sentences.append(f"{folder / name} is missing.")
        elif sha256(folder / name) != digest:
            sentences.append(f"{folder / name} is not as it was written.")
    return sentences


def copy(folder: Path, target: Path, without: Sequence[str]) -> None:
    """Copy a report, but for logs and files that match one of `without`, replacing `target`."""
    new = target.with_name(f"{target.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    shutil.copytree(folder, new, ignore=shutil.ignore_patterns("jobs", DRAWN_BY, *without))
    for path in folder.glob("*.pdf"):
        shutil.copy(path, new)
    _write(new, {**read(folder), "files": _digests(new)})
    shutil.rmtree(target, ignore_errors=True)
    new.replace(target)


@cache
def code() -> str:
    """A digest of all files of the package that a drawing may depend on."""
    package = Path(__file__).parents[1]
    kinds = (".py", ".typ", ".html", ".js", ".css", ".md", ".mplstyle")
    contents = (path.read_bytes() for path in sorted(package.rglob("*")) if path.suffix in kinds)
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16]


def _digests(folder: Path) -> dict[str, str]:
    return {name: digest for name, digest in digests(folder).items() if Path(name).parts[0] in PARTS}


def _write(folder: Path, record: Mapping[str, Any]) -> None:
    (folder / PROVENANCE).write_text(_text(record), "utf-8", newline="\n")


def _text(record: Mapping[str, Any]) -> str:
    return json.dumps(record, indent=1, ensure_ascii=False, default=dict) + "\n"
