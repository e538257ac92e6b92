"""Agents trained by one call in Python, with the stages of a sweep: exploration, training, and an agent that flies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from numpy.typing import ArrayLike

from affmap.config import memory
from affmap.config.compose import compose
from affmap.config.compose import values as plain_values
from affmap.config.root import Config
from affmap.control import arguments
from affmap.control.agent import Agent
from affmap.control.pretrained import reference
from affmap.data.collect import write_dataset
from affmap.env.body import AnyVehicle
from affmap.env.layout import Layout
from affmap.env.procedural import AnyLayout
from affmap.model.lookup import make_lookup
from affmap.model.registry import TransitionSettings
from affmap.pipeline import datasets
from affmap.pipeline.datasets import Arrays
from affmap.pipeline.execution import models
from affmap.pipeline.job import check_trials, open_store
from affmap.pipeline.machine import check_devices
from affmap.pipeline.progress import displayed
from affmap.pipeline.stage import DATA, TRAIN
from affmap.pipeline.train import make_models, trained
from affmap.progress import reported, silent
from affmap.random import generator
from affmap.results.files import read_validation
from affmap.results.setting import STAGES
from affmap.settings import ConfigError, Settings, lies_in
from affmap.settings.changes import Changes, changed
from affmap.settings.messages import format_value
from affmap.store.attempt import Attempt
from affmap.store.files import is_left_behind
from affmap.store.stage import check
from affmap.threads import limited


def train(
    layouts: AnyLayout | Sequence[AnyLayout] | None = None,
    *,
    context_size: int | None = None,
    members: int | None = None,
    epochs: int | None = None,
    seed: int = 0,
    transition: TransitionSettings | Changes | None = None,
    vehicle: AnyVehicle | None = None,
    dataset: str | Path | Mapping[str, ArrayLike] | None = None,
    worlds: int = 1,
    data: Changes | None = None,
    model: Changes | None = None,
    training: Changes | None = None,
    learning: Changes | None = None,
    lookup: Changes | None = None,
    planner: Changes | None = None,
    control: Changes | None = None,
    folder: str | Path | None = None,
    progress: bool = True,
    threads: int = 1,
) -> Agent:
    """Explore layouts, train members on the data, and return an agent that flies.

    Members are trained exactly as by a sweep of the command `affmap` with the same settings. Whatever is not given is
    that of `conf/`. The agent stands in the first layout; `affmap.fly` takes it anywhere.

    Args:
        layouts: where data are collected, in equal parts: one or several of a name of a file in `conf/layout`, a
            layout, its keys and values, or rules for worlds.
        context_size: C, length of the context code.
        members: M, models of different initial weights, trained side by side.
        epochs: of the training.
        seed: of the first member; member m has seed + m.
        transition: the kind of transition model, such as `gru`; or its settings.
        vehicle: the physics, which the agent remembers.
        dataset: a data set that is there already. Either that of a sweep or another call: the folder `data/<digest>` of
            its store, which knows its layouts and its vehicle. Or arrays as `affmap.data.collect.collect` returns them,
            that were collected in `layouts` in any manner.
        worlds: drawn from each of the rules among `layouts`. They are none that `affmap.fly` or `affmap.evaluate`
            draws.
        data: changes of the exploration, such as `{"num_sequences": 50}`; see `affmap.Exploration`.
        model: changes of the architecture; see `affmap.ModelSettings`.
        training: changes of the training, such as `{"batch_size": 5}`; see `affmap.TrainingSettings`.
        learning: `disagreement`, for instance, for agents that choose their experience and learn from it at once, the
            name of a file in `conf/learning`, or its keys and values. Five members are an agent, an epoch is a round of
            100 steps, and the data set serves validation only; see `affmap.learning.SeekingLearning`.
        lookup: changes of the agent's look-up; see `affmap.LookupSettings`.
        planner: changes of its planner, or the name of another, such as `gradient`.
        control: changes of its control, such as `{"beta": 10}`; see `affmap.ControlSettings`.
        folder: of the data set and the models, and of nothing else; it may be new. The same call finds them there
            again, and resumes a training that was interrupted; a sweep with this folder as its `store` does, too.
            Without it, only the agent remains.
        progress: whether progress and loss are shown.
        threads: of PyTorch, for the duration of the call.

    Raises:
        ConfigError: a value is not allowed; there is no such file or data set; or `folder` holds something else.
        MachineError: there is no GPU, and `training` asks for one.
        StoreError: a file in `folder` is corrupted, or was made with other versions of packages.
    """
    values = plain_values(compose([])) | {"seed": seed, "threads": threads}
    default = values["model"]["transition"]
    groups = {"data": data, "model": model, "training": training, "learning": learning}
    groups |= {"lookup": lookup, "planner": planner}
    for group, changes in {**groups, "control": control, "vehicle": vehicle}.items():
        values[group] = changed(group, values[group], changes)
    kind = values["model"].setdefault("transition", default)
    if transition is not None:
        transition = changed("model/transition", dict(kind) if isinstance(kind, Mapping | Settings) else {}, transition)
        _override(values, groups, "model", "transition", "transition", transition)
    if context_size is not None:
        _override(values, groups, "model", "context_size", "context_size", context_size)
    if epochs is not None:
        _override(values, groups, "training", "num_epochs", "epochs", epochs)
    if members is not None:
        values["members"] = members
    existing: Path | Arrays | None = None
    if isinstance(dataset, str | Path):
        existing = Path(dataset)
        values |= datasets.origin(existing)
        given = {"layouts": layouts, "vehicle": vehicle, "data": data}
        if second := [key for key, value in given.items() if value is not None]:
            raise ConfigError(f"dataset has {', '.join(second)} of its own; leave {', '.join(second)} out.")
    else:
        if dataset is not None and layouts is None:
            raise ConfigError(
                "dataset has arrays, which do not say where they were collected; give layouts, too, as in "
                "affmap.train('original', dataset=arrays)."
            )
        explored = _layouts(layouts, worlds, values["data"].get("seed", 0))
        values["training_layouts"] = explored
        if dataset is not None:
            existing = datasets.own(dataset, explored)
            num_sequences, num_steps, _ = existing["action"].shape
            _override(values, groups, "data", "num_sequences", "dataset", num_sequences // len(explored))
            _override(values, groups, "data", "num_steps", "dataset", num_steps)
    with TemporaryDirectory() as temporary, limited(threads), displayed(reported if progress else silent):
        config = _config(values, Path(temporary, "store") if folder is None else _store(folder))
        try:
            stage = _train(config, existing, Path(temporary))
        except KeyboardInterrupt as error:
            kept = f"{folder} keeps its work: the same call resumes" if folder else "without folder= nothing is kept"
            error.add_note(f"affmap.train was interrupted; {kept}.")
            raise
        stack, losses = trained(config, stage), read_validation(stage)
        map_of_first = make_lookup(config.lookup, stack, [config.training_layouts[0].map])
        return Agent(stack, map_of_first, config.planner, config.control, config.channels, config.vehicle, losses)


def _train(config: Config, dataset: Path | Arrays | None, temporary: Path) -> Path:
    """Complete the training, on a data set that is there or will be; returns the folder of its stage.

    Raises:
        StoreError: a file of a stage is corrupted.
    """
    if not isinstance(dataset, dict):
        if dataset:
            check(dataset, DATA.of(config))
        return models(config, (TRAIN,), dataset)[1]
    stage = TRAIN.of(config)
    write_dataset(temporary, dataset)

    def build(attempt: Attempt) -> None:
        check_devices(config, [TRAIN])
        make_models(config, temporary, attempt)

    own = replace(stage, config={**stage.config, "dataset": datasets.digest(dataset)})
    return open_store(config).ensure(own, build)


def _override(
    values: dict[str, Any], groups: Mapping[str, Changes | None], group: str, key: str, argument: str, value: Any
) -> None:
    """Set a key of a group of `values` to the value of an argument that stands for it.

    Raises:
        ConfigError: the group's own changes, of `groups`, give it another.
    """
    changes = groups[group]
    own = dict(changes).get(key, value) if isinstance(changes, Mapping | Settings) else value
    if own != value and not (isinstance(own, Mapping | Settings) and value == {**value, **dict(own)}):
        raise ConfigError(
            f"{group} has {key} = {format_value(own)}, and {argument} gives {format_value(value)}; give it once."
        )
    values[group][key] = value


def _layouts(layouts: AnyLayout | Sequence[AnyLayout] | None, worlds: int, seed: int) -> list[Layout]:
    """The layouts that data are collected in; of rules, so many worlds of their own.

    Raises:
        ConfigError: there is no such file, or a value is not allowed.
    """
    worlds, seed = arguments.whole("worlds", worlds, least=1), arguments.whole("data.seed", seed)
    every: list[Layout] = []
    for layout in arguments.layouts(layouts if layouts is not None else []):
        if isinstance(layout, Layout):
            every.append(layout)
        else:
            every += [layout.draw(generator(seed, "training world", world)) for world in range(worlds)]
    if not every:
        raise ConfigError("train needs layouts to explore, as in affmap.train('original'), or a dataset.")
    return every


def _store(folder: str | Path) -> Path:
    """The folder of a call's data set and models: a store, or one that becomes a store.

    Raises:
        ConfigError: it cannot be used, or holds something else.
    """
    store = arguments.folder(folder)
    named = f"folder = {format_value(str(store))}"
    if store.exists() and not store.is_dir():
        raise ConfigError(f"{named} is a file; give another folder.")
    if lies_in(store, reference()):
        raise ConfigError(f"{named} is of the reference run; give a folder of your own.")
    there = sorted(path.name for path in store.iterdir()) if store.exists() else []
    if strangers := [name for name in there if name not in STAGES and not is_left_behind(name)]:
        raise ConfigError(
            f"{named} has {strangers[0]}, which is of no data set and no models; give a folder of their own, which may "
            "be new."
        )
    return store


def _config(values: Mapping[str, Any], store: Path) -> Config:
    """The configuration of a job that trains the models of a call.

    Raises:
        ConfigError: a value is not allowed.
    """
    # The stages of other commands lie elsewhere; none of these folders is made.
    places = {key: store.with_name(f"{store.name}-{key}") for key in ("output", "reference")}
    first = values["training_layouts"][0]
    layouts = {"control_layout": first, "map_layout": first}
    config = Config.checked({**values, **places, **layouts, "store": store}, "train")
    check_trials(config)
    memory.check(config, "train")
    return config
