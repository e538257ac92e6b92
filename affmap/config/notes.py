"""The note of a sweep in the folder that it was run into, so that the folder stands for its overrides."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.types import Override
from pydantic import TypeAdapter

from affmap.config.compose import compose, values
from affmap.config.interpolations import refers_to_keys_only
from affmap.config.overrides import keys, parse, without_sweeps
from affmap.settings import ConfigError, names
from affmap.settings.messages import few, format_value, nearest
from affmap.store.files import read_json, write_json
from affmap.store.provenance import has_valid_checksum, with_checksum

NOTE = "jobs/sweep.json"
"""File of an output folder with the overrides of the last sweep run into it."""

LARGEST_NOTE = 30_000
"""Most bytes of such a file; one of a thousand values has 5,000."""

SEARCH_KEYS = ("hydra/sweeper", "hydra.sweep.dir")
"""Keys of Hydra's that describe a search, besides those of its sweeper."""


def expand_folder(arguments: Sequence[str]) -> list[str]:
    """A command line in which a folder stands for the overrides of the last sweep run into it; other overrides win.

    Raises:
        ConfigError: there are several folders, or no such folder, or `read_note` cannot read its note; or the sweep
            writes to another folder.
    """
    folders = [argument for argument in arguments if is_folder(argument)]
    if not folders:
        return [*arguments]
    if len(folders) > 1:
        raise ConfigError(f"{format_value(folders[1])} is a second folder; give one folder at a time.")
    path, own = Path(folders[0]), [argument for argument in arguments if argument not in folders]
    overrides = [*read_note(path), *own]
    output = Path(str(values(compose(without_sweeps(overrides)))["output"]))
    if "output" not in keys(own) and output.resolve() != path.resolve():
        raise ConfigError(
            f"the sweep of {path} writes to {output}; say that folder, where the sweep was run, or output={path}."
        )
    return overrides


def is_folder(argument: str) -> bool:
    """Whether an argument of a command line is the folder of a sweep, and no override."""
    return bool(argument.strip()) and "=" not in argument and not argument.startswith("~")


def folders_with_notes(parent: Path = Path("runs")) -> list[Path]:
    """Folders below `parent` that sweeps were run into."""
    return sorted(path.parents[1] for path in parent.rglob(NOTE))


def write_note(output: Path, overrides: Sequence[str]) -> None:
    """Note the overrides of a sweep in its output folder, with a checksum, for `read_note`."""
    path = output / NOTE
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, with_checksum({"overrides": [*overrides]}))


def read_note(output: Path) -> list[str]:
    """The overrides of the last sweep run into a folder, perhaps by somebody else.

    Hydra's own are left out, but for those of a search.

    Raises:
        ConfigError: there is no such folder, and the message lists those there are; or it has no note; or the note is
            corrupted, or it reads more than a configuration.
    """
    path = output / NOTE
    remedy = "give the overrides of the sweep instead, such as experiment=exp1."
    if not output.is_dir():
        raise ConfigError(f"{output} is neither a folder nor an override key=value{_other_folders(output)}")
    if not path.is_file():
        raise ConfigError(f"{output} holds no note of a sweep ({NOTE}); {remedy}")
    try:
        if path.stat().st_size > LARGEST_NOTE:
            raise ValueError(path)
        note = TypeAdapter(dict[str, Any]).validate_python(read_json(path))
        if not has_valid_checksum(note):
            raise ValueError(path)
        lines = TypeAdapter(list[str]).validate_python(note["overrides"])
    except (OSError, ValueError, KeyError):
        raise ConfigError(f"{path} is corrupted; {remedy}") from None
    overrides = [override for override in parse(lines) if not _is_hydra(override) or _is_of_search(override)]
    for override in overrides:
        if not refers_to_keys_only(repr(override.value())):
            raise ConfigError(
                f"{path}: {format_value(override.input_line)} reads more than keys of the configuration, which a file "
                "must not; give the overrides of the sweep instead."
            )
    return [str(override.input_line) for override in overrides]


def _other_folders(output: Path) -> str:
    """The end of a sentence on a folder that does not exist: folders of sweeps in its place."""
    place = Path("runs") if output.parent == Path() else output.parent
    folders = {str(path.relative_to(place)): str(path) for path in folders_with_notes(place)}
    near = nearest(output.name, folders)
    meant = [f"experiment={output}"] if output.name in names(f"experiment/{output.parent}") else []
    question = " or ".join([*meant, *([folders[near]] if near else [])])
    if not folders:
        begin = f"did you mean {question}" if question else "`affmap experiment=exp1` begins one"
        return f"; there is no sweep in {place}, {begin}{'?' if question else '.'}"
    return f"{f'; did you mean {question}?' if question else '.'} Folders of sweeps: {few([*folders.values()])}."


def _is_hydra(override: Override) -> bool:
    """Whether an override may change a key of Hydra's own."""
    return "hydra" in re.split(r"[./]", f"{override.key_or_group}.{override.package}")


def _is_of_search(override: Override) -> bool:
    """Whether an override describes a search."""
    key = override.key_or_group
    return override.package is None and (key in SEARCH_KEYS or key.startswith("hydra.sweeper."))
