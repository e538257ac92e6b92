"""Types of values in settings: numbers with limits, names that are safe in paths, lines of text, folders."""

from __future__ import annotations

import os
import unicodedata
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

_PART = "[A-Za-z0-9][A-Za-z0-9_.-]{0,99}"
NAME = f"^{_PART}$"
"""Names that are safe in a path on every system."""

SMALLEST, LARGEST = 1e-12, 1e12
"""Limits of measures. No length, mass, time, rate or weight of an experiment comes near them in any unit, and numbers
between them can be squared and divided in single precision."""


def _number(value: Any) -> Any:
    if isinstance(value, bool):  # which Python counts among the numbers
        raise ValueError("should be a number, not true or false")
    return value


def _not_huge(value: float) -> float:
    if abs(value) > LARGEST:
        raise ValueError(f"should be between {-LARGEST:g} and {LARGEST:g}")
    return value + 0.0  # one zero: -0.0 would be another configuration


def _not_tiny(value: float) -> float:
    if 0 < abs(value) < SMALLEST:
        raise ValueError(f"should be at least {SMALLEST:g}")
    return value


def check_line(text: str) -> str:
    """Return a text for people to read, if it is safe to print.

    Raises:
        ValueError: it has characters that end its line, control a terminal or reverse the direction of the text.
    """
    directions = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
    for c in text:
        if unicodedata.category(c) in {"Cc", "Cs", "Zl", "Zp"} or unicodedata.bidirectional(c) in directions:
            raise ValueError(f"should be a line of text, without characters such as {c!r} that do not print")
    return text


def check_folder(path: Path) -> Path:
    """Return the path of a folder, if it can be used.

    Raises:
        ValueError: it is too long, or does not end in a name (copies of the folder get it), or begins with `~`.
    """
    check_line(str(path))
    # A folder of this name is easily removed with all of one's own.
    if path.parts[:1] and path.parts[0].startswith("~"):
        raise ValueError("should not begin with ~, which only a shell knows; write the path of the folder")
    if path.name in ("", ".."):
        raise ValueError("should be the path of a folder and end in its name")
    if max(len(part.encode()) for part in path.parts) > 255 or len(str(path).encode()) > 3000:
        raise ValueError("should be shorter: systems allow 255 bytes for a name and 4096 for a path")
    return path


def lies_in(path: Path, folder: Path) -> bool:
    """Whether a path is a folder or lies in it, whatever links lead there; neither needs to exist."""
    return _lies_in(os.path.abspath(path), os.path.abspath(folder))


@lru_cache(maxsize=1024)  # jobs of a sweep have the same folders
def _lies_in(path: str, folder: str) -> bool:
    place = Path(os.path.realpath(path))
    return _identity(Path(os.path.realpath(folder))) in map(_identity, (place, *place.parents))


def _identity(path: Path) -> tuple[Any, ...]:
    """The first folder on the way up that exists, and the rest: a mount or another case is no other folder."""
    for parent in (path, *path.parents):
        try:
            status = parent.stat()
        except OSError:
            continue
        return status.st_dev, status.st_ino, path.relative_to(parent)
    return (path,)


Number = Annotated[float, BeforeValidator(_number), AfterValidator(_not_huge)]
"""A number, such as a coordinate."""
Positive = Annotated[Number, Field(gt=0), AfterValidator(_not_tiny)]
"""A measure that cannot be 0."""
Length = Annotated[Positive, Field(ge=1e-6, le=1000)]
"""A length, u. Positions have single precision: less than a millionth is lost in an arena of a few units, and beyond a
thousand, where positions are 0.00006 u apart, Box2D's contacts are."""
NonNegative = Annotated[Number, Field(ge=0), AfterValidator(_not_tiny)]
"""A measure, or 0 where something is not there."""
Share = Annotated[Number, Field(ge=0, le=1)]
"""A part of the whole."""

Count = Annotated[int, BeforeValidator(_number), Field(gt=0, le=10**6)]
"""A number of things: a million at most, a thousand times as many as take days."""
CountOrNone = Annotated[int, BeforeValidator(_number), Field(ge=0, le=10**6)]
"""A number of things, or 0."""
Seed = Annotated[int, BeforeValidator(_number), Field(ge=0, le=10**18)]
"""A seed of random numbers: it must fit 64 bits, also after a member's number has been added to it."""

Line = Annotated[str, Field(strict=True, min_length=1, max_length=500), AfterValidator(check_line)]
"""A text on one line."""
Name = Annotated[str, Field(strict=True, pattern=NAME)]
"""The name of something that has a file or folder of its own."""
NamePath = Annotated[str, Field(strict=True, pattern=f"^{_PART}(/{_PART}){{0,3}}$")]
"""The name of something, perhaps in folders of folders."""
Folder = Annotated[Path, AfterValidator(check_folder)]
