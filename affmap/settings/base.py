"""The base class of everything configured, and the loader of `conf/`.

A subclass of `Settings` is a configuration file with types: its fields are the keys of the file, and it has no
defaults, so that a value stands in exactly one place, in `conf/`. (A key that came later may have a `Neutral` value,
which it has where it is missing.) It knows nothing of Hydra.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from affmap.settings import plain_yaml
from affmap.settings.messages import ConfigError, alternatives, format_value, sentences
from affmap.settings.types import NAME


@dataclass(frozen=True)
class Neutral:
    """The value of a key that stands for how things were before the key existed: `Annotated[bool, Neutral(False)]`.

    A key at this value is not written, so that no digest depends on it; a missing key is read as this value. So keys
    can be added, to layouts, too, without renaming any stored result.
    """

    value: Any


_COMPLETE = "complete"
"""Serialization context: neutral keys are written, too."""


class Settings(BaseModel):
    """Frozen, typed settings; unknown keys, NaN and infinities are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, hide_input_in_errors=True)

    @classmethod
    @cache
    def _neutral(cls) -> dict[str, Any]:
        """Key -> its neutral value, for those that have one."""
        fields = cls.model_fields.items()
        return {key: each.value for key, field in fields for each in field.metadata if isinstance(each, Neutral)}

    @model_validator(mode="before")
    @classmethod
    def _add_neutral(cls, values: Any) -> Any:
        return {**cls._neutral(), **values} if isinstance(values, Mapping) else values

    @model_serializer(mode="wrap")
    def _drop_neutral(self, write: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, Any]:
        values: dict[str, Any] = write(self)
        neutral = self._neutral()
        if not neutral or info.context == _COMPLETE:
            return values
        return {key: value for key, value in values.items() if key not in neutral or getattr(self, key) != neutral[key]}

    @cached_property
    def plain(self) -> dict[str, Any]:
        """Plain, JSON-compatible values of all keys that are not neutral; made once, and not to be changed."""
        return self.model_dump(mode="json")

    def part(self, keys: Collection[str]) -> dict[str, Any]:
        """Plain values of some keys, as in `plain`; settings that share a value share its plain value."""
        neutral = self._neutral()
        values = {key: getattr(self, key) for key in keys}
        return {key: _plain(value) for key, value in values.items() if key not in neutral or value != neutral[key]}

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy, in which some values are others; see pydantic."""
        copied = super().model_copy(update=update, deep=deep)
        for name in copied.__dict__.keys() - type(self).model_fields.keys():
            del copied.__dict__[name]  # cached properties follow from the old values
        return copied

    def complete(self) -> dict[str, Any]:
        """Plain values of all keys, those at their neutral value included."""
        return self.model_dump(mode="json", context=_COMPLETE)

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
            errors = error.errors(include_url=False)
            raise ConfigError(sentences(errors, values, origin, origins or {}, _known_keys)) from None


def _known_keys(values: Mapping[str, Any], unknown: str) -> Collection[str]:
    """The keys of the settings that share most keys with `values`: pydantic does not tell which ones it has tried."""
    kinds = [Settings]
    for kind in kinds:  # the list grows
        kinds += kind.__subclasses__()
    every = [kind.model_fields.keys() for kind in kinds if unknown not in kind.model_fields]
    return max(every, key=lambda keys: len(keys & values.keys()))


def _plain(value: Any) -> Any:
    if isinstance(value, Settings):
        return value.plain
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def folder() -> Path:
    """The configuration folder: inside an installed package, or at the top of a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "conf"
    return inside if inside.is_dir() else package.parent / "conf"


@cache
def read(group: str, name: str) -> dict[str, Any]:
    """The plain content of `conf/<group>/<name>.yaml`.

    Raises:
        ConfigError: there is no such file, and the message lists those there are; or it holds no keys; or it is too
            large or not plain YAML, see `affmap.settings.plain_yaml`.
    """
    path = folder() / group / f"{name}.yaml"
    options = sorted(file.stem for file in (folder() / group).glob("*.yaml") if file.is_file())
    if not re.fullmatch(NAME, name):
        raise ConfigError(
            f"{format_value(name)} cannot be the name of a file; conf/{group} holds: {', '.join(options)}."
        )
    if not path.is_file():
        raise ConfigError(
            f"conf/{group}/{name}.yaml does not exist; {alternatives(name, options, f'conf/{group} holds')}"
        )
    plain_yaml.check_size(path, f"conf/{group}/{name}.yaml")
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"conf/{group}/{name}.yaml is not plain YAML: {error}.") from None
    content = plain_yaml.load(text, f"conf/{group}/{name}.yaml")
    if not isinstance(content, dict):
        raise ConfigError(f"conf/{group}/{name}.yaml holds {format_value(content)}; it should hold `key: value` lines.")
    return content
