"""The manifest of a report: `provenance.json` lists its stages, and its files with their digests.

It has a checksum of its own, and is written last: a folder with a manifest is complete. A report is not bound to the
code that drew it. A digest of that code lies beside it in a file that is not published, and only decides whether
`affmap-report` draws again.
"""

import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatch
from functools import cache
from pathlib import Path, PurePath
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, StringConstraints

from affmap.settings import extensions
from affmap.settings.messages import ConfigError
from affmap.settings.types import lies_in
from affmap.store.files import atomic_write, copy_files, digests, named_errors, read_json, replace_folder, sha256
from affmap.store.provenance import PROVENANCE, has_valid_checksum, with_checksum
from affmap.store.stage import Stage

DRAWN_BY = ".drawn_by"
"""File of a report's folder: the digest of the code that drew it."""


class _Stage(BaseModel):
    digest: str
    configuration: str | None = None


class _Part(BaseModel):
    model_config = ConfigDict(strict=True)

    stages: list[_Stage] = []


class _Manifest(_Part):
    """A manifest, as far as it is used."""

    files: dict[Annotated[str, StringConstraints(pattern=r"^[^/\x00]+(/[^/\x00]+)*$")], str]
    experiments: dict[str, _Part] = {}


def write(folder: Path, record: Mapping[str, Any], drawn: Path) -> None:
    """Move the files of a drawing into the folder of their report, replacing an earlier report, and list them.

    Other files in the folder are left alone.

    Args:
        folder: of the report.
        record: everything that the report depends on.
        drawn: a folder with all files of the report, and no others.
    """
    earlier, files = read_intact(folder), digests(drawn)
    for name, digest in earlier.get("files", {}).items():
        if name not in files and _digest(folder, name) == digest:
            (folder / name).unlink()
    for path in [folder / PROVENANCE, *folder.glob(f"{PROVENANCE}.*.tmp")]:  # the latter of a command that was killed
        path.unlink(missing_ok=True)
    for name in files:
        parent = (folder / name).parent
        if parent != folder and parent.is_symlink():
            parent.unlink()  # nothing is written outside of the folder
        parent.mkdir(parents=True, exist_ok=True)
        with named_errors(folder / name):
            shutil.move(drawn / name, folder / name)
    (folder / DRAWN_BY).write_text(code(), "utf-8")
    save(folder, record, files)


def save(folder: Path, record: Mapping[str, Any], files: Mapping[str, str]) -> None:
    """Write a manifest with a checksum.

    Args:
        folder: of the report.
        record: everything that the report depends on.
        files: name of each of its files -> digest.
    """
    with atomic_write(folder / PROVENANCE) as path:
        path.write_text(_text(record, files), "utf-8", newline="\n")


def is_current(folder: Path, record: Mapping[str, Any]) -> bool:
    """Whether a folder holds the report of a record, drawn by this code, with every file intact."""
    manifest, drawn_by = read_intact(folder), folder / DRAWN_BY
    if not manifest or problems(folder) or not drawn_by.is_file() or drawn_by.read_bytes() != code().encode():
        return False
    return _text(record, manifest["files"]).encode() == (folder / PROVENANCE).read_bytes()


def read(folder: Path) -> dict[str, Any]:
    """The manifest of the report in a folder; empty if there is no report.

    Raises:
        ConfigError: it is corrupted.
    """
    record = read_intact(folder)
    if not record and (folder / PROVENANCE).exists():
        raise ConfigError(
            f"{folder / PROVENANCE} is corrupted, or another version of affmap wrote it; restore it, or make the "
            "report anew with affmap-report (affmap-publish, if it is a published one)."
        )
    return record


def read_intact(folder: Path) -> dict[str, Any]:
    """The manifest of the report in a folder; empty if there is none, or a corrupted one: it is made anew."""
    try:
        record: dict[str, Any] = read_json(folder / PROVENANCE)
        _Manifest.model_validate(record)
        return record if has_valid_checksum(record) else {}
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return {}


def stage_digests(folder: Path) -> set[str]:
    """Digests of the stages of the report in a folder; none if it has no stages or does not exist.

    Raises:
        ConfigError: its manifest is corrupted.
    """
    return {stage["digest"] for stage in read(folder).get("stages", ())}


def check_output(output: Path, stages: Iterable[Stage]) -> None:
    """Make sure that a report never replaces one of other results; one of older rules, or corrupted, may be replaced.

    Args:
        output: the report's folder.
        stages: of the new report.

    Raises:
        ConfigError: the folder holds a report of other stages, or it can be none.
    """
    check_place(output)
    if holds_others(output, stages):
        raise ConfigError(f"{output} holds the report of other results; say output=runs/<name>, or remove that folder.")


def check_place(output: Path) -> None:
    """Make sure that a folder is there, or can be made.

    Raises:
        ConfigError: a file is in its place, or on the way.
    """
    there = next(place for place in (output, *output.absolute().parents) if place.exists())
    if not there.is_dir():
        raise ConfigError(f"output = {output} cannot be made: {there} is a file; say output=runs/<name>.")


def holds_others(output: Path, stages: Iterable[Stage]) -> bool:
    """Whether a folder holds an intact report of a stage that is not among `stages`, whatever the version of its rules.

    Args:
        output: the report's folder.
        stages: of the expected report.
    """
    stages_there = read_intact(output).get("stages", ())
    old = {stage.get("configuration", stage["digest"]) for stage in stages_there}
    return not old <= {stage.configuration for stage in stages}


def same_results(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two manifests are of the same results: stages, trials, and compared key."""
    return bool(one) and _results(one) == _results(other)


def _results(record: Mapping[str, Any]) -> tuple[Any, ...]:
    parts = [record, *record.get("experiments", {}).values()]
    stages = {stage["digest"] for part in parts for stage in part.get("stages", ())}
    return record.get("compare"), record.get("trials"), stages


def problems(folder: Path, others: bool = True) -> list[str]:
    """Errors in the files of a report, a sentence each.

    Args:
        folder: of the report.
        others: whether the folder may hold files that are not the report's; hidden ones are always allowed.
    """
    try:
        record = read(folder)
    except ConfigError as error:
        return [str(error)]
    if not record:
        return [f"{folder} holds no report."]
    sentences = []
    for name, digest in record["files"].items():
        actual = _digest(folder, name)
        if actual is None:
            sentences.append(f"{folder / name} is missing.")
        elif actual != digest:
            sentences.append(f"{folder / name} is not as it was written.")
    if not others:
        known = {folder / name for name in (PROVENANCE, *record["files"])}
        sentences += [f"{path} does not belong there." for path in visible_files(folder) if path not in known]
    return sentences


def visible_files(folder: Path) -> list[Path]:
    """All files and links below a folder, sorted, but for hidden ones and those in hidden folders."""
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file() or path.is_symlink())
    return [path for path in paths if not any(part.startswith(".") for part in path.relative_to(folder).parts)]


def copy(folder: Path, target: Path, without: Sequence[str]) -> None:
    """Copy the files that the manifest of a report lists into a folder of their own, replacing an earlier copy.

    Args:
        folder: of the report.
        target: the folder of the copy.
        without: patterns of files and folders that are left out; a PDF beside the manifest never is.

    Raises:
        ConfigError: a file of the report is not as it was written; or `target` is no earlier copy of it; or one of the
            two folders is the other, or lies in it.
    """
    if lies_in(folder, target) or lies_in(target, folder):
        raise ConfigError(
            f"{folder} would be published as {target}, which would replace it; say reference=<folder>/store with a "
            "folder that is not that of the reports, such as runs/reference."
        )
    if sentences := problems(folder):
        raise ConfigError("\n".join([*sentences, "Run affmap-report again, which makes the report anew."]))
    record = read(folder)
    _check_replaceable(target, record)
    files = {name: digest for name, digest in record["files"].items() if _is_kept(PurePath(name), without)}
    new = target.with_name(f".{target.name}.new")
    copy_files(folder, new, files)
    if digests(new) != files:
        raise ConfigError(f"{folder} was changed while it was copied; run the same command again.")
    save(new, record, files)
    replace_folder(new, target)


def _check_replaceable(target: Path, record: Mapping[str, Any]) -> None:
    """Make sure that a copy of a report replaces nothing but an earlier one, and is not put into another report.

    An earlier copy has a manifest, which may be torn, the same title, and no files but those that are listed.

    Raises:
        ConfigError: something else is there.
    """
    earlier = read_intact(target)
    known = {target / name for name in (PROVENANCE, *(earlier or record)["files"])}
    strangers = [path for path in ([target] if target.is_file() else visible_files(target)) if path not in known]
    around = [folder for folder in target.parents if read_intact(folder)]
    if around:
        reason = f"lies in the report {around[0]}"
    elif strangers:
        reason = f"has {strangers[0]}, which is not of this report"
    elif earlier and earlier.get("title") != record.get("title"):
        reason = f"is the report {earlier.get('title')!r}"
    elif visible_files(target) and not (target / PROVENANCE).is_file():
        reason = f"has no {PROVENANCE}"
    else:
        return
    raise ConfigError(
        f"the report would be published as {target}, which {reason}; give output= another name, or move what is there."
    )


def _is_kept(name: PurePath, without: Sequence[str]) -> bool:
    if name.match("*.pdf") and len(name.parts) == 1:
        return True
    return not any(fnmatch(part, pattern) for part in name.parts for pattern in without)


@cache
def code() -> str:
    """A digest of all files that a drawing may depend on: those of the package, and modules of users."""
    package = Path(__file__).parents[1]
    kinds = (".py", ".typ", ".html", ".js", ".css", ".md", ".mplstyle")
    paths = [path for path in sorted(package.rglob("*")) if path.suffix in kinds]
    contents = [path.read_bytes() for path in (*paths, *extensions.sources())]
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16]


def _digest(folder: Path, name: str) -> str | None:
    """The digest of a file of a report; None if there is no such file inside the folder, but a link out of it, say."""
    path = folder / name
    is_own = path.resolve() == folder.resolve() / name
    return sha256(path) if is_own and path.is_file() else None


def _text(record: Mapping[str, Any], files: Mapping[str, str]) -> str:
    """The text of a manifest; `record` may be one, whose files and checksum are replaced."""
    values = json.loads(json.dumps({**record, "files": files}, default=dict))
    return json.dumps(with_checksum(values), indent=1, ensure_ascii=False) + "\n"
