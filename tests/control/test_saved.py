"""Saved agents: bit by bit against those that were saved; files that were changed; folders that are no saved agents."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

import affmap
from affmap.control import pretrained, saved
from affmap.control.agent import Agent
from affmap.model.lookup import AffordanceMap, ExactLookup, LookupSettings, make_lookup
from affmap.model.stack import ModelSettings, Stack
from affmap.model.transition import MLP
from affmap.model.weights import WEIGHTS
from affmap.results.files import VALIDATION
from affmap.settings import ConfigError
from affmap.store.provenance import with_checksum
from affmap.store.stage import StoreError

LAYOUT = affmap.Layout.load("layout", "fog")
CONTROL = affmap.control.ControlSettings.load("control", "default", num_steps=3, beta=5.0, runs_per_member=2)
VEHICLE = affmap.Vehicle.load("vehicle", "default", thrust=0.7)
LOSSES = pd.DataFrame(
    {"member": [3, 3, 7, 7], "epoch": [1, 2, 1, 2], "training_nll": 0.5, "validation_nll": [0.1, -1.23, np.nan, 3.0]}
)
PLANNERS: dict[str, Any] = {
    "cem": affmap.CEMPlanner.load("planner", "cem", horizon=4, num_candidates=8, num_iterations=2),
    "gradient": affmap.GradientPlanner.load("planner", "gradient", horizon=3, num_iterations=2),
}


def make(kind: str = "mlp", planner: str = "cem", size: int = 2, seeds: tuple[int, ...] = (3, 7), **look: Any) -> Agent:
    """Untrained members in the world of Experiment IV; a map whose columns and rows lie differently far apart."""
    settings = ModelSettings.load("model", "default", context_size=size, hidden_size=6, transition={"kind": kind})
    stack = Stack(settings, 2, seeds)
    lookup = make_lookup(LookupSettings.load("lookup", "map", **{"spacing": 0.29, **look}), stack, [LAYOUT.map])
    return Agent(stack, lookup, PLANNERS[planner], CONTROL, LAYOUT.channels, VEHICLE)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"kind": "gru", "planner": "gradient", "differentiable": True},
        {"size": 0, "spacing": 0},
        {"spacing": 0},
    ],
)
def test_a_loaded_agent_flies_the_same_runs(options: dict[str, Any], tmp_path: Path) -> None:
    """Bit for bit: weights, map and flights; settings, channels and vehicle are equal."""
    agent = make(**options)
    agent.save(tmp_path / "mine")
    loaded = affmap.load(tmp_path / "mine")
    assert {path.name for path in (tmp_path / "mine").iterdir()} == {saved.AGENT, WEIGHTS}
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    for key in ("planner", "settings", "channels", "vehicle", "seeds"):
        assert getattr(loaded, key) == getattr(agent, key)
    assert loaded.stack.settings == agent.stack.settings and type(loaded.lookup) is type(agent.lookup)
    if isinstance(agent.lookup, AffordanceMap) and isinstance(loaded.lookup, AffordanceMap):
        assert torch.equal(loaded.lookup.codes, agent.lookup.codes)
    flown, again = (affmap.fly(each, LAYOUT).trajectories for each in (agent, loaded))
    for key, values in flown.items():
        np.testing.assert_array_equal(again[key], values, err_msg=key)


def test_some_members_another_planner_another_world(tmp_path: Path) -> None:
    """Of the saved ones; flights of a member are those of it together with others, to rounding."""
    agent = make()
    agent.save(tmp_path / "mine")
    loaded = affmap.load(tmp_path / "mine", members=[7], planner={"horizon": 2})
    assert loaded.planner == agent.planner.model_copy(update={"horizon": 2})
    loaded = affmap.load(tmp_path / "mine", members=[7], planner="gradient")
    assert loaded.seeds == (7,) and loaded.planner == affmap.GradientPlanner.load("planner", "gradient")
    agent.elsewhere([LAYOUT.model_copy(update={"circles": LAYOUT.circles[:1]}).map]).save(tmp_path / "mine")
    loaded = affmap.load(tmp_path / "mine", members=[7], context_size=2, transition="mlp", layout="fog")
    assert isinstance(loaded.lookup, AffordanceMap) and loaded.lookup.worlds == [LAYOUT.map]
    alone, together = (affmap.fly(each, LAYOUT).trajectories["position"] for each in (loaded, agent))
    np.testing.assert_allclose(alone, together[2:], atol=1e-5)


def test_losses_come_back(tmp_path: Path) -> None:
    """NaN of a member that has diverged, too; an agent without known ones, saved there later, has none."""
    agent = make()
    agent.losses = LOSSES
    agent.save(tmp_path / "mine")
    assert {path.name for path in (tmp_path / "mine").iterdir()} == {*saved.FILES}
    pd.testing.assert_frame_equal(affmap.load(tmp_path / "mine").losses, LOSSES, check_exact=True)
    make().save(tmp_path / "mine")
    assert affmap.load(tmp_path / "mine").losses is None


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"members": [3, 4]}, r"^members = \[3, 4\] is not allowed: .*mine has \[3, 7\]\.$"),
        ({"members": []}, r"^members = \[\] is not allowed; give at least one seed"),
        ({"context_size": 8}, r"has models of the context size 2, none of 8\.$"),
        ({"transition": "gru"}, r"has transition models of the kind mlp; none is 'gru'\.$"),
        ({"layout": "original"}, r"'original' has channels \['solid'\], and the agent was trained with"),
        ({"planner": "pid"}, r"conf/planner holds: cem, gradient"),
    ],
)
def test_wishes_that_it_cannot_meet_are_told(options: dict[str, Any], told: str, tmp_path: Path) -> None:
    make().save(tmp_path / "mine")
    with pytest.raises(ConfigError, match=told):
        affmap.load(tmp_path / "mine", **options)


def test_only_an_earlier_saved_agent_is_replaced(tmp_path: Path) -> None:
    """Also through a link; an empty folder is filled."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "empty")
    make().save(tmp_path / "empty")
    make(seeds=(5,)).save(tmp_path / "link")
    assert affmap.load(tmp_path / "empty").seeds == affmap.load(tmp_path / "link").seeds == (5,)
    assert (tmp_path / "link").is_symlink() and len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("name", [".git/config", "notes.txt", WEIGHTS, VALIDATION, "provenance.json"])
def test_whatever_else_is_there_stays(name: str, tmp_path: Path) -> None:
    """A repository, a text, the weights of a training: every file, and a remedy."""
    path = tmp_path / "mine" / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    with pytest.raises(ConfigError, match=rf"mine has {name.partition('/')[0]}.* stays as it is; save .* another"):
        make().save(tmp_path / "mine")
    assert [each for each in tmp_path.rglob("*") if each.is_file()] == [path] and path.read_text() == "mine"


@pytest.mark.parametrize(("folder", "told"), [("~/mine", "should not begin with ~"), ("..", "end in its name")])
def test_a_folder_that_cannot_be_used_is_told(folder: str, told: str) -> None:
    with pytest.raises(
        ConfigError, match=rf"^folder = '{folder}' is not allowed: it {told}" if "~" in folder else told
    ):
        make().save(folder)


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("")
    with pytest.raises(ConfigError, match="mine is a file, and stays as it is"):
        make().save(tmp_path / "mine")


def test_an_agent_without_its_record_is_told(tmp_path: Path) -> None:
    """Weights alone are no agent; and a saved agent is no experiment."""
    make().save(tmp_path / "mine")
    with pytest.raises(ConfigError, match=r"mine is a saved agent, where an experiment is wanted; give the folder"):
        pretrained.origin(tmp_path / "mine")
    (tmp_path / "mine" / saved.AGENT).unlink()
    with pytest.raises(ConfigError, match=r"mine has weights\.safetensors, but agent\.json is missing"):
        affmap.load(tmp_path / "mine")


@pytest.mark.parametrize(
    ("folder", "told"),
    [
        (3, r"^folder = 3 is not allowed; give a path, such as 'runs/mine'\.$"),
        ("/proc/mine", r"^/proc/mine cannot be made \(.*\); save the agent in another folder\.$"),
    ],
)
def test_a_place_where_nothing_can_be_made_is_told(folder: Any, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        make().save(folder)


class Own(MLP):
    """A transition model that no settings describe."""


class Plain:
    """A planner without settings."""

    horizon = 2


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda agent: setattr(agent, "planner", Plain()), r"^a planner of the class Plain cannot be saved"),
        (lambda agent: setattr(agent, "lookup", len), r"^a look-up of the class builtin_function_or_method cannot"),
        (
            lambda agent: setattr(agent, "lookup", ExactLookup(agent.stack, [LAYOUT.map] * 2)),
            r"^the agent is in 2 worlds",
        ),
        (
            lambda agent: setattr(agent, "stack", Stack(agent.stack.settings, 2, (3,), Own)),
            r"^a transition model of the class Own cannot be saved, because its settings say MLP; register",
        ),
    ],
)
def test_what_no_settings_describe_cannot_be_saved(change: Callable[[Agent], None], told: str, tmp_path: Path) -> None:
    """And leaves nothing behind: an earlier agent stays."""
    agent = make()
    agent.save(tmp_path / "mine")
    change(agent)
    with pytest.raises(ConfigError, match=told):
        agent.save(tmp_path / "mine")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert affmap.load(tmp_path / "mine").seeds == (3, 7)


@pytest.mark.parametrize("name", [saved.AGENT, WEIGHTS, VALIDATION])
@pytest.mark.parametrize("damage", ["cut", "changed", "empty", "other"])
def test_damage_is_told(name: str, damage: str, tmp_path: Path) -> None:
    agent = make()
    agent.losses = LOSSES
    agent.save(tmp_path / "mine")
    path = tmp_path / "mine" / name
    content = path.read_bytes()
    place = content.rindex(b"3")
    changed = content[:place] + b"4" + content[place + 1 :]
    path.write_bytes({"cut": content[:-2], "changed": changed, "empty": b"", "other": b"[]"}[damage])
    with pytest.raises(StoreError, match=rf"mine/{re.escape(name)} is not as it was saved; restore it\.$"):
        affmap.load(tmp_path / "mine")


@pytest.mark.parametrize("name", [WEIGHTS, VALIDATION])
def test_a_missing_or_unreadable_file_is_named(name: str, tmp_path: Path) -> None:
    agent = make()
    agent.losses = LOSSES
    agent.save(tmp_path / "mine")
    (tmp_path / "mine" / name).unlink()
    with pytest.raises(StoreError, match=rf"mine/{re.escape(name)} is missing; restore it\.$"):
        affmap.load(tmp_path / "mine")
    (tmp_path / "mine" / name).mkdir()
    with pytest.raises(StoreError, match=rf"mine/{re.escape(name)} cannot be read \(Is a directory\); restore it\.$"):
        affmap.load(tmp_path / "mine")


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("planner", {"kind": "os.system"}, "os.system"),
        ("model", {"context_size": 10**6, "hidden_size": 10**6, "delta_scale": 4.0}, "cannot be read"),
        ("seeds", [3], "cannot be read"),
        ("vehicle", {"radius": -1}, r"vehicle\.radius = -1"),
        ("extra", 1, "extra = 1 is not a known key"),
        ("world", {"size": 3}, "world"),
    ],
)
def test_a_stranger_s_file_is_read_with_care(key: str, value: Any, told: str, tmp_path: Path) -> None:
    """With a valid checksum: nothing is executed, and a sentence says what is wrong."""
    make().save(tmp_path / "mine")
    path = tmp_path / "mine" / saved.AGENT
    content = json.loads(path.read_text())
    content["agent"][key] = value
    path.write_text(json.dumps(with_checksum(content)))
    with pytest.raises(ConfigError, match=told):
        affmap.load(tmp_path / "mine")
