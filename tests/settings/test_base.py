"""Settings: every kind of error is one sentence with file, key, value and remedy; files stay as they are."""

import inspect
import logging
import os
import pickle
import pydoc
import re
from collections.abc import Callable
from copy import copy, deepcopy
from logging.config import DictConfigurator
from pathlib import Path
from typing import Annotated, Literal

import pytest
import yaml
from pydantic import Field, PositiveFloat, PositiveInt, ValidationError, field_validator, model_validator

from affmap import settings
from affmap.settings import ConfigError, Folder, Neutral, Settings, folder
from affmap.settings.messages import PrintableFormatter


class Wheel(Settings):
    radius: PositiveFloat


class Cart(Settings):
    mass: PositiveFloat
    gears: PositiveInt
    color: Literal["red", "blue"]
    wheels: tuple[Wheel, ...]
    doors: Annotated[tuple[str, ...], Field(min_length=1)]
    owner: str
    garage: Annotated[Folder, Neutral(Path("garage"))]
    prices: Annotated[dict[str, int], Neutral({})]

    @field_validator("owner")
    @classmethod
    def _check_owner(cls, owner: str) -> str:
        if owner == "nobody":
            raise ValueError("must be somebody")
        return owner

    @model_validator(mode="after")
    def _check(self) -> "Cart":
        if self.gears > 5 * self.mass:
            raise ValueError(f"gears = {self.gears} is too many for mass = {self.mass}; give at most {5 * self.mass}.")
        return self


GOOD = "mass: 1.5\ngears: 3\ncolor: red\nwheels: [{radius: 0.1}, {radius: 0.2}]\ndoors: [left]\nowner: ada\n"

KEYS = "There are: mass, gears, color, wheels, doors, owner, garage, prices."


@pytest.fixture(autouse=True)
def conf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A configuration folder with a group `cart` of its own."""
    (tmp_path / "cart").mkdir()
    (tmp_path / "cart" / "good.yaml").write_text(GOOD)
    monkeypatch.setattr("affmap.settings.base.folder", lambda: tmp_path)
    monkeypatch.setattr("affmap.settings.base.own_folder", lambda: None)
    return tmp_path


def complaint(**changes: object) -> str:
    with pytest.raises(ConfigError) as caught:
        Cart.load("cart", "good", **changes)
    return str(caught.value)


def test_a_file_gives_the_values_written_in_it() -> None:
    """The YAML text above, by hand."""
    cart = Cart.load("cart", "good")
    assert (cart.mass, cart.gears, cart.color, cart.owner) == (1.5, 3, "red", "ada")
    assert [wheel.radius for wheel in cart.wheels] == [0.1, 0.2]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"mass": -1}, "mass = -1 is not allowed: it should be greater than 0."),
        ({"mass": 0}, "mass = 0 is not allowed: it should be greater than 0."),
        ({"mass": float("nan")}, "mass = nan is not allowed: it should be a finite number."),
        ({"mass": float("inf")}, "mass = inf is not allowed: it should be a finite number."),
        ({"mass": "heavy"}, "mass = 'heavy' is not allowed: it should be a valid number"),
        ({"mass": None}, "mass = None is not allowed: it should be a valid number."),
        ({"gears": 1.5}, "gears = 1.5 is not allowed: it should be a valid integer"),
        ({"color": "green"}, "color = 'green' is not allowed: it should be 'red' or 'blue'."),
        ({"garage": 1}, "garage = 1 is not allowed: it should be the path of a folder."),
        ({"garage": None}, "garage = None is not allowed: it should be the path of a folder."),
        ({"wheels": [3]}, "wheels[0] = 3 is not allowed: it should be a valid dictionary."),
        ({"wheels": [{"radius": 1, 2: 3}]}, "wheels[0][2]: the key is not text; put quotes around it, or remove it."),
        ({"prices": {2: 3}}, "prices[2]: the key is not text; put quotes around it, or remove it."),
        ({"gears": "9" * 5000}, "gears = '999"),
        ({"owner": "nobody"}, "owner = 'nobody' is not allowed: it must be somebody."),
        ({"doors": []}, "doors = [] is not allowed: it should have at least 1 item"),
        ({"wheels": [{"radius": 1}, {"radius": -2}]}, "wheels[1].radius = -2 is not allowed: it should be greater"),
        ({"wheels": [{}]}, "wheels[0].radius is missing; add the key."),
        ({"wheel": 3}, f"wheel = 3 is not a known key; did you mean wheels? {KEYS}"),
        ({"sail": 3}, f"sail = 3 is not a known key; t{KEYS[1:]}"),
        ({"wheels": [{"radius": 1, "size": 2}]}, "wheels[0].size = 2 is not a known key; remove it or correct"),
        (
            {"wheels": [{"radius": 1, "raduis": 2}]},
            "wheels[0].raduis = 2 is not a known key; did you mean wheels[0].rad",
        ),
        ({"gears": 8}, "gears = 8 is too many for mass = 1.5; give at most 7.5."),
    ],
)
def test_an_error_is_a_sentence_with_call_key_value_and_remedy(changes: dict[str, object], sentence: str) -> None:
    """Golden sentences."""
    message = complaint(**changes)
    assert message.startswith(f"Cart.load: {sentence}")
    assert "\n" not in message and "pydantic" not in message
    assert not re.search(r": it (?!should |must )|Input|class|instance", message)


def test_a_value_of_the_file_and_one_of_the_call_are_told_apart(conf: Path) -> None:
    """Golden sentences; without changes, whatever is wrong is the file's."""
    (conf / "cart" / "heavy.yaml").write_text(GOOD.replace("mass: 1.5", "mass: -2"))
    with pytest.raises(ConfigError) as caught:
        Cart.load("cart", "heavy", gears=0.5)
    assert [line.partition(" is ")[0] for line in str(caught.value).splitlines()] == [
        "conf/cart/heavy.yaml: mass = -2",
        "Cart.load: gears = 0.5",
    ]
    (conf / "cart" / "quick.yaml").write_text(GOOD.replace("gears: 3", "gears: 8"))
    with pytest.raises(ConfigError, match=r"^conf/cart/quick\.yaml: gears = 8 is too many for mass"):
        Cart.load("cart", "quick")


@pytest.mark.parametrize("name", ["good.yaml", "cart/good", "./conf/cart/good.yaml", "~/good"])
def test_a_path_is_no_name_of_a_file(conf: Path, name: str) -> None:
    told = (
        rf"^'{re.escape(name)}' cannot be the name of a file in conf/cart, .*; did you mean good\? There are: good\.$"
    )
    with pytest.raises(ConfigError, match=told):
        Cart.load("cart", name)


def test_a_value_without_its_key_is_told_with_the_keys() -> None:
    with pytest.raises(ConfigError) as caught:
        Wheel(0.5)  # type: ignore[call-arg]
    assert str(caught.value) == "Wheel takes its values by name; 0.5 has none. There are: radius=."


def test_a_file_without_its_group_is_told_with_an_example() -> None:
    with pytest.raises(ConfigError, match=r"^Cart\.load takes a group of conf and the name of a file in it, such as "):
        Cart.load("good")


def test_a_file_whose_name_cannot_be_given_is_to_be_renamed(conf: Path) -> None:
    (conf / "cart" / "My Cart.yaml").write_text(GOOD)
    with pytest.raises(ConfigError, match=r"^conf/cart/My Cart\.yaml needs a name of letters, .*; rename the file\.$"):
        Cart.load("cart", "My Cart")


def test_a_group_that_does_not_exist_is_told_with_those_there_are(conf: Path) -> None:
    (conf / "boat" / "small").mkdir(parents=True)
    (conf / "boat" / "small" / "dinghy.yaml").write_text("oars: 2\n")
    with pytest.raises(ConfigError) as caught:
        Cart.load("crat", "good")
    assert str(caught.value) == "there is no group 'crat' in conf; did you mean cart? There are: boat/small, cart."


def test_each_wrong_value_has_a_sentence_of_its_own() -> None:
    """Golden text; pydantic's own exception is not shown behind it."""
    with pytest.raises(ConfigError) as caught:
        Cart.checked({"mass": 0, "gears": 1, "color": "red", "wheels": (), "doors": ["a"], "ownr": "ada"}, "here")
    assert str(caught.value).splitlines() == [
        "here: mass = 0 is not allowed: it should be greater than 0.",
        "here: owner is missing; add the key.",
        f"here: ownr = 'ada' is not a known key; did you mean owner? {KEYS}",
    ]
    assert caught.value.__suppress_context__
    assert isinstance(caught.value, ValueError)


def test_an_unknown_file_lists_what_exists(conf: Path) -> None:
    (conf / "cart" / "another.yaml").write_text(GOOD)
    with pytest.raises(ConfigError) as caught:
        Cart.load("cart", "best")
    assert str(caught.value) == "conf/cart/best.yaml does not exist; conf/cart holds: another, good."


def test_what_is_no_regular_file_does_not_exist_and_is_not_listed(conf: Path) -> None:
    """A folder and a FIFO, which nobody writes."""
    (conf / "cart" / "folder.yaml").mkdir()
    os.mkfifo(conf / "cart" / "pipe.yaml")
    for name in ("folder", "pipe"):
        with pytest.raises(ConfigError) as caught:
            Cart.load("cart", name)
        assert str(caught.value) == f"conf/cart/{name}.yaml does not exist; conf/cart holds: good."


def test_a_file_that_would_take_minutes_is_refused_before_it_is_read(conf: Path) -> None:
    """By its size; one of the size that is allowed is read."""
    comment = "#" * (10**6 - len(GOOD) - 1) + "\n"
    (conf / "cart" / "large.yaml").write_text(comment + GOOD)
    assert Cart.load("cart", "large") == Cart.load("cart", "good")
    (conf / "cart" / "larger.yaml").write_text(f"#{comment}{GOOD}")
    with pytest.raises(ConfigError) as caught:
        Cart.load("cart", "larger")
    assert str(caught.value) == (
        "conf/cart/larger.yaml has 1,000,001 bytes; a file of conf may have 1,000,000, so make it shorter."
    )


@pytest.mark.parametrize("text", ["", "# nothing\n", "- 1\n- 2\n", "just words"])
def test_a_file_without_keys_is_named(conf: Path, text: str) -> None:
    (conf / "cart" / "odd.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"conf/cart/odd\.yaml holds .*it should hold `key: value` lines"):
        Cart.load("cart", "odd")


def test_settings_are_frozen() -> None:
    cart = Cart.load("cart", "good")
    with pytest.raises(ValidationError, match="frozen"):
        cart.mass = 2.0  # type: ignore[misc]
    with pytest.raises(ValidationError, match="frozen"):
        cart.wheels[0].radius = 2.0  # type: ignore[misc]
    assert cart == Cart.load("cart", "good")


def test_changes_leave_the_file_as_it_is() -> None:
    """The cached content equals its copy from before, also where a nested value was changed."""
    before = deepcopy(settings.read("cart", "good"))
    changed = Cart.load("cart", "good", mass=9.0, wheels=[{"radius": 7.0}])
    assert (changed.mass, changed.wheels[0].radius) == (9.0, 7.0)
    assert settings.read("cart", "good") == before
    assert Cart.load("cart", "good").mass == 1.5


def test_every_value_stands_in_conf_only() -> None:
    """The promise of the module: settings of the package have no defaults."""
    import affmap.env  # noqa: F401

    own = [kind for kind in Settings.__subclasses__() if kind.__module__.startswith("affmap.")]
    assert own
    fields = [(kind.__name__, key, field) for kind in own for key, field in kind.model_fields.items()]
    assert [(kind, key) for kind, key, field in fields if not field.is_required()] == []


class Grown(Cart):
    """A cart with keys that came later."""

    horn: Annotated[bool, Neutral(False)]
    bells: Annotated[tuple[str, ...], Neutral(())]


def test_a_key_at_its_neutral_value_is_not_written_and_not_needed() -> None:
    """By hand: what was written before the keys existed reads the same, and is written the same."""
    old, grown = Cart.load("cart", "good"), Grown.load("cart", "good")
    assert (grown.horn, grown.bells) == (False, ())
    for mode in ("python", "json"):
        assert grown.model_dump(mode=mode) == old.model_dump(mode=mode)
    assert Grown.load("cart", "good", horn=False, bells=[]) == grown == Grown.model_validate(old.model_dump())
    assert grown.complete() == old.complete() | {"horn": False, "bells": []}


def test_a_key_at_another_value_is_written() -> None:
    loud = Grown.load("cart", "good", horn=True, bells=["ding"])
    assert loud.model_dump(mode="json") == Cart.load("cart", "good").model_dump(mode="json") | {
        "horn": True,
        "bells": ["ding"],
    }
    assert Grown.model_validate(loud.model_dump()) == loud


def test_a_key_without_a_neutral_value_is_still_needed() -> None:
    with pytest.raises(ConfigError, match="mass is missing; add the key"):
        Grown.checked(
            {key: value for key, value in Cart.load("cart", "good").model_dump().items() if key != "mass"}, "x"
        )


class Garage(Settings):
    carts: tuple[Cart, ...]
    first: Cart
    name: str
    dry: Annotated[bool, Neutral(True)]


def test_a_part_is_what_pydantic_writes_of_it() -> None:
    """Pydantic's own serialization, of the same and of other values; a neutral value is left out of both."""
    cart = Cart(mass=2.0, gears=3, color="red", wheels=(Wheel(radius=0.5),), doors=("left",), owner="me")
    for dry in (True, False):
        garage = Garage(carts=(cart, cart), first=cart, name="mine", dry=dry)
        for keys in (["dry", "name", "first"], ["carts"], []):
            assert garage.part(keys) == garage.model_dump(mode="json", include=set(keys))
        assert garage.part(["first"])["first"] is cart.plain


def test_a_copy_with_other_values_has_their_plain_values() -> None:
    """By hand; that of the original has been asked for before."""
    wheel = Wheel(radius=0.5)
    assert wheel.plain == {"radius": 0.5} and wheel.plain is wheel.plain
    for deep in (False, True):
        assert wheel.model_copy(update={"radius": 2.0}, deep=deep).plain == {"radius": 2.0}
    assert wheel.plain == {"radius": 0.5} and wheel.model_copy() == wheel


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"radus": 2.0}, "Wheel.model_copy: radus = 2.0 is not a known key; did you mean radius? There are: radius."),
        ({"radius": "x"}, "Wheel.model_copy: radius = 'x' is not allowed: it should be a valid number"),
    ],
)
def test_a_copy_is_checked_as_a_call_is(changes: dict[str, object], sentence: str) -> None:
    """Which pydantic's is not."""
    with pytest.raises(ConfigError) as error:
        Wheel(radius=0.5).model_copy(update=changes)
    assert str(error.value).startswith(sentence)


class Car(Cart, defaults="cart/good"):
    """A cart with an engine (`conf/cart/good.yaml`)."""

    engine: Annotated[Literal["petrol", "electric"], Neutral("petrol")]
    """Its engine, which
    came later."""


def test_a_call_takes_missing_keys_from_the_file() -> None:
    """The same values, read from the file with `load`."""
    assert Car() == Car.load("cart", "good") and Car().engine == "petrol"
    assert Car(mass=9, engine="electric") == Car.load("cart", "good", mass=9, engine="electric")
    assert Car(**Car(gears=2).model_dump()) == Car.load("cart", "good", gears=2)


def test_whatever_is_read_has_every_key() -> None:
    """Alone or within other settings; a missing key is an error, as for a class without a file."""

    class Fleet(Settings):
        cars: tuple[Car, ...]

    part = {"mass": 2.0, "gears": 1, "color": "red"}
    for read in (
        lambda: Car.model_validate(part),
        lambda: Fleet.model_validate({"cars": [part]}),
    ):
        with pytest.raises(ValidationError) as caught:
            read()
        assert {error["type"] for error in caught.value.errors()} == {"missing"}
        assert [error["loc"][-1] for error in caught.value.errors()] == ["wheels", "doors", "owner"]
    for check in (lambda: Car.checked(part, "here"), lambda: Fleet(cars=[part])):
        with pytest.raises(ConfigError, match=r"wheels is missing; add the key\."):
            check()
    assert Fleet(cars=[Car(mass=3)]).cars[0].mass == 3


def test_copies_of_a_call_are_the_same(conf: Path) -> None:
    """Copied and pickled settings, for which no file is read; neither is one where all keys are given."""
    car = Car(mass=9)
    (conf / "cart" / "good.yaml").unlink()
    assert Car(**car.complete()) == car
    for other in (copy(car), deepcopy(car), pickle.loads(pickle.dumps(car)), car.model_copy()):
        assert other == car and type(other) is Car


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: Car(mass=-1), "Car: mass = -1 is not allowed: it should be greater than 0."),
        (lambda: Car(gears=8), "Car: gears = 8 is too many for mass = 1.5; give at most 7.5."),
        (lambda: Car(gear=2), f"Car: gear = 2 is not a known key; did you mean gears? {KEYS[:-1]}, engine."),
        (lambda: Wheel(), "Wheel: radius is missing; add the key."),
        (lambda: Wheel(radius=[1]), "Wheel: radius = [1] is not allowed: it should be a valid number."),
    ],
)
def test_an_error_in_a_call_is_a_sentence_with_class_key_value_and_remedy(
    call: Callable[[], object], sentence: str
) -> None:
    """Golden sentences, with or without a file; pydantic's own exception is not shown behind them."""
    with pytest.raises(ConfigError) as caught:
        call()
    assert str(caught.value) == sentence and caught.value.__suppress_context__


def test_every_file_with_a_class_gives_the_defaults_of_its_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that `load` reads; the groups of `conf/config.yaml` begin with the same files as the calls."""
    monkeypatch.undo()
    from affmap.config import Config  # noqa: F401  # imports nearly all classes
    from affmap.control import RandomAgent, StraightAgent  # noqa: F401
    from affmap.planning import CEMPlanner, GradientPlanner  # noqa: F401

    derived = [each for kind in Settings.__subclasses__() for each in (kind, *kind.__subclasses__())]
    kinds = [kind for kind in derived if kind.__module__.startswith("affmap.") and kind._file]
    chosen = [each for each in settings.read(".", "config")["defaults"] if isinstance(each, dict)]
    first = {f"{group}/{name}" for each in chosen for group, name in each.items()}
    without_class = {"experiment/None", "search/None", "lookahead/None", "learner/None", "models/train", "scale/full"}
    ours = {each for each in first if not each.startswith("override")} - without_class
    assert ours < {kind._file for kind in kinds}
    for kind in kinds:
        group, _, name = str(kind._file).rpartition("/")
        assert kind() == kind.load(group, name)
        assert f"`conf/{group}" in (kind.__doc__ or "")


def test_a_signature_has_keys_types_and_defaults() -> None:
    """Golden text: types without modules and limits, values of the file and neutral ones."""
    assert str(inspect.signature(Wheel)) == "(*, radius: float)"
    assert str(inspect.signature(Car)) == (
        "(*, mass: float = 1.5, gears: int = 3, color: Literal['red', 'blue'] = 'red', "
        "wheels: tuple[Wheel, ...] = [{'radius': 0.1}, {'radius': 0.2}], "
        "doors: tuple[str, ...] = ['left'], owner: str = 'ada', "
        "garage: Path = PosixPath('garage'), prices: dict[str, int] = {}, "
        "engine: Literal['petrol', 'electric'] = 'petrol')"
    )


def test_help_describes_the_keys() -> None:
    """Golden text of the docstring; the signature and it are part of what `help` shows."""
    assert inspect.getdoc(Car) == (
        "A cart with an engine (`conf/cart/good.yaml`).\n\nArgs:\n    engine: Its engine, which came later."
    )
    assert inspect.getdoc(Wheel) in ("", None)
    shown = pydoc.render_doc(Car, renderer=pydoc.plaintext)
    assert "mass: float = 1.5" in shown and "engine: Its engine, which came later." in shown
    assert "load(" in shown and "inherited from pydantic" not in shown and "__pydantic" not in shown


def test_logs_show_text_from_files_as_text() -> None:
    """Escapes and characters that turn the line around; every format of a log in `conf/hydra` does so."""
    record = logging.LogRecord("a", logging.INFO, "a.py", 1, "%s is corrupted", ("\x1b[2J\u202e\udcff.ckpt",), None)
    paths = [*(folder() / "hydra").glob("*_logging/*.yaml")]
    formats = [each for path in paths for each in yaml.safe_load(path.read_text())["formatters"].values()]
    assert len(paths) == len(formats) == 2
    for each in formats:
        formatter = DictConfigurator({"version": 1}).configure_formatter(dict(each))
        assert formatter.format(record).endswith(r"\x1b[2J\u202e\udcff.ckpt is corrupted")


def test_log_lines_begin_with_the_setting_of_their_job() -> None:
    """Also one with signs that formats know; none has no colon."""
    record = logging.LogRecord("a", logging.INFO, "a.py", 1, "%d epochs", (50,), None)
    assert PrintableFormatter("- %(message)s", setting="title=5%s").format(record) == "- title=5%s: 50 epochs"
    assert PrintableFormatter("- %(message)s").format(record) == "- 50 epochs"
