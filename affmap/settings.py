"""Where every configured object gets its checks and its defaults: one base class, one loader of `conf/`.

A subclass of `Settings` is a configuration file with types: its fields are the keys of the file, and it has no
defaults, so that a value stands in exactly one place, in `conf/`. It knows nothing of Hydra.
"""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Self

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails


class ConfigError(ValueError):
    """A configuration that cannot be used; the message names the key, the value and what would be right."""


class Settings(BaseModel):
    """Frozen, typed settings; unknown keys, NaN and infinities are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, hide_input_in_errors=True)

    @classmethod
    def load(cls, group: str, name: str, **changes: Any) -> Self:
        """Settings of `conf/<group>/<name>.yaml`, with some values replaced by `changes`.

        Raises:
            ConfigError: there is no such file, or a value is not allowed.
        """
        return cls.checked({**read(group, name), **changes}, origin=f"conf/{group}/{name}.yaml")

    @classmethod
    def checked(cls, values: Mapping[str, Any], origin: str, origins: Mapping[str, str] | None = None) -> Self:
        """Settings from plain values.

        Args:
            values: the settings' keys and values.
            origin: where the values come from, named in an error.
            origins: the same for single keys that come from elsewhere.

        Raises:
            ConfigError: one sentence for each value that is not allowed.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            found = [
                f"{(origins or {}).get(str(item['loc'][0]) if item['loc'] else '', origin)}: {sentence(item, values)}"
                for item in error.errors(include_url=False)
            ]
            raise ConfigError("\n".join(found)) from None


def sentence(item: ErrorDetails, values: Mapping[str, Any]) -> str:
    """What is wrong with a value, in a sentence: key = value, what is wrong, what would be right."""
    key = _key(item["loc"], values)
    problem = re.sub(r"^(Value error, |\w+ (?=should ))", "", item["msg"])
    if item["type"] == "missing":
        return f"{key} is missing; add the key."
    if item["type"] == "extra_forbidden":
        return f"{key} = {item['input']!r} is not a known key; remove it or correct its spelling."
    if item["type"] == "union_tag_invalid":
        tags = item["ctx"]["expected_tags"].replace(", ", " or ")
        return f"{key}.kind = {item['ctx']['tag']!r} is not allowed: it should be {tags}."
    if item["type"] == "value_error" and isinstance(item["input"], Mapping):
        return f"{key}: {problem}" if key else problem  # a check of several keys names them and their values itself
    if isinstance(item.get("ctx", {}).get("error"), ConfigError):
        return f"{key} = {item['input']!r}: {problem}"  # the value names a file with a mistake of its own
    return f"{key} = {item['input']!r} is not allowed: it {problem}."


def _key(location: Sequence[int | str], values: Any) -> str:
    """The dotted key of a place in `values`."""
    key = ""
    for part in location:
        if _is_alternative(part, values):
            continue
        key += f"[{part}]" if isinstance(part, int) else f".{part}"
        try:
            values = values[part]
        except (KeyError, IndexError, TypeError):
            values = None
    return key.lstrip(".")


def _is_alternative(part: int | str, values: Any) -> bool:
    """Whether pydantic names no key here but the alternative that it chose, by `kind` or by the kind of value."""
    if isinstance(values, Mapping):
        return part not in values and values.get("kind") == part
    return isinstance(part, str)


def folder() -> Path:
    """The configuration folder: inside an installed package, or at the top of a checkout."""
    inside = Path(__file__).parent / "conf"
    return inside if inside.is_dir() else Path(__file__).parents[1] / "conf"


@cache
def read(group: str, name: str) -> dict[str, Any]:
    """The plain content of `conf/<group>/<name>.yaml`.

    Raises:
        ConfigError: there is no such file, and the message lists those there are; or it holds no keys.
    """
    path = folder() / group / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in path.parent.glob("*.yaml")))
        raise ConfigError(f"conf/{group}/{name}.yaml does not exist; conf/{group} holds: {known}.")
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ConfigError(f"conf/{group}/{name}.yaml holds {content!r}; it should hold `key: value` lines.")
    return content
