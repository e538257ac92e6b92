"""Settings of several kinds that a configuration chooses from by their key `kind`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import Field, TypeAdapter

from affmap.settings import extensions
from affmap.settings.base import Settings
from affmap.settings.messages import format_value

S = TypeVar("S", bound=Settings)


class Registry:
    """Kinds of settings: those of a folder of the package, and those of users."""

    def __init__(self, package: str, methods: Sequence[str] = (), place: str = "kind") -> None:
        """Begin with none.

        Args:
            package: its modules are loaded when a kind is chosen, that of the kind's name first.
            methods: that each kind must have.
            place: the key of a configuration that chooses, such as `planner.kind`.
        """
        self._package, self._methods, self._place = package, methods, place
        self._registered: list[type[Settings]] = []

    def register(self, settings: type[S]) -> type[S]:
        """Make a class known to configurations, by the value of its field `kind`; a class decorator.

        Modules of the folder are loaded when a configuration is checked; so are those that users name, see
        `affmap.settings.extensions`.

        Raises:
            ValueError: it has no field `kind`, or another class has this kind, or a method is missing.
        """
        if not (isinstance(settings, type) and issubclass(settings, Settings)):
            name = getattr(settings, "__name__", format_value(settings))
            raise ValueError(
                f"{name} is no Settings class; derive one from affmap.settings.Settings, and register it by "
                f"the decorator @affmap.register_{self._place.partition('.')[0]}."
            )
        if not _kinds(settings):
            raise ValueError(f"{settings.__name__} has no field kind; give it one, such as kind: Literal['mine'].")
        if missing := [name for name in self._methods if not callable(getattr(settings, name, None))]:
            raise ValueError(
                f"{settings.__name__} has no method {missing[0]}; give it one, see the registry of {self._package}."
            )
        others = [each for each in self._registered if _name(each) != _name(settings)]  # else it is defined anew
        clash = [each.__name__ for each in others if _kinds(each) & _kinds(settings)]
        if not settings.__module__.startswith(f"{self._package}."):  # else a kind of ours that is not loaded is hidden
            clash += [f"{self._package}.{name}" for name in self._modules if name in _kinds(settings)]
        if clash:
            raise ValueError(f"{settings.__name__} has the kind of {clash[0]}; give it one of its own.")
        self._registered[:] = [*others, settings]
        for kind in _kinds(settings):
            extensions.note(self._place, kind, settings.__module__)
        return settings

    @property
    def _modules(self) -> list[str]:
        """Names of the folder's modules."""
        return [module.name for module in iter_modules(import_module(self._package).__path__)]

    def _knows(self, kind: Any) -> bool:
        return any(kind in [*_kinds(each)] for each in self._registered)

    def choose(self, values: Any) -> Any:
        """Settings from plain values, by their `kind`.

        Raises:
            ValidationError: there is no such kind, or a value is not allowed.
            ConfigError: a module that the user named cannot be imported.
        """
        if isinstance(values, tuple(self._registered)):
            return values
        kind = values.get("kind") if isinstance(values, Mapping) else getattr(values, "kind", None)
        modules = self._modules
        # The module named like the kind is usually enough; some of the others import torch.
        for names in ([kind] if kind in modules else [], modules):
            if not self._knows(kind):
                for name in names:
                    import_module(f"{self._package}.{name}")
        if kind is not None and not self._knows(kind):
            extensions.load()
        return _adapter(*sorted(self._registered, key=lambda each: sorted(_kinds(each)))).validate_python(values)


def _name(settings: type[Settings]) -> tuple[str, str]:
    return settings.__module__, settings.__qualname__


def _kinds(settings: type[Settings]) -> set[str]:
    """The values of the field `kind`; none where there is no such field, or it may be anything."""
    field = settings.model_fields.get("kind")
    return {*get_args(field.annotation)} if field and get_origin(field.annotation) is Literal else set()


@cache
def _adapter(*kinds: type[Settings]) -> TypeAdapter[Any]:
    union: Any = Union[kinds]  # noqa: UP007
    union = Annotated[union, Field(discriminator="kind")] if len(kinds) > 1 else union
    return TypeAdapter(union)
