"""The base class of everything configured, and the loader of `conf/`.

A subclass of `Settings` is a configuration file with types: its fields are the keys of the file, and it has no
defaults, so that a value stands in exactly one place, in `conf/`. (A key that came later may have a `Neutral` value,
which it has where it is missing.) It knows nothing of Hydra.

A configuration that is read must have every key. Only a call in Python takes missing ones from the class's file.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, partial, reduce
from inspect import Parameter, Signature, cleandoc, formatannotation
from operator import or_
from pathlib import Path
from textwrap import fill
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, Self, Union, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
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


def preset(**options: Any) -> Any:
    """The value of a key that a call may leave out, because the class's file has one, or it is neutral.

    `horizon: Count = preset()` says so to type checkers and editors; a configuration that is read must have the key.

    Args:
        options: those of pydantic's `Field`, without a default.
    """
    return Field(**options)


_COMPLETE = "complete"
"""Serialization context: neutral keys are written, too."""


class _Unquoted(str):
    """The text of an annotation, which `help` prints as it is."""

    def __repr__(self) -> str:
        return str(self)


class _LazySignature:
    """The signature of a settings class: its keys, their types, and the values of its file, which is read on demand."""

    def __get__(self, instance: Settings | None, owner: type[Settings]) -> Signature:
        if instance is not None:
            raise AttributeError("__signature__")  # an instance cannot be called
        defaults = owner._defaults()
        fields = {key: field.annotation for key, field in owner.model_fields.items()}
        types = get_type_hints(SimpleNamespace(__annotations__=fields))  # without limits and validators
        only, none = Parameter.KEYWORD_ONLY, Parameter.empty
        return Signature(
            [Parameter(key, only, default=defaults.get(key, none), annotation=_text(types[key])) for key in fields]
        )


def _text(kind: Any) -> _Unquoted:
    """A type as one writes it, without modules."""
    plain = reduce(or_, get_args(kind)) if get_origin(kind) is Union else kind
    return _Unquoted(re.sub(r"\b[a-z]\w*\.", "", formatannotation(plain)))


if TYPE_CHECKING:  # a metaclass derived from pydantic's would hide the keys of a call from type checkers
    from pydantic._internal._model_construction import ModelMetaclass as _SettingsType
else:

    class _SettingsType(type(BaseModel)):
        """The class of settings classes, which lists their own members; `help` and completion end after these."""

        def __dir__(self) -> list[str]:
            """Public members, without those that only pydantic defines."""
            kinds = [kind for kind in self.__mro__ if kind not in (BaseModel, object)]
            return sorted({name for kind in kinds for name in vars(kind) if name[0] != "_"} - {"model_config"})


class Settings(BaseModel, metaclass=_SettingsType):
    """Frozen, typed settings; unknown keys, NaN and infinities are errors.

    `class CEMPlanner(Settings, defaults="planner/cem")` names the file of `conf/` that a call in Python takes missing
    keys from, as in `CEMPlanner(num_iterations=10)`. Without a file, a call gives all keys. Its fields are `preset()`,
    so that type checkers know.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        hide_input_in_errors=True,
        use_attribute_docstrings=True,
    )

    _file: ClassVar[str | None] = None

    def __init_subclass__(cls, *, defaults: str | None = None, **options: Any) -> None:
        """Name the file that missing keys come from; a class derived from one with a file has the same."""
        super().__init_subclass__(**options)
        cls._file = defaults or cls._file

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        """Make the class readable in `help`, once its fields are known."""
        cls.__doc__ = _with_keys(cls.__doc__ or "", {key: each.description for key, each in cls.model_fields.items()})
        cls.__signature__ = _LazySignature()  # type: ignore[assignment]  # pydantic's has neither types nor defaults

    def __init__(self, /, *unnamed: Any, **values: Any) -> None:
        """Set all keys; those that are not given are read from the class's file, if it has one.

        Raises:
            ConfigError: one sentence for each value that is not allowed, and for each key that is missing or unknown;
                or a value has no key.
        """
        if unnamed:
            value, keys = format_value(unnamed[0]), ", ".join(f"{key}=" for key in type(self).model_fields)
            raise ConfigError(f"{type(self).__name__} takes its values by name; {value} has none. There are: {keys}.")
        if type(self).model_fields.keys() - values.keys():
            values = {**self._defaults(), **values}
        with self._explained(values, origin=type(self).__name__):
            self.__pydantic_validator__.validate_python(values, self_instance=self)

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # whatever is read does not pass through it

    def __str__(self) -> str:
        return repr(self)  # pydantic's lacks the class

    @classmethod
    def _defaults(cls) -> dict[str, Any]:
        """Values of missing keys in a call: those of the class's file, and neutral ones."""
        group, _, name = (cls._file or "").rpartition("/")
        return {**cls._neutral(), **(read(group, name) if name else {})}

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
        """A copy, in which some values are others, as in `settings.model_copy(update={"beta": 10.0})`.

        Raises:
            ConfigError: a value is not allowed, or there is no such key.
        """
        copied = super().model_copy(deep=deep)
        if not update:
            return copied
        name = f"{type(self).__name__}.model_copy"
        values = {key: getattr(copied, key) for key in type(self).model_fields}
        return self.checked({**values, **update}, name)

    def complete(self) -> dict[str, Any]:
        """Plain values of all keys, those at their neutral value included."""
        return self.model_dump(mode="json", context=_COMPLETE)

    @classmethod
    def load(cls, group: str, name: str = "", /, **changes: Any) -> Self:
        """Settings of `conf/<group>/<name>.yaml`, with some values replaced by `changes`.

        Raises:
            ConfigError: there is no such file, or its name is missing, or a value is not allowed.
        """
        call = f"{cls.__name__}.load"
        if not name:
            example = 'affmap.Layout.load("layout", "original")'
            raise ConfigError(f"{call} takes a group of conf and the name of a file in it, such as {example}.")
        origins = dict.fromkeys([*changes, ""], call) if changes else {}  # "" is of checks of several keys
        return cls.checked({**read(group, name), **changes}, f"conf/{group}/{name}.yaml", origins)

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
        with cls._explained(values, origin, origins):
            return cls.model_validate(values)

    @classmethod
    @contextmanager
    def _explained(
        cls, values: Mapping[str, Any], origin: str, origins: Mapping[str, str] | None = None
    ) -> Iterator[None]:
        """Turn pydantic's error about `values` into a ConfigError; see `checked`."""
        try:
            yield
        except ValidationError as error:
            errors = error.errors(include_url=False)
            known = partial(_known_keys, cls, values)
            raise ConfigError(sentences(errors, values, origin, origins or {}, known)) from None


def _known_keys(
    settings: type[Settings], values: Mapping[str, Any], part: Mapping[str, Any], unknown: str
) -> Collection[str]:
    """The keys that a part of some settings' values may have: in a part, those of the class that shares most with it.

    Pydantic does not tell which classes it has tried.
    """
    if part is values:
        return settings.model_fields
    kinds = [Settings]
    for kind in kinds:  # the list grows
        kinds += kind.__subclasses__()
    every = [kind.model_fields.keys() for kind in kinds if unknown not in kind.model_fields]
    return max(every, key=lambda keys: len(keys & part.keys()))


def _with_keys(doc: str, descriptions: Mapping[str, str | None]) -> str:
    """A docstring with a section on keys: those that are described."""
    described = ((key, " ".join(text.split())) for key, text in descriptions.items() if text)
    lines = [fill(f"{key}: {text}", 100, initial_indent=" " * 4, subsequent_indent=" " * 8) for key, text in described]
    return "\n".join([cleandoc(doc), *(["", "Args:", *lines] if lines else [])])


def _plain(value: Any) -> Any:
    if isinstance(value, Settings):
        return value.plain
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def folder() -> Path:
    """The configuration folder: inside an installed package, or at the top of a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "conf"
    return inside if inside.is_dir() else package.parent / "conf"


def own_folder() -> Path | None:
    """The folder `conf` of the current folder, which adds files to those of `folder`; None where there is none."""
    own = Path("conf")
    return own.absolute() if own.is_dir() and not own.samefile(folder()) else None


def folders() -> tuple[Path, ...]:
    """All configuration folders, of which the first is that of `folder`."""
    own = own_folder()
    return (folder(), own) if own else (folder(),)


def names(group: str) -> list[str]:
    """Names of the files of a group, in all configuration folders, without those that systems leave beside them."""
    paths = (path for each in folders() for path in (each / group).glob("[!.]*.yaml") if path.is_file())
    return sorted({path.stem for path in paths})


def find(group: str, name: str) -> Path | None:
    """The file `conf/<group>/<name>.yaml`, or None.

    Raises:
        ConfigError: the current folder has another one of that name.
    """
    paths = [path for each in folders() if (path := each / group / f"{name}.yaml").is_file()]
    # Other applications of Hydra, too, have a `conf` with files of these names.
    if len(paths) > 1 and name not in ("config", "default") and len({path.read_bytes() for path in paths}) > 1:
        raise ConfigError(
            f"conf/{group}/{name}.yaml of the current folder has the name of a file of affmap; give it one of its own."
        )
    return paths[0] if paths else None


def read(group: str, name: str) -> dict[str, Any]:
    """The plain content of `conf/<group>/<name>.yaml`, of the package or of the current folder; not to be changed.

    Raises:
        ConfigError: there is no such file or group, and the message lists those there are; or it holds no keys; or it
            is too large or not plain YAML, see `affmap.settings.plain_yaml`; or both folders have one.
    """
    if not _is_name(name) or not (path := find(group, name)):
        raise ConfigError(_without_file(group, name))
    status = path.stat()
    return _read(path, f"conf/{group}/{name}.yaml", (status.st_mtime_ns, status.st_size))


def _groups() -> list[str]:
    """Folders of files, in all configuration folders."""
    paths = (path.relative_to(each) for each in folders() for path in each.glob("*/**/*.yaml"))
    return sorted({path.parent.as_posix() for path in paths})


def _is_name(name: str) -> bool:
    return re.fullmatch(NAME, name) is not None and not name.endswith(".yaml")


def _without_file(group: str, name: str) -> str:
    """A sentence about a file that cannot be read: its group or itself does not exist, or its name is none."""
    if not (listed := names(group)):
        return f"there is no group {format_value(group)} in conf; {alternatives(group, _groups())}"
    if _is_name(name):
        return f"conf/{group}/{name}.yaml does not exist; {alternatives(name, listed, f'conf/{group} holds')}"
    if name in listed:
        return f"conf/{group}/{name}.yaml needs a name of letters, digits, _, - and .; rename the file."
    return (
        f"{format_value(name)} cannot be the name of a file in conf/{group}, which is given without folder and ending; "
        f"{alternatives(Path(name).stem, listed, f'conf/{group} holds')}"
    )


@lru_cache(maxsize=1024)
def _read(path: Path, name: str, _version: tuple[int, int]) -> dict[str, Any]:
    plain_yaml.check_size(path, name)
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{name} is not plain YAML: {error}.") from None
    content = plain_yaml.load(text, name)
    if not isinstance(content, dict):
        raise ConfigError(f"{name} holds {format_value(content)}; it should hold `key: value` lines.")
    return content
