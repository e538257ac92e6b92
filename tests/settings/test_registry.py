"""Settings of several kinds, by hand."""

from typing import Literal

import pytest
from pydantic import ValidationError

from affmap.settings import Settings
from affmap.settings.registry import Registry


class Cat(Settings):
    kind: Literal["cat"]
    lives: int


class Dog(Settings):
    kind: Literal["dog", "hound"]


def test_the_kind_chooses_among_those_registered() -> None:
    """One, then two; each with keys of its own."""
    registry = Registry("affmap.store")  # a folder that registers nothing
    assert registry.register(Cat) is Cat
    assert registry.choose({"kind": "cat", "lives": 9}) == Cat(kind="cat", lives=9)
    registry.register(Dog)
    for values in ({"kind": "dog"}, {"kind": "hound"}):
        assert isinstance(registry.choose(values), Dog)
    assert registry.choose(Cat(kind="cat", lives=9)).lives == 9
    with pytest.raises(ValidationError, match="'cat', 'dog', 'hound'"):
        registry.choose({"kind": "cow"})


def test_a_class_that_is_defined_anew_takes_the_place_of_the_old_one() -> None:
    """As a notebook does."""
    registry = Registry("affmap.store")

    def define(legs: int) -> type[Settings]:
        class Animal(Settings):
            kind: Literal["animal"]

            @property
            def legs(self) -> int:
                return legs

        return Animal

    for legs in (2, 4):
        registry.register(define(legs))
        assert registry.choose({"kind": "animal"}).legs == legs


def test_kinds_are_told_apart() -> None:
    """Golden parts of the messages."""

    class Other(Settings):
        kind: Literal["cat"]

    class Nameless(Settings):
        lives: int

    class Anything(Settings):
        kind: str

    class Plain:
        kind: str

    registry = Registry("affmap.store")
    registry.register(Cat)
    with pytest.raises(ValueError, match="Other has the kind of Cat"):
        registry.register(Other)
    with pytest.raises(ValueError, match="Nameless has no field kind"):
        registry.register(Nameless)
    with pytest.raises(ValueError, match="Anything has no field kind; give it one, such as kind: Literal"):
        registry.register(Anything)
    with pytest.raises(ValueError, match="Plain is no Settings class"):
        registry.register(Plain)  # type: ignore[type-var]
