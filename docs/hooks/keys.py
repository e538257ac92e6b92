"""The keys of settings in words, for the references of the configuration and of the API."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from affmap.report.markdown import code

COMMON = 1_000_000
"""Upper limits from here on are left out: they only keep mistakes from filling the memory."""


def described(kind: type[BaseModel]) -> Iterator[tuple[str, str, str]]:
    """Each key of a class, its type with limits, and its meaning."""
    schema = kind.model_json_schema()["properties"]
    for key, field in kind.model_fields.items():
        yield key, _words(schema[key]), " ".join((field.description or "").split()).replace("|", "\\|")


def _words(schema: Mapping[str, Any]) -> str:
    """The type of a value in words, from its schema."""
    match schema:
        case {"anyOf": kinds} | {"oneOf": kinds}:
            return " or ".join(map(_words, kinds))
        case {"enum": values}:
            return ", ".join(code(str(value)) for value in values)
        case {"type": "array", "prefixItems": items}:
            return f"{len(items)} values: {_words(items[0])}"
        case {"type": "array", "items": items}:
            return f"list: {_words(items)}"
        case {"type": "integer" | "number" as name}:
            return f"{name} {_limits(schema)}".strip()
        case {"type": "boolean"}:
            return "`true` or `false`"
        case {"type": "null"}:
            return "`null`"
        case {"type": "object"}:
            return "mapping"
        case {"format": "path"}:
            return "folder"
        case {"pattern": _}:
            return "name"
        case {"$ref": name}:
            return str(name).rpartition("/")[2].lower()
        case {"type": "string"}:
            return "text"
    return "group"


def _limits(schema: Mapping[str, Any]) -> str:
    """The tightest limits of a number; upper ones that are common to all are left out."""
    lower = {">": ("gt", "exclusiveMinimum"), "≥": ("ge", "minimum")}
    upper = {"<": ("lt", "exclusiveMaximum"), "≤": ("le", "maximum")}
    above = [(schema[key], sign) for sign, keys in lower.items() for key in keys if key in schema]
    below = [(schema[key], sign) for sign, keys in upper.items() for key in keys if schema.get(key, COMMON) < COMMON]
    tightest = [*sorted(above, key=lambda limit: -limit[0])[:1], *sorted(below, key=lambda limit: limit[0])[:1]]
    return ", ".join(f"{sign} {value:g}" for value, sign in tightest)
