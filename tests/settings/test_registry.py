"""Settings of several kinds, by hand."""

import importlib
import sys
from pathlib import Path
from typing import Any, Literal

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


def test_kinds_are_reported_apart() -> None:
    """Golden parts of the messages."""

    class Other(Settings):
        kind: Literal["cat"]

    class Nameless(Settings):
        lives: int

    class Anything(Settings):
        kind: str

    class Plain:
        kind: str

    class Attempt(Settings):
        kind: Literal["attempt"]

    registry = Registry("affmap.store")
    registry.register(Cat)
    with pytest.raises(ValueError, match=r"Attempt has the kind of affmap\.store\.attempt; give it one of its own"):
        registry.register(Attempt)  # which may not hide ours, though ours is not loaded yet
    with pytest.raises(ValueError, match="Other has the kind of Cat"):
        registry.register(Other)
    with pytest.raises(ValueError, match="Nameless has no field kind"):
        registry.register(Nameless)
    with pytest.raises(ValueError, match="Anything has no field kind; give it one, such as kind: Literal"):
        registry.register(Anything)
    wrong: Any
    for wrong, name in (
        (Plain, "Plain"),
        (Cat(kind="cat", lives=9), r"Cat\(.*\)"),
        ("mine", "'mine'"),
        (print, "print"),
    ):
        with pytest.raises(
            ValueError, match=rf"^{name} is no Settings class; derive .* by the decorator @affmap\.register_kind\.$"
        ):
            registry.register(wrong)


def test_a_kind_without_a_method_that_it_needs_is_refused() -> None:
    """When it is registered, not when a training begins."""

    class Maker(Cat):
        def make(self) -> int:
            return 1

    registry = Registry("affmap.store", ("make",))
    with pytest.raises(ValueError, match=r"^Cat has no method make; give it one, see the registry of affmap\.store\.$"):
        registry.register(Cat)
    assert registry.register(Maker) is Maker


def test_a_kind_is_found_in_the_module_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of three modules: the one of the name alone is loaded, and all where the name does not tell."""
    folder = tmp_path / "zoo_of_kinds"
    folder.mkdir()
    (folder / "__init__.py").write_text(
        "from affmap.settings.registry import Registry\nregistry = Registry('zoo_of_kinds')\n"
    )
    for name, kind in (("cow", "cow"), ("pig", "pig"), ("pets", "hamster")):
        (folder / f"{name}.py").write_text(
            "from typing import Literal\nfrom affmap.settings import Settings\nfrom zoo_of_kinds import registry\n"
            f"@registry.register\nclass {kind.title()}(Settings):\n    kind: Literal[{kind!r}]\n"
        )
    monkeypatch.syspath_prepend(tmp_path)
    registry = importlib.import_module("zoo_of_kinds").registry
    loaded = {"cow": ["cow"], "hamster": ["cow", "pets", "pig"]}
    for kind, modules in loaded.items():
        assert registry.choose({"kind": kind}).kind == kind
        assert sorted(name for name in ("cow", "pig", "pets") if f"zoo_of_kinds.{name}" in sys.modules) == modules
    for name in [name for name in sys.modules if name.startswith("zoo_of_kinds")]:
        del sys.modules[name]
