"""Modules of users; commands with them are tested in `tests/cli/test_extensions.py`."""

import hashlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

from affmap.results import manifest
from affmap.settings import extensions


@pytest.fixture
def garden(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a module that registered a planner and an effect."""
    path = tmp_path / "garden.py"
    path.write_text("x = 1\n")
    module = ModuleType("garden")
    module.__file__ = str(path)
    monkeypatch.setitem(sys.modules, "garden", module)
    monkeypatch.setattr(extensions, "_outside", {})
    for place, name in (("planner.kind", "mine"), ("effect", "sand")):
        extensions.note(place, name, "garden")
    extensions.note("planner.kind", "cem", "affmap.planning.cem")
    return path


def test_origins_are_those_of_what_a_configuration_uses(garden: Path) -> None:
    """By its place: a kind of planner is none of agents; lists and groups in groups count."""
    file = {"module": "garden", "sha256": hashlib.sha256(b"x = 1\n").hexdigest()}
    sand = {"circles": [{"effect": "fog"}, {"effect": "sand"}]}
    for config, names in (
        ({"planner": {"kind": "mine"}}, ["planner.kind=mine"]),
        ({"planner": {"kind": "cem"}, "agent": {"kind": "mine"}, "name": "sand"}, []),
        ({"training_layouts": [sand], "planner": {"kind": "mine"}}, ["effect=sand", "planner.kind=mine"]),
        ({"control_layout": {"properties": [{"effect": "sand"}]}}, ["effect=sand"]),
        ({}, []),
    ):
        assert extensions.origins(config) == [{"name": name, **file} for name in names]


def test_a_name_belongs_to_one_module(garden: Path) -> None:
    """Which may register it anew, as one that is loaded again does."""
    extensions.note("effect", "sand", "garden")
    with pytest.raises(ValueError, match=r"^'sand' of weather is registered by garden already; give it another"):
        extensions.note("effect", "sand", "weather")
    assert extensions._outside["effect", "sand"] == "garden"


def test_the_distribution_of_an_installed_module_is_named(garden: Path) -> None:
    """One without an entry point: pytest's own version."""
    extensions.note("planner.kind", "theirs", "pytest")
    (origin,) = extensions.origins({"planner": {"kind": "theirs"}})
    assert (origin["distribution"], origin["version"]) == ("pytest", pytest.__version__)


def test_a_change_to_a_module_draws_reports_again(garden: Path) -> None:
    """The digest of the code that draws depends on the file."""
    before = manifest.code.__wrapped__()
    assert manifest.code.__wrapped__() == before
    garden.write_text("x = 2\n")
    assert manifest.code.__wrapped__() != before
