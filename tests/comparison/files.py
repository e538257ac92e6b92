"""The files of a working folder that must not change, and how two versions of one differ."""

import csv
import io
from pathlib import Path

PATTERNS = {
    "stages": ["runs/store/*/*"],
    "stage files": ["runs/store/*/*/**/*"],
    "tables": ["runs/*-smoke/**/*.csv", "runs/*-smoke/**/*.md"],
    "figures": ["runs/*-smoke/**/*.png"],
}


def find(folder: Path, kind: str) -> set[str]:
    """Return the paths of a kind below a folder, without those that hold times and the machine."""
    paths = {path for pattern in PATTERNS[kind] for path in folder.glob(pattern)}
    wanted = {path for path in paths if kind == "stages" or (path.is_file() and path.name != "provenance.json")}
    return {path.relative_to(folder).as_posix() for path in wanted}


def difference(name: str, before: Path, after: Path) -> str:
    """Describe how two versions of a file or folder differ; empty if they are equal."""
    old, new = before / name, after / name
    if not (old.exists() and new.exists()):
        return f"{name} is only {'before' if old.exists() else 'after'}"
    if old.is_dir() and new.is_dir():
        return ""
    one, other = _content(old), _content(new)
    if one == other:
        return ""
    same = next((i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
    line = one[:same].count(b"\n") + 1
    return f"{name} differs from byte {same} (line {line}) on"


def _content(path: Path) -> bytes:
    """Return the bytes of a file; those of a table without its columns of times."""
    content = path.read_bytes()
    if path.suffix != ".csv" or b"seconds" not in content.partition(b"\n")[0]:
        return content
    header, *rows = csv.reader(io.StringIO(content.decode("utf-8"), newline=""))
    kept = [index for index, column in enumerate(header) if not column.endswith("seconds")]
    text = io.StringIO()
    csv.writer(text).writerows([row[index] for index in kept] for row in (header, *rows))
    return text.getvalue().encode("utf-8")
