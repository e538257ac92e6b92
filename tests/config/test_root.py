"""The whole configuration: every file of conf/ is used, every bad value is named, stages depend on what they must."""

import math
import shutil
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from affmap.config import compose, root, sweep
from affmap.config.root import Config, label
from affmap.control.registry import OracleSettings
from affmap.control.straight import StraightAgent
from affmap.env.layout import Acts, Layout
from affmap.env.procedural import Procedural
from affmap.env.rules import Rules
from affmap.pipeline.job import open_store
from affmap.pipeline.stage import CONTROL, DATA, MAP, TRAIN, control_of
from affmap.planning.cem import CEMPlanner
from affmap.planning.gradient import GradientPlanner
from affmap.settings import ConfigError, folder, names
from affmap.training.settings import TrainingSettings

CONF = folder()
NESTED = ["model/transition"]
"""Groups of what a part of another group is made of; other folders in those of groups hold more of their options."""
BY_NAME = ("layout", "protocol")
"""Groups whose files are chosen by name, not by Hydra."""
GROUPS = sorted(path.name for path in CONF.iterdir() if path.is_dir() and path.name not in ("hydra", *BY_NAME)) + NESTED
LAYOUTS = sorted(path.stem for path in (CONF / "layout").glob("*.yaml"))
OPTIONS = [
    (group, str(path.relative_to(CONF / group).with_suffix("")))
    for group in GROUPS
    for path in sorted((CONF / group).rglob("*.yaml"))
    if path.parent == CONF / group or str(path.parent.relative_to(CONF)) not in NESTED
]
Values = dict[str, Any]


def content(path: Path) -> Values:
    values: Values = yaml.safe_load(path.read_text())
    return values


def by_hand(**options: str) -> Values:
    """The YAML files put together without Hydra: the root, the default of each group (or `options`), globals last."""
    root = content(CONF / "config.yaml")
    entries: Values = {}
    for entry in root.pop("defaults"):
        entries.update({} if entry == "_self_" else entry)
    del root["hydra"]
    for group, option in entries.items():
        if group.startswith("override ") or (group not in options and option is None):
            continue
        name = options.get(group, option)
        path = CONF / group / f"{name}.yaml"
        if "@package _global_" in path.read_text():
            for key, value in content(path).items():
                root[key] = {**root[key], **value} if isinstance(root.get(key), dict) else value
        else:
            *parents, last = group.split("/")
            target = root
            for parent in parents:
                target = target[parent]
            target[last] = {key: value for base in _bases(path) for key, value in base.items()}
    root["output"] = root["output"].replace("${name}", root["name"])
    root["training_layouts"] = [name.replace("${world}", root["world"]) for name in root["training_layouts"]]
    for key in ("control_layout", "map_layout"):
        root[key] = root[key].replace("${world}", root["world"])
    return root


def _bases(path: Path) -> list[Values]:
    """A file of a group after those that its defaults name; each may name others."""
    values = content(path)
    names = [name.partition("@")[0] for name in values.pop("defaults", [])]
    return [base for name in names for base in _bases(CONF / f"{name.lstrip('/')}.yaml")] + [values]


def checked(values: Values, **changes: Any) -> Config:
    """Settings from plain values; keys of changes with `__` for the dots."""
    values = deepcopy(values)
    for key, value in changes.items():
        *parents, last = key.split("__")
        target = values
        for parent in parents:
            target = target[parent]
        target[last] = value
    return Config.checked(values, "the test")


@cache
def jobs(experiment: str, scale: str) -> list[Config]:
    return sweep.jobs(sweep.complete([f"experiment={experiment}", f"scale={scale}"]))


@pytest.fixture(scope="module")
def values() -> Values:
    return by_hand()


def dump(config: Config) -> Values:
    """All values, also those that digests leave out."""
    fields = {key: getattr(config, key) for key in type(config).model_fields}
    return {key: dict(value) if hasattr(value, "model_dump") else value for key, value in fields.items()}


def test_the_default_is_what_the_files_say(values: Values) -> None:
    """YAML read without Hydra, by hand."""
    (config,) = sweep.jobs([])
    assert dump(config) == dump(checked(values))


def test_every_file_is_an_option_of_a_group_of_the_root() -> None:
    """No file lies in conf/ that nothing can ever use, and every group is in the defaults."""
    root = content(CONF / "config.yaml")["defaults"]
    groups = {key.removeprefix("override ") for entry in root if isinstance(entry, dict) for key in entry}
    assert {group for group in groups if not group.startswith("hydra/")} == set(GROUPS)
    named = {path for group in BY_NAME for path in (CONF / group).glob("*.yaml")}
    known = {CONF / "config.yaml", *named, *(CONF / group / f"{option}.yaml" for group, option in OPTIONS)}
    assert {path for path in CONF.rglob("*.yaml") if "hydra" not in path.parts} == known
    assert {str(path.relative_to(CONF / "hydra")) for path in CONF.glob("hydra/**/*.yaml")} == {
        "hydra_logging/affmap.yaml",
        "job_logging/affmap.yaml",
        "launcher/slurm.yaml",  # tests/test_launchers.py
    }


@pytest.mark.parametrize(
    ("group", "option"), [pair for pair in OPTIONS if pair[0] not in ("experiment", "search", "learner")]
)
def test_every_option_of_every_group_can_be_used(group: str, option: str) -> None:
    """Composed by Hydra, checked, and equal to the files put together by hand; learners need other worlds than this."""
    (config,) = sweep.jobs([f"{group}={option}"])
    assert dump(config) == dump(checked(by_hand(**{group: option})))


@pytest.mark.parametrize("scale", [option for group, option in OPTIONS if group == "scale"])
@pytest.mark.parametrize("experiment", [option for group, option in OPTIONS if group == "experiment"])
def test_every_job_of_every_experiment_at_every_scale_can_be_used(experiment: str, scale: str) -> None:
    """As many as the product of the sweep's values, all different; smoke runs say so and go elsewhere."""
    actual = jobs(experiment, scale)
    swept = compose.values(compose.compose([f"experiment={experiment}"]))["sweep"]
    assert len(actual) == math.prod(len(str(value).split(",")) for value in swept.values())
    assert len({control_of(job).of(job).digest for job in actual}) == len(actual)
    for job in actual:
        assert job.name == experiment
        assert (job.notice is None) == (scale == "full") == (job.output == Path("runs") / experiment)


# One bad value (or more) for every kind of key; what the message must say of it.
BAD: list[tuple[str, Any, str]] = [
    ("seed", -1, "greater than or equal to 0"),
    ("members", 0, "greater than 0"),
    ("members", 2.5, "valid integer"),
    ("members", "many", "valid integer"),
    ("members", None, "valid integer"),
    ("threads", 0, "greater than 0"),
    ("compiled", "perhaps", "valid boolean"),
    ("models", "steal", "'train' or 'reference'"),
    ("versions", "some", "'same' or 'any'"),
    ("logger", "paper", "'csv', 'tensorboard', 'wandb', 'mlflow' or 'trackio'"),
    ("name", 3, "valid string"),
    ("notice", 3, "valid string"),
    ("output", 3, "should be the path of a folder"),
    ("sweep", "planner", "valid dictionary"),
    ("memebrs", 3, "not a known key"),
    ("world", 3, "valid string"),
    ("training_layouts", [], "names no layout"),
    ("learning.kind", "by heart", "'offline' or 'random' or"),
    ("training_layouts", "original", "valid tuple"),
    ("training_layouts", ["moon"], "does not exist"),
    ("training_layouts", ["procedural_easy"], "which only control_layout may be"),
    ("control_layout", "moon", "does not exist"),
    ("control_layout", "fog", "a model sees the same ones everywhere"),
    ("map_layout", "three_looks", "a model sees the same ones everywhere"),
    ("variation", "moss/2", "should be home, or a factor and its value, such as mass/0.2"),
    ("variation", "number/2.5", "is no number of obstacles"),
    ("variation", "contact/30", "would stop the vehicle for good"),
    ("variation", "goal/0.1", "puts goals 0.1 u away, and control.goal_radius = 0.1 would count runs"),
    ("rival.kind", "chess", "'none' or 'cloning' or 'distilled' or 'td3_bc' or 'ppo' or 'sac'"),
    ("rival.steps", 1000, "not a known key"),
    ("rival_share", 0.0, "greater than 0"),
    ("memory.kind", "elephant", "'none' or 'network'"),
    ("memory.learns", True, "not a known key"),
    ("rival_share", 1.5, "less than or equal to 1"),
    ("acts", "edge", "'center' or 'rim'"),
    ("acts", True, "'center' or 'rim'"),
    ("baselines", "oracle", "valid tuple"),
    ("baselines", [3], "valid string"),
    ("objective", "fame", "'validation_nll', 'mean_distance' or 'success'"),
    ("growth", 3, "valid string"),
    ("vehicle.radius", -0.06, "greater than 0"),
    ("vehicle.radius", 0.005, "greater than or equal to 0.01"),
    ("vehicle.mass", math.nan, "finite number"),
    ("vehicle.mass", 1e-12, "Box2D flies at 2 at most"),
    ("vehicle.mass", 1e12, "lost in rounding"),
    ("vehicle.thrust", 1e12, "Box2D flies at 2 at most"),
    ("vehicle.thrust", 1e-12, "lost in rounding"),
    ("vehicle.force", 1e12, "Box2D flies at 2 at most"),
    ("vehicle.fog_std", 1e12, "less than or equal to 1000"),
    ("vehicle.time_step_s", 1e-12, "lost in rounding"),
    ("vehicle.position_iterations", 10**6, "less than or equal to 1000"),
    ("vehicle.thrust", math.inf, "finite number"),
    ("vehicle.damping", 40.0, "below 1 / time_step_s"),
    ("vehicle.velocity_iterations", 0, "greater than 0"),
    ("data.num_validation", 200, "leaves nothing to train on"),
    ("data.num_sequences", 0, "greater than 0"),
    ("data.num_steps", -300, "greater than 0"),
    ("data.max_hold", 0, "greater than 0"),
    ("data.binary_share", 1.01, "less than or equal to 1"),
    ("data.start", "fog", "'free' or 'clear'"),
    ("data.seed", -1, "greater than or equal to 0"),
    ("model.context_size", -1, "greater than or equal to 0"),
    ("model.context_size", 1.5, "valid integer"),
    ("model.context_size", "8 or so", "valid integer"),
    ("model.hidden_size", 0, "greater than 0"),
    ("model.delta_scale", 0.0, "greater than 0"),
    ("model.contextsize", 8, "not a known key"),
    (
        "model.transition",
        "gru",
        "it should be the keys of a file of conf/model/transition; choose one by model/transition=gru",
    ),
    ("model.transition", "split", "choose one by model/transition=split"),
    ("model.transition.kind", "lstm", "it should be 'additive' or 'split' or 'gatel0rd' or 'gru' or 'hyper' or 'mlp'"),
    ("model.transition.encoder", "none", "it should be 'plain', 'centered' or 'channels'"),
    ("model.transition.paste", -1.0, "greater than or equal to 0"),
    ("model.transition.effect_std", -0.1, "greater than or equal to 0"),
    ("model.transition.penalty", math.inf, "finite number"),
    ("model.transition.layers", 2, "not a known key"),
    ("training.num_epochs", 0, "greater than 0"),
    ("training.batch_size", 0, "greater than 0"),
    ("training.chunk_length", 0, "greater than 0"),
    ("training.vision_lr", 0, "greater than 0"),
    ("training.vision_lr", "fast", "valid number"),
    ("training.vision_lr", None, "valid number"),
    ("training.vision_lr", [], "training.vision_lr = [] is not allowed: it needs a number, or one for each trial."),
    ("training.transition_lr", -0.008, "greater than 0"),
    ("training.transition_lr", [0.1, math.inf], "transition_lr[1] = inf is not allowed: it should be a finite number"),
    ("training.vision_max_norm", [0], "vision_max_norm[0] = 0 is not allowed: it should be greater than 0"),
    ("training.transition_max_norm", 0.0, "greater than 0"),
    ("training.vision_max_norm", math.nan, "finite number"),
    ("training.adam_eps", 0.0, "greater than 0"),
    ("training.cooldown", 1.5, "less than or equal to 1"),
    ("training.snapshot_epochs", [0], "greater than 0"),
    ("training.snapshot_epochs", 5, "valid tuple"),
    ("training.accelerator", "abacus", "'cpu', 'gpu' or 'auto'"),
    ("lookup.spacing", -0.1, "greater than or equal to 0"),
    ("lookup.spacing", 100.0, "less than or equal to 0.5"),
    ("lookup.differentiable", "perhaps", "valid boolean"),
    ("planner.kind", "oracle", "'cem' or 'gradient'"),
    ("planner.horizon", 0, "greater than 0"),
    ("planner.num_candidates", 0, "greater than 0"),
    ("planner.num_elites", 51, "must not decrease"),
    ("planner.num_kept", -1, "greater than or equal to 0"),
    ("planner.num_iterations", 0, "greater than 0"),
    ("planner.initial_mean", 1.1, "less than or equal to 1"),
    ("planner.initial_variance", 0.0, "greater than 0"),
    ("planner.momentum", 1, "less than 1"),
    ("planner.learning_rate", 0.1, "not a known key of kind = 'cem'"),
    (
        "agent.kind",
        "pilot",
        "'oracle' or 'seen' or 'filter' or 'true_mean' or 'true_deviation' or 'planner' or 'random' or 'straight'",
    ),
    ("agent.std", 0.0005, "not a known key"),
    ("agent.slow_distance", 0.3, "not a known key"),
    ("control.num_steps", 0, "greater than 0"),
    ("control.runs_per_member", 0, "greater than 0"),
    ("control.beta", -1.0, "greater than or equal to 0"),
    ("control.beta", 1e12, "less than or equal to 1000000"),
    ("control.goal_std_far", 0.0, "greater than 0"),
    ("control.goal_std_far", 1e12, "less than or equal to 1000"),
    ("control.goal_std_near", 1e-12, "greater than or equal to 0.000001"),
    ("control.goal_std_near", math.nan, "finite number"),
    ("control.near_distance", -0.5, "greater than 0"),
    ("control.goal_radius", 0.0, "greater than 0"),
    ("control.goal_radius", 100.0, "would count runs as successes where they start"),
    ("control.goal_radius", 2.8, "the goal may be 2.778 u away"),  # 2.4 to the side and 1.4 up
    ("control.goal_distance", 0.0, "greater than 0"),
    ("control.goal_distance", 0.1, "would count runs as successes where they start"),
    ("control.reports", "blurred", "it should be 'exact' or 'noisy'"),
    ("control.guide", "star", "it should be 'none' or 'time_to_go'"),
    ("control.guide_spacing", 0.01, "greater than or equal to 0.02"),
    ("control.guide_steps", 0.0, "greater than 0"),
    ("control.guide_uncertainty", -1.0, "greater than or equal to 0"),
    ("control.guide_distance", 0.0, "greater than 0"),
    ("control.device", "tpu", "should be cpu, cuda or cuda:<number>"),
    ("control.device", "cuda:01", "should be cpu, cuda or cuda:<number>"),
    ("report.map_spacing", 0.0, "greater than 0"),
    ("report.map_spacing", 0.6, "less than or equal to 0.5"),
    ("report.snapshots", "some", "valid boolean"),
    ("report.partial", "some", "valid boolean"),
    ("report.compare", 3, "valid string"),
    ("report.x", 3, "valid string"),
    ("report.color", 3, "valid string"),
    ("report.claims", "exp99", "there are: exp1, exp10, exp10_factors, exp2"),
    ("report.names", "EB", "valid dictionary"),
    ("report.names", {"cem": "_EB"}, "begin it with another character, since legends leave it out"),
    ("report.outcome", "luck", "'mean_distance' or 'success'"),
    ("report.paper_figures", 4, "valid dictionary"),
    ("report.axes", [0, 1], "valid dictionary"),
    ("report.axes", {"success": [1.0, 0.0]}, "success = [1.0, 0.0] should be the lowest tick, then"),
]


@pytest.mark.parametrize(("key", "value", "problem"), BAD, ids=[f"{key}={value}" for key, value, _ in BAD])
def test_a_bad_value_is_named_with_its_key_and_what_would_be_right(
    values: Values, key: str, value: Any, problem: str
) -> None:
    """One sentence that holds the last part of the key, the value (where it is short) and the problem."""
    with pytest.raises(ConfigError) as caught:
        checked(values, **{key.replace(".", "__"): value})
    message = str(caught.value)
    assert "\n" not in message and message.startswith("the test: ")
    assert key.rpartition(".")[2] in message and problem in message
    assert isinstance(value, list | dict) or str(value) in message
    assert "pydantic" not in message and "https" not in message


def test_bad_values_of_the_gradient_planner_are_named() -> None:
    """The keys that the cross-entropy method does not have."""
    values = by_hand(planner="gradient")
    for key, value in (("decay", 0.0), ("decay", 1.1), ("learning_rate", 0.0), ("initial_action", -0.1)):
        with pytest.raises(ConfigError, match=rf"planner.{key} = {value} is not allowed"):
            checked(values, **{f"planner__{key}": value})
    with pytest.raises(ConfigError, match=r"planner.momentum = 0.1 is not a known key"):
        checked(values, planner__momentum=0.1)


def test_bad_values_of_agents_that_know_the_physics_are_named() -> None:
    """The keys that other agents do not have."""
    for agent in ("filter", "oracle", "seen", "true_mean", "true_deviation"):
        values = by_hand(agent=agent)
        for std in (0.0, -0.1, math.inf):
            with pytest.raises(ConfigError, match=rf"agent.std = {std} is not allowed"):
                checked(values, agent__std=std)
        with pytest.raises(ConfigError, match=r"agent.foresight = 8 is not a known key"):
            checked(values, agent__foresight=8)
        with pytest.raises(ConfigError, match=r"agent.std is missing; add the key"):
            checked(values, agent={"kind": agent})


@pytest.mark.parametrize("kind", [name for name in names("learning") if name != "offline"])
def test_bad_values_of_learning_online_are_named(kind: str) -> None:
    """Single keys, and keys that do not go together."""
    values = by_hand(learning=kind)
    plans = () if kind == "random" else ("num_plans", "plan_steps", "executed_steps", "resolution", "spacing")
    for key, value in [("committee", 1), *((key, 0) for key in ("round_steps", "updates", *plans))]:
        with pytest.raises(ConfigError, match=rf"learning.{key} = {value} is not allowed"):
            checked(values, **{f"learning__{key}": value})
    for changes, sentence in (
        ({"members": 7}, r"members = 7 is no multiple of learning.committee = 5; every agent has a committee"),
        ({"training__chunk_length": 30}, r"learning.round_steps = 100 is no multiple of training.chunk_length = 30;"),
        ({"training__vision_lr": [0.1, 0.2]}, r"training.vision_lr has several trials, which learn offline only;"),
        ({"training__accelerator": "gpu"}, r"training.accelerator = 'gpu' is for learning = 'offline' only, and"),
        ({"logger": "wandb"}, rf"logger = 'wandb' is for .* and learning = '{kind}'; say logger=csv\."),
        ({"model__transition": {"kind": "mlp", "paste": 1.0}}, r"say model.transition.paste=0.0\."),
    ):
        with pytest.raises(ConfigError, match=sentence):
            checked(values, **changes)
    assert checked(values, members=3).learning == checked(values).learning  # a single committee
    if kind == "random":
        checked(values, members=1)
        with pytest.raises(ConfigError, match=r"learning.num_plans = 5 is not a known key of kind = 'random'"):
            checked(values, learning__num_plans=5)
    else:
        if kind == "goals":
            for key, value in (("information_weight", -1), ("goal_std", 0), ("goal_radius", 0)):
                with pytest.raises(ConfigError, match=rf"learning.{key} = {value} is not allowed"):
                    checked(values, **{f"learning__{key}": value})
        with pytest.raises(ConfigError, match=r"executed_steps = 21 is more than plan_steps = 20; plan as many"):
            checked(values, learning__executed_steps=21)
        with pytest.raises(ConfigError, match=r"members = 1 is no committee, .* say members=2 or more"):
            checked(values, members=1)


@pytest.mark.parametrize("memory", ["explored", "outdated", "repaired", "empty"])
def test_bad_values_of_memories_are_named(memory: str) -> None:
    """Single keys, and all that a memory does not go together with."""
    values = by_hand(memory=memory)
    for key, value in values["memory"].items():
        bad: Any = "-1" if isinstance(value, str) else -1
        with pytest.raises(ConfigError, match=rf"memory.{key} = {bad!r} is not allowed"):
            checked(values, **{f"memory__{key}": bad})
    for changes, key, remedy in (
        ({"agent": {"kind": "random"}}, "agent", "agent=planner"),
        ({"lookup__spacing": 0.0}, "lookup.spacing", "lookup=map"),
        ({"model__context_size": 0}, "model.context_size", "model.context_size=8"),
        ({"control__guide": "time_to_go"}, "control.guide", "control.guide=none"),
        ({"control__device": "cuda"}, "control.device", "control.device=cpu"),
        ({"variation": "mass/0.2"}, "variation", "variation=home"),
    ):
        with pytest.raises(ConfigError, match=rf"stays as it is, so that {key} cannot .* say {remedy} or memory=none"):
            checked(values, **changes)
    for line in (
        ["training_layouts=[training_doors]", "control_layout=doors"],
        ["world=four_properties", "control_layout=procedural_easy"],
    ):
        with pytest.raises(
            ConfigError, match=r"so that control_layout cannot be as it is; say control_layout=original"
        ):
            sweep.jobs([f"memory={memory}", "map_layout=${training_layouts.0}", *line])
    with pytest.raises(ConfigError, match=r"so that rival cannot be as it is; say rival=none"):
        sweep.jobs([f"memory={memory}", "rival=cloning"])


@pytest.mark.parametrize("kind", ["cloning", "distilled", "td3_bc", "ppo", "ppo_million", "sac"])
def test_bad_values_of_rivals_are_named(kind: str) -> None:
    """Single keys, and keys that do not go together."""
    values = by_hand(rival=kind)
    for key, value in values["rival"].items():
        if type(value) in (int, float):
            with pytest.raises(ConfigError, match=rf"rival.{key} = -1 is not allowed"):
                checked(values, **{f"rival__{key}": -1})
    for changes, sentence in (
        ({"rival__hidden_sizes": [0]}, r"rival.hidden_sizes.* should be greater than 0"),
        ({"rival__name": ""}, r"rival.name = '' is not allowed"),
        ({"rival__kind": "none"}, r"is not a known key"),
        ({"agent": {"kind": "random"}}, r"rival = '.*' flies instead of the agent, .* say agent=planner or rival=none"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            checked(values, **changes)
    if kind.startswith("ppo"):
        with pytest.raises(ConfigError, match=r"rival.num_vehicles = 6 does not share a rollout of 2048 steps"):
            checked(values, rival__num_vehicles=6)
    assert checked(values).controller == kind
    assert list(checked(values, rival__members=2).pilots) == [0, 1]


def test_every_key_of_every_group_has_a_bad_value_above() -> None:
    """A key that is added without one fails here."""
    listed = {key for key, _, _ in BAD}
    free = {"name", "title", "store", "reference", "output", "notice", "sweep"}
    keys = {
        f"{group}.{key}" if isinstance(group_values, dict) and group != "sweep" else group
        for group, group_values in by_hand().items()
        for key in (group_values if isinstance(group_values, dict) and group != "sweep" else [""])
    }
    physics = {key for key in keys if key.startswith("vehicle.")}  # tests/env have theirs
    assert keys - listed - free - physics == set()


GUIDE = {"guide", "guide_spacing", "guide_steps", "guide_uncertainty", "guide_distance"}
NEUTRAL = {
    "report": {"x", "color", "paper_figures"},
    "model": {"transition"},
    "training": {"cooldown"},
    "control": {*GUIDE, "goal_distance", "reports"},
    "data": {"start"},
    "vehicle": {"sensor_std"},
}
"""Keys that may be missing, which says the same as their neutral value."""


def test_every_missing_key_is_named(values: Values) -> None:
    """Nothing has a default in the code, but for keys that configurations did not have at first."""
    for group in [key for key, value in values.items() if isinstance(value, dict) and key != "sweep"]:
        for key in set(values[group]) - NEUTRAL.get(group, set()):
            lacking = {**values, group: {other: value for other, value in values[group].items() if other != key}}
            with pytest.raises(ConfigError, match=key):
                Config.checked(lacking, "the test")
    for key in values:
        lacking = {other: value for other, value in values.items() if other != key}
        if key in ("agent", "learning", "memory", "rival", "rival_share", "variation"):
            assert Config.checked(lacking, "the test") == checked(values)
            continue
        with pytest.raises(ConfigError, match=rf"{key} is missing; add the key"):
            Config.checked(lacking, "the test")


def test_several_bad_values_are_all_named_each_with_its_file() -> None:
    """Through Hydra: the option chosen on the command line, and the root."""
    with pytest.raises(ConfigError) as caught:
        sweep.jobs(["planner=gradient", "planner.horizon=0", "model.context_size=-1", "members=0", "control.beta=nan"])
    assert sorted(str(caught.value).split("\n")) == [
        "conf/config.yaml or the command line: members = 0 is not allowed: it should be greater than 0.",
        "conf/control/default.yaml or the command line: control.beta = nan is not allowed: "
        "it should be a finite number.",
        "conf/model/default.yaml or the command line: model.context_size = -1 is not allowed: "
        "it should be greater than or equal to 0.",
        "conf/planner/gradient.yaml or the command line: planner.horizon = 0 is not allowed: "
        "it should be greater than 0.",
    ]


def test_keys_that_do_not_go_together_are_named(values: Values) -> None:
    """A start corner must be free for the vehicle; lists are for the same trials."""
    with pytest.raises(ConfigError, match=r"layout 'original': .* too small for a vehicle of radius 0.11"):
        checked(values, vehicle__radius=0.11)
    with pytest.raises(ConfigError) as caught:
        checked(values, training__transition_lr=[0.1, 0.2], training__vision_max_norm=[1.0, 2.0, 3.0])
    assert str(caught.value) == (
        "the test: training: transition_lr has 2 values, but vision_max_norm has 3; lists need one for each trial."
    )


FOLDERS = [
    ({"output": "store"}, "output and store are both 'store'"),
    ({"output": "link"}, "output and store are one, 'link' = 'store'"),
    ({"reference": "../here/store"}, "store and reference are one"),
    ({"output": "."}, "output = '.' is not allowed"),
    ({"output": "../here"}, "store = 'store' lies in output = '../here'"),
    ({"output": "link/a"}, "output = 'link/a' lies in store = 'store'"),
    ({"output": "runs"}, "reference = 'runs/reference/store' lies in output = 'runs'"),
    ({"output": "runs/reference/store/a"}, "lies in reference = 'runs/reference/store'"),
    ({"store": "runs/reference"}, "reference = 'runs/reference/store' lies in store = 'runs/reference'"),
    ({"reference": "store/reference"}, "reference = 'store/reference' lies in store = 'store'"),
    ({"output": "store/a", "store": "stages"}, "would be published as 'runs/reference/store/a', where reference is"),
]


def test_no_folder_lies_in_another_by_any_name(
    values: Values, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tried: Callable[[str, int, str], None]
) -> None:
    """Publishing `runs` into itself went 431 folders deep; reports beside each other, and in each other, are fine."""
    (tmp_path / "here" / "store").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    Path("link").symlink_to("store")
    usual = {"output": "exp1", "store": "store", "reference": "runs/reference/store"}
    for places, message in FOLDERS:
        with pytest.raises(ConfigError) as caught:
            checked(values, **usual | places)
        assert message in str(caught.value) and "\n" not in str(caught.value), places
    tried("one folder under two names, or inside another one", len(FOLDERS), "a sentence that names both")
    for output in ("exp1", "exp1/baselines", "runs/reference/exp1", "link-like", "storeroom"):
        assert checked(values, **usual | {"output": output}).published == Path("runs/reference") / output
    assert checked(values, **usual | {"output": "a/../b"}).published == Path("runs/reference/b")


@pytest.fixture
def own_layouts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the configuration folder, to put layouts into."""
    shutil.copytree(CONF, tmp_path / "conf")
    monkeypatch.setattr("affmap.settings.base.folder", lambda: tmp_path / "conf")
    monkeypatch.setattr("affmap.settings.base.own_folder", lambda: None)
    return tmp_path / "conf" / "layout"


@pytest.mark.parametrize(
    ("copied", "changes", "key", "message"),
    [
        ("original", {}, "control_layout", "name = 'original' must be that of the file, 'mine'"),
        ("procedural_easy", {"name": "mine", "count": [70, 70]}, "control_layout", "no layout was found"),
        ("original", {"name": "mine", "start_margin": 0.05}, "training_layouts", "too small for a vehicle"),
    ],
)
def test_a_layout_that_cannot_be_used_is_reported_before_anything_runs(
    own_layouts: Path, copied: str, changes: Values, key: str, message: str
) -> None:
    """A name that is not the file's, rules that no world obeys, a corner that is no place to start in."""
    layout = content(own_layouts / f"{copied}.yaml") | changes
    (own_layouts / "mine.yaml").write_text(yaml.safe_dump(layout))
    world = "training_obstacles" if copied == "procedural_easy" else "original"
    values = by_hand() | {"training_layouts": [world], "map_layout": world, "control_layout": world}
    with pytest.raises(ConfigError, match=message):
        Config.checked(values | {key: ["mine"] if key == "training_layouts" else "mine"}, "the test")


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_can_be_used(name: str) -> None:
    """As the world of everything, or, one that is drawn, where its properties were learned."""
    values = content(CONF / "layout" / f"{name}.yaml")
    if "circles" in values:
        (config,) = sweep.jobs([f"world={name}"])
        assert config.training_layouts == (config.control_layout,) == (config.map_layout,)
    else:
        world = "training_doors" if "door" in values["channels"] else "training_fog"
        (config,) = sweep.jobs([f"world={world}", f"control_layout={name}"])
        assert isinstance(config.control_layout, Rules)
    assert config.control_layout.name == name


STAGES = ("data", "train", "map", "control")

ONLINE = content(CONF / "learning/disagreement.yaml")
MEMORY = content(CONF / "memory/explored.yaml")

# A change of each kind, and the stages whose results it must change. Everything else must keep its digest, or
# experiments would not find each other's results.
CHANGES: list[tuple[str, Any, str]] = [
    ("data.seed", 1, "data train map control"),
    ("data.num_steps", 299, "data train map control"),
    ("training_layouts", ["two_obstacles"], "data train map control"),
    ("training_layouts", ["original", "two_obstacles"], "data train map control"),
    ("control_layout", "two_obstacles", "control"),
    ("map_layout", "two_obstacles", "map"),
    ("world", "two_obstacles", ""),  # its name; the layouts follow it in Hydra's composition
    ("growth", "other", ""),
    ("acts", "rim", ""),  # as the layout itself says, by saying nothing
    ("acts", "center", "data train map control"),
    ("baselines", ["oracle", "random"], ""),
    ("objective", "success", ""),
    ("vehicle.contact_damping", 15.0, "data train map control"),
    ("seed", 1, "train map control"),
    ("members", 24, "train map control"),
    ("model.context_size", 5, "train map control"),
    ("model.delta_scale", 1.0, "train map control"),
    ("model.transition", {"kind": "mlp"}, ""),
    ("model.transition", {"kind": "gru"}, "train map control"),
    ("model.transition", {"kind": "mlp", "encoder": "plain", "paste": 0.0, "effect_std": 0.0, "penalty": 0.0}, ""),
    ("model.transition", {"kind": "mlp", "encoder": "centered"}, "train map control"),
    ("model.transition", {"kind": "mlp", "paste": 1.0}, "train map control"),
    ("model.transition", {"kind": "mlp", "effect_std": 0.1}, "train map control"),
    ("model.transition", {"kind": "mlp", "penalty": 0.1}, "train map control"),
    ("training.num_epochs", 49, "train map control"),
    ("training.vision_lr", 0.001, "train map control"),
    ("training.vision_lr", [0.00075], "train map control"),
    ("training.transition_lr", [0.008, 0.001], "train map control"),
    ("training.vision_max_norm", [2, 1], "train map control"),
    ("training.transition_max_norm", [1.2, 1], "train map control"),
    ("training.cooldown", 0.4, "train map control"),
    ("training.snapshot_epochs", [1], "train map control"),
    ("learning", {"kind": "offline"}, ""),
    ("learning", ONLINE, "train map control"),
    ("learning", {**ONLINE, "kind": "information"}, "train map control"),
    ("models", "reference", "map control"),
    ("report.map_spacing", 0.05, "map"),
    ("control.num_steps", 100, "control"),
    ("control.beta", 10.0, "control"),
    ("control.runs_per_member", 8, "control"),
    ("control.goal_distance", 1.0, "control"),
    ("control.guide", "time_to_go", "control"),
    ("control.reports", "noisy", "control"),
    ("control.reports", "exact", ""),
    ("variation", "mass/0.2", "control"),
    ("variation", "home", ""),
    ("lookup.spacing", 0.03, "control"),
    ("lookup.differentiable", True, "control"),
    ("planner.num_iterations", 3, "control"),
    ("planner.momentum", 0.2, "control"),
    ("agent", {"kind": "planner"}, ""),
    ("agent", {"kind": "random"}, "control"),
    ("agent", {"kind": "oracle", "std": 0.0005}, "control"),
    ("agent", {"kind": "filter", "std": 0.0005}, "control"),
    ("agent", {"kind": "true_mean", "std": 0.0005}, "control"),
    ("agent", {"kind": "true_deviation", "std": 0.0005}, "control"),
    ("agent", {"kind": "straight", "foresight": 8, "slow_distance": 0.3}, "control"),
    ("memory", {"kind": "none"}, ""),
    ("memory", MEMORY, "control"),
    ("rival", {"kind": "none"}, ""),  # others in tests/pipeline/test_policy.py
    ("rival_share", 0.5, ""),
    ("training.accelerator", "gpu", ""),
    ("control.device", "cuda", ""),
    ("threads", 4, ""),
    ("compiled", False, ""),
    ("name", "other", ""),
    ("title", "Other", ""),
    ("notice", "a note", ""),
    ("output", "elsewhere", ""),
    ("store", "elsewhere", ""),
    ("reference", "elsewhere", ""),
    ("versions", "any", ""),
    ("logger", "tensorboard", ""),
    ("logger", "wandb", ""),
    ("sweep", {"seed": "1,2"}, ""),
    ("report.snapshots", True, "map"),
    ("report.compare", "lookup.spacing", ""),
    ("report.x", "lookup.spacing", ""),
    ("report.color", "planner", ""),
    ("report.partial", True, ""),
    ("report.claims", "exp2", ""),
    ("report.names", {}, ""),
    ("report.paper_figures", {"results": 4}, ""),
    ("report.outcome", "success", ""),
    ("report.axes", {}, ""),
]


def digests(config: Config) -> dict[str, str]:
    stages = (DATA.of(config), TRAIN.of(config), MAP.of(config), CONTROL.of(config))
    assert tuple(stage.name for stage in stages) == STAGES
    return {stage.name: stage.digest for stage in stages}


@pytest.mark.parametrize(("key", "value", "changed"), CHANGES, ids=[key for key, _, _ in CHANGES])
def test_a_change_makes_those_stages_anew_that_depend_on_it(values: Values, key: str, value: Any, changed: str) -> None:
    """The table above, written from what each stage computes."""
    before, after = digests(checked(values)), digests(checked(values, **{key.replace(".", "__"): value}))
    assert {name for name in STAGES if before[name] != after[name]} == set(changed.split())


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"encoder": "channels"},
            "model.context_size = 2 leaves none .* of 4 channels, .* 4 or more",
        ),
        ({"paste": 0.5}, None),
        ({}, None),
    ],
)
def test_each_channel_has_units_where_channels_are_encoded_apart(
    values: Values, changes: Values, told: str | None
) -> None:
    """Four channels; without a code, and with four units, there is nothing to tell."""
    fog = dict.fromkeys(("control_layout", "map_layout"), "training_fog") | {"training_layouts": ["training_fog"]}
    for size in (0, 2, 4):
        config = {**fog, "model__context_size": size, "model__transition": {"kind": "mlp", **changes}}
        if told and size == 2:
            with pytest.raises(ConfigError, match=told):
                checked(values, **config)
        else:
            assert checked(values, **config).model.context_size == size


@pytest.mark.parametrize(("world", "refused"), [("training_fog", {4, 5, 6, 7}), ("original", set())])
def test_a_block_holds_units_of_one_channel(values: Values, world: str, refused: set[int]) -> None:
    """By hand, blocks of two: six units are 1, 2, 1 and 2 of four channels; nine are 2, 2, 2 and 3, in two blocks.

    Any number will do where there is one channel, or no code.
    """
    layouts = {"control_layout": world, "map_layout": world, "training_layouts": [world]}
    given = content(CONF / "model/transition/split_channels.yaml")
    for size in (0, *range(4, 10)):
        config = {**layouts, "model__context_size": size, "model__transition": given}
        if size in refused:
            with pytest.raises(ConfigError, match=r"lay units of several .*context_size=8 or .*block_size=1\.$"):
                checked(values, **config)
            config["model__transition"] = given | {"block_size": 1}
        assert checked(values, **config).model.context_size == size


def test_every_number_of_a_group_changes_the_stages_of_its_group(values: Values) -> None:
    """Each number of each group in turn, changed a little; so none is forgotten in a digest."""
    first = {"vehicle": "data", "data": "data", "model": "train", "training": "train"}
    first |= {"lookup": "control", "planner": "control", "control": "control"}
    before = digests(checked(values))
    for group, stage in first.items():
        for key, value in values[group].items():
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                other = value + 1 if isinstance(value, int) else 0.99 * value or 0.5
                after = digests(checked(values, **{f"{group}__{key}": other}))
                assert after[stage] != before[stage], f"{group}.{key}"


def test_the_reference_s_models_are_found() -> None:
    """Experiment I's: their folders of 2026, by name."""
    actual = {job.model.context_size: TRAIN.of(job).digest for job in jobs("exp1", "full")}
    assert actual == {
        0: "a4af59933f2cf7f5",
        1: "a0ceaccea039d92e",
        3: "bf4bd236cc54a04c",
        5: "04cc48568b710991",
        8: "5a58f256b5c01453",
    }
    kept = {path.name for path in (CONF.parent / "runs/reference/store/train").iterdir()}
    experiments = [path.stem for path in CONF.glob("experiment/exp*.yaml")]
    assert {TRAIN.of(job).digest for name in experiments for job in jobs(name, "full")} == kept


KEYS = ("vision_lr", "transition_lr", "vision_max_norm", "transition_max_norm")


@given(st.dictionaries(st.sampled_from(KEYS), st.lists(st.floats(1e-12, 1e12), min_size=1, max_size=3)))
def test_lists_make_trials_if_they_have_one_length(lists: dict[str, list[float]]) -> None:
    """Counted by hand; the values are those given, also in a stage's configuration, and other keys keep theirs."""
    lengths = {len(values) for values in lists.values()}
    plain = TrainingSettings.load("training", "default")
    if len(lengths) > 1:
        with pytest.raises(ConfigError, match=r"_(lr|max_norm) has \d values, but \w+ has \d; lists need one for each"):
            TrainingSettings.load("training", "default", **lists)
    else:
        actual = TrainingSettings.load("training", "default", **lists)
        assert actual.num_trials == (lengths.pop() if lists else None)
        assert actual.per_trial == {key: tuple(values) for key, values in lists.items()}
        assert actual.model_dump(mode="json") == plain.model_dump(mode="json") | lists


def all_layouts(config: Config) -> list[Layout | Rules]:
    return [*config.training_layouts, config.control_layout, config.map_layout]


@pytest.mark.parametrize("acts", ["center", "rim"])
@pytest.mark.parametrize("line", [["experiment=exp5"], ["experiment=exp4"], ["world=original"]])
def test_one_key_says_where_terrains_act_in_all_layouts(line: list[str], acts: Acts) -> None:
    """Each layout's own file with this one value; also of a world that is drawn, and of no key, as the files say."""
    plain, explicit = sweep.jobs(sweep.complete(line)), sweep.jobs(sweep.complete([*line, f"acts={acts}"]))
    assert len(plain) == len(explicit)
    for before, after in zip(plain, explicit, strict=True):
        for own, layout in zip(all_layouts(before), all_layouts(after), strict=True):
            assert own == type(own).load("layout", own.name)
            assert layout == type(own).load("layout", own.name, acts=acts)
        if isinstance(after.control_layout, Procedural):
            assert after.control_layout.draw(np.random.default_rng(0)).acts == acts


def test_layouts_that_act_at_the_rim_have_the_names_they_had_before_they_could_say_so(own_layouts: Path) -> None:
    """Experiment V with `acts=rim`, against the same files without the key; as they are, every stage is another one."""
    line = ["experiment=exp5", "model.context_size=0"]
    explicit, plain = (sweep.jobs(sweep.complete([*line, *more])) for more in (["acts=rim"], []))
    for path in own_layouts.glob("*.yaml"):
        path.write_text("".join(row for row in path.read_text().splitlines(True) if not row.startswith("acts:")))
    before = sweep.jobs(sweep.complete(line))
    assert len(before) == 2
    for without, rim, center in zip(before, explicit, plain, strict=True):
        assert "acts" not in str([layout.plain for layout in all_layouts(without)])
        assert digests(rim) == digests(without)
        assert not set(digests(center).values()) & set(digests(rim).values())


def test_planners_share_models_and_context_sizes_share_data() -> None:
    """Experiment I: one data set, a training and a map a context size, a control stage a job."""
    counts = [len({digests(job)[name] for job in jobs("exp1", "full")}) for name in STAGES]
    assert counts == [1, 5, 5, 10]


def test_experiments_find_the_models_of_experiment_1() -> None:
    """II needs no training of its own, III one for its hard condition; V trains once for both conditions."""
    trained = {name: {digests(job)["train"] for job in jobs(name, "full")} for name in ("exp1", "exp2", "exp3", "exp5")}
    assert trained["exp2"] == trained["exp1"] and len(trained["exp1"]) == 5
    assert len(trained["exp3"]) == 10 and trained["exp3"] > trained["exp1"]
    assert len(trained["exp5"]) == 7 and len(jobs("exp5", "full")) == 14
    original = {digests(job)["control"] for job in jobs("exp1", "full")}
    assert len(original & {digests(job)["control"] for job in jobs("exp2", "full")}) == 5


def test_the_experiments_numbers_are_the_paper_s() -> None:
    """Sections 5.4 to 5.7 and Appendix A, by hand."""
    assert {job.control.beta for job in jobs("exp4", "full")} == {10.0}
    for job in jobs("exp5", "full"):
        assert (job.training.vision_lr, job.training.transition_lr) == pytest.approx((0.000075, 0.0008))
        assert job.training.num_epochs == 500 and len(job.training_layouts) == 4
        assert {circle.effect for layout in job.training_layouts for circle in layout.circles} == set(job.channels) - {
            "solid"
        } | {"obstacle"}
    (growth,) = jobs("exp3_growth", "full")
    assert (*growth.training.snapshot_epochs, growth.training.num_epochs) == (1, 2, 5, 10, 30, 100)


def test_seeds_planners_and_labels() -> None:
    """By hand."""
    (config,) = sweep.jobs(["seed=7", "members=3", "planner=gradient", "model.context_size=5"])
    assert list(config.seeds) == [7, 8, 9]
    assert isinstance(config.planner, GradientPlanner)
    assert label(config) == "original, context size 5, gradient, map of 0.02 u"
    (config,) = sweep.jobs(["agent=straight", "model.context_size=5"])
    assert isinstance(config.agent, StraightAgent) and config.controller == "straight"
    assert label(config) == "original, context size 5, straight, map of 0.02 u"
    for name in ("filter", "oracle", "seen", "true_mean", "true_deviation"):
        (config,) = sweep.jobs([f"agent={name}", "agent.std=0.01"])
        assert config.agent == OracleSettings(kind=name, std=0.01) and config.controller == name
        assert label(config) == f"original, context size 8, {name}, map of 0.02 u"
    (config,) = sweep.jobs([])
    assert isinstance(config.planner, CEMPlanner) and config.controller == "cem"
    with pytest.raises(Exception, match="frozen"):
        config.members = 3


def test_only_the_reference_s_models_are_looked_for_in_the_reference(values: Values, tmp_path: Path) -> None:
    """`models=train` never takes what lies in the reference's store; `models=reference` does."""
    for models, expected in (("train", False), ("reference", True)):
        config = checked(values, models=models, store=str(tmp_path / "own"), reference=str(tmp_path / "kept"))
        kept = tmp_path / "kept" / "train" / TRAIN.of(config).digest
        kept.mkdir(parents=True, exist_ok=True)
        (kept / "provenance.json").write_text("{}")
        assert open_store(config).has(TRAIN.of(config)) == expected


@pytest.mark.parametrize("kind", ["filter", "oracle", "seen", "true_mean", "true_deviation"])
def test_what_an_oracle_cannot_do_is_said_before_anything_runs(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gradients of the true physics, and flights without numba; compiled loops may be switched off."""
    with pytest.raises(ConfigError, match=f"agent = '{kind}' .* has no gradients for .*; say planner=cem"):
        sweep.jobs([f"agent={kind}", "planner=gradient"])
    assert sweep.jobs([f"agent={kind}", "compiled=false"])[0].agent.kind == kind
    monkeypatch.setattr(root, "installed", lambda: False)
    with pytest.raises(ConfigError, match=r"needs numba, .* baselines=\[straight,random\]"):
        sweep.jobs([f"agent={kind}", "seed=77"])
