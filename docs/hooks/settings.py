"""The reference of the configuration: every group of `conf/` and every key, with type, default and meaning.

Each key has a heading of its own, `group.key`, so that the search finds it and others can link to it.
Keys and types are those of the settings' classes, meanings their docstrings, defaults and choices the files.
"""

import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import yaml
from keys import described
from places import ROOT
from pydantic import BaseModel, TypeAdapter
from pydantic.fields import FieldInfo

from affmap.config.root import Config
from affmap.report.markdown import code, table

CONF = ROOT / "conf"
ELSEWHERE = ("hydra", "layout", "protocol")
"""Folders of `conf` that are no groups of the command line."""


def settings() -> str:
    """Sections on the keys of the root, on each group, and on the groups that change several others."""
    groups = {key: field for key, field in Config.model_fields.items() if (CONF / key).is_dir() and _is_local(key)}
    root = {key for key in Config.model_fields if key not in groups}
    values = _values(CONF / "config.yaml")
    for group, choice in _chosen().items():
        if choice and not _is_local(group):
            values = _values(CONF / group / f"{choice}.yaml") | values
    parts = ["## The root", *_keys(Config, root, values, "")]
    for key, field in groups.items():
        parts += _group(key, field)
    for folder in sorted(
        path.name for path in CONF.iterdir() if path.is_dir() and path.name not in {*groups, *ELSEWHERE}
    ):
        parts += [f"## {folder}", _choices(folder, nested=True)]
    return "\n\n".join(parts)


def _group(group: str, field: FieldInfo) -> Iterator[str]:
    """Sections on a group, and on the groups in its folder that choose the value of one of its keys."""
    yield f"## {group}"
    yield _choices(group)
    kinds: dict[type[BaseModel], Path] = {}
    for path in _files(group):
        kinds.setdefault(type(_adapter(field).validate_python(_values(path))), path)
    for kind, path in kinds.items():
        if list(kind.model_fields) != ["kind"]:
            choice = f"{group}={path.stem}" if len(kinds) > 1 else ""
            if choice:
                yield f"### {choice}"
            yield from _keys(kind, set(kind.model_fields) - {"kind"}, _values(path), f"{group}.", choice)
    for key, inner in next(iter(kinds)).model_fields.items():
        if (CONF / group / key).is_dir():
            yield from _group(f"{group}/{key}", inner)


def _adapter(field: FieldInfo) -> TypeAdapter[Any]:
    kind: Any = field.annotation
    for constraint in field.metadata:
        kind = Annotated[kind, constraint]
    return TypeAdapter(kind)


def _keys(
    kind: type[BaseModel], keys: set[str], values: Mapping[str, Any], prefix: str, choice: str = ""
) -> Iterator[str]:
    """Sections on some keys of a class, in its order; `choice` tells apart those of the same name."""
    level, anchor = ("####", choice.replace("=", ".") + ".") if choice else ("###", prefix)
    for key, words, meaning in described(kind):
        if key in keys:
            name = prefix + key
            default = values.get(key, _chosen().get(name.replace(".", "/")))
            yield f"{level} `{name}` {{ #{anchor}{key} .key }}"
            yield f"{words}; default {_plain(default)}\n{{ .kind }}"
            yield re.sub(r"\bNone\b", "`null`", meaning)  # as files and command lines write it


def _choices(group: str, nested: bool = False) -> str:
    """A table of the files of a group, which a command line chooses from."""
    rows = []
    for path in _files(group, "**/*.yaml" if nested else "*.yaml"):
        name = path.relative_to(CONF / group).with_suffix("").as_posix()
        default = " (default)" if _chosen().get(group) == name else ""
        rows.append((code(f"{group}={name}") + default, _about(path).replace("|", "\\|")))
    return table(["choice", ""], rows)


def _about(path: Path) -> str:
    """The title of an experiment or a search, else the comment at the head of a file."""
    head = re.match(r"(?:#.*\n)*", path.read_text("utf-8"))
    assert head
    lines = (line.lstrip("# ") for line in head[0].splitlines())
    return _values(path).get("title") or " ".join(line for line in lines if not line.startswith("@package"))


def _files(group: str, pattern: str = "*.yaml") -> list[Path]:
    """The files of a group, the default first."""
    default = _chosen().get(group)
    return sorted((CONF / group).glob(pattern), key=lambda path: (path.stem != default, path))


@cache
def _chosen() -> dict[str, str | None]:
    """Group -> the file that is chosen by default."""
    entries = _values(CONF / "config.yaml")["defaults"]
    return {group: name for entry in entries if isinstance(entry, dict) for group, name in entry.items()}


def _is_local(group: str) -> bool:
    """Whether the files of a group hold its own keys; others hold those of the root."""
    return not any("@package _global_" in path.read_text("utf-8") for path in _files(group))


def _values(path: Path) -> dict[str, Any]:
    values: dict[str, Any] = yaml.safe_load(path.read_text("utf-8")) or {}
    return values


def _plain(value: Any) -> str:
    return code(yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("...\n").strip())
