"""Settings of several kinds that a configuration chooses from by their key `kind`."""

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import Field, TypeAdapter

from affmap.settings.base import Settings

S = TypeVar("S", bound=Settings)


class Registry:
    """Kinds of settings: those of a folder of the package, and others that are registered."""

    def __init__(self, package: str, methods: Sequence[str] = ()) -> None:
        """Begin with none; a module of `package` is loaded when its kind is chosen. Each kind must have `methods`."""
        self._package, self._methods = package, methods
        self._registered: list[type[Settings]] = []

    def register(self, settings: type[S]) -> type[S]:
        """Make a class known to configurations, by the value of its field `kind`; a class decorator.

        Modules of the folder are loaded when a configuration is checked; a class elsewhere is known once its module has
        been imported.

        Raises:
            ValueError: it has no field `kind`, or another class has this kind, or a method is missing.
        """
        if not issubclass(settings, Settings):
            raise ValueError(f"{settings.__name__} is no Settings class; derive it from affmap.settings.Settings.")
        if not _kinds(settings):
            raise ValueError(f"{settings.__name__} has no field kind; give it one, such as kind: Literal['mine'].")
        if missing := [name for name in self._methods if not callable(getattr(settings, name, None))]:
            raise ValueError(
                f"{settings.__name__} has no method {missing[0]}; give it one, see the registry of {self._package}."
            )
        others = [
            each for each in self._registered if each.__qualname__ != settings.__qualname__
        ]  # else it is defined anew
        if clash := [each.__name__ for each in others if _kinds(each) & _kinds(settings)]:
            raise ValueError(f"{settings.__name__} has the kind of {clash[0]}; give it one of its own.")
        self._registered[:] = [*others, settings]
        return settings

    def choose(self, values: Any) -> Any:
        """Settings from plain values, by their `kind`."""
        if isinstance(values, tuple(self._registered)):
            return values
        kind = values.get("kind") if isinstance(values, Mapping) else getattr(values, "kind", None)
        modules = [module.name for module in iter_modules(import_module(self._package).__path__)]
        # The module named like the kind is usually enough; some of the others import torch.
        for names in ([kind] if kind in modules else [], modules):
            if not any(kind in [*_kinds(each)] for each in self._registered):
                for name in names:
                    import_module(f"{self._package}.{name}")
        return _adapter(*sorted(self._registered, key=lambda each: sorted(_kinds(each)))).validate_python(values)


def _kinds(settings: type[Settings]) -> set[str]:
    """The values of the field `kind`; none where there is no such field, or it may be anything."""
    field = settings.model_fields.get("kind")
    return {*get_args(field.annotation)} if field and get_origin(field.annotation) is Literal else set()


@cache
def _adapter(*kinds: type[Settings]) -> TypeAdapter[Any]:
    union: Any = Union[kinds]  # noqa: UP007
    union = Annotated[union, Field(discriminator="kind")] if len(kinds) > 1 else union
    return TypeAdapter(union)
