"""Agents trained by one call in Python, with the stages of a sweep: exploration, training, and an agent that flies."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

from affmap.config import memory
from affmap.config.compose import compose
from affmap.config.compose import values as plain_values
from affmap.config.root import Config
from affmap.control import arguments
from affmap.control.agent import Agent
from affmap.control.arguments import AnyLayout, AnyVehicle
from affmap.control.pretrained import reference
from affmap.data.settings import Exploration
from affmap.env.layout import Layout
from affmap.model.lookup import make_lookup
from affmap.model.registry import TransitionSettings
from affmap.pipeline.execution import models
from affmap.pipeline.job import check_trials
from affmap.pipeline.progress import displayed
from affmap.pipeline.stage import DATA, TRAIN
from affmap.pipeline.train import trained
from affmap.progress import reported, silent
from affmap.random import generator
from affmap.settings import ConfigError, Settings, check_folder, lies_in, read
from affmap.settings.messages import format_value
from affmap.store.provenance import PROVENANCE
from affmap.store.stage import check
from affmap.store.stage import read as read_record
from affmap.threads import limited

Changes: TypeAlias = Mapping[str, Any] | Settings | str
"""Some keys and values of a group of the configuration; or all, as settings; or the name of its file in `conf`."""


def train(
    layouts: AnyLayout | Sequence[AnyLayout] | None = None,
    *,
    context_size: int | None = None,
    members: int | None = None,
    epochs: int | None = None,
    seed: int = 0,
    transition: TransitionSettings | Changes | None = None,
    vehicle: AnyVehicle | None = None,
    dataset: str | Path | None = None,
    worlds: int = 1,
    data: Changes | None = None,
    model: Changes | None = None,
    training: Changes | None = None,
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
        dataset: in place of layouts and vehicle, a data set that a sweep or another call has collected: the folder
            `data/<digest>` of its store.
        worlds: drawn from each of the rules among `layouts`. They are none that `affmap.fly` or `affmap.evaluate`
            draws.
        data: changes of the exploration, such as `{"num_sequences": 50}`; see `affmap.data.settings.Exploration`.
        model: changes of the architecture; see `affmap.model.settings.ModelSettings`.
        training: changes of the training, such as `{"batch_size": 5}`; see
            `affmap.training.settings.TrainingSettings`.
        lookup: changes of the agent's look-up; see `affmap.model.settings.LookupSettings`.
        planner: changes of its planner, or the name of another, such as `gradient`.
        control: changes of its control, such as `{"beta": 10}`; see `affmap.control.settings.ControlSettings`.
        folder: of the data set and the models. The same call finds them there again, and resumes a training that was
            interrupted; a sweep with this folder as its `store` does, too. Without it, only the agent remains.
        progress: whether progress and loss are shown.
        threads: of PyTorch, for the duration of the call.

    Raises:
        ConfigError: a value is not allowed, or there is no such file or data set.
        MachineError: there is no GPU, and `training` asks for one.
        StoreError: a file in `folder` is corrupted, or was made with other versions of packages.
    """
    values = plain_values(compose([])) | {"seed": seed, "threads": threads}
    groups = {"data": data, "model": model, "training": training, "lookup": lookup, "planner": planner}
    for group, changes in {**groups, "control": control, "vehicle": vehicle}.items():
        values[group] = _change(group, values[group], changes)
    values["model"]["transition"] = _change("model/transition", values["model"]["transition"], transition)
    values["model"] |= _given(context_size=context_size)
    values["training"] |= _given(num_epochs=epochs)
    values |= _given(members=members)
    if dataset is None:
        values["training_layouts"] = _layouts(layouts, worlds, Exploration.checked(values["data"], "train: data"))
    elif layouts is None and vehicle is None and data is None:
        values |= _origin(Path(dataset))
    else:
        raise ConfigError("dataset has layouts, a vehicle and settings of data of its own; leave those arguments out.")
    with TemporaryDirectory() as temporary, limited(threads), displayed(reported if progress else silent):
        config = _config(values, Path(temporary, "store") if folder is None else Path(folder))
        if dataset is not None:
            check(Path(dataset), DATA.of(config))
        _, weights = models(config, (TRAIN,), Path(dataset) if dataset is not None else None)
        stack = trained(config, weights)
        map_of_first = make_lookup(config.lookup, stack, [config.training_layouts[0].map])
        return Agent(stack, map_of_first, config.planner, config.control, config.channels, config.vehicle)


def _change(group: str, values: dict[str, Any], changes: Any) -> dict[str, Any]:
    """The values of a group with some changes, as `Changes` says.

    Raises:
        ConfigError: there is no such file, or the changes are none.
    """
    if changes is None:
        return values
    if isinstance(changes, str):
        return dict(read(group, changes))
    if not isinstance(changes, Mapping | Settings):
        raise ConfigError(
            f"{group} = {format_value(changes)} is not allowed: give some of its keys and values, such as "
            f"{format_value(dict(list(values.items())[:1]))}, its settings, or the name of a file in conf/{group}."
        )
    new = dict(changes)
    same_kind = new.get("kind", values.get("kind")) == values.get("kind")
    return {**values, **new} if same_kind else new


def _given(**values: Any) -> dict[str, Any]:
    """The values that are not None."""
    return {key: value for key, value in values.items() if value is not None}


def _layouts(layouts: AnyLayout | Sequence[AnyLayout] | None, worlds: int, data: Exploration) -> list[Layout]:
    """The layouts that data are collected in; of rules, so many worlds of their own.

    Raises:
        ConfigError: there is no such file, or a value is not allowed.
    """
    if isinstance(worlds, bool) or not isinstance(worlds, int) or worlds < 1:
        raise ConfigError(f"worlds = {format_value(worlds)} is not allowed; give a whole number, 1 or more.")
    every: list[Layout] = []
    for layout in arguments.layouts(layouts if layouts is not None else []):
        if isinstance(layout, Layout):
            every.append(layout)
        else:
            every += [layout.draw(generator(data.seed, "training world", world)) for world in range(worlds)]
    if not every:
        raise ConfigError("train needs layouts to explore, as in affmap.train('original'), or a dataset.")
    return every


def _origin(folder: Path) -> dict[str, Any]:
    """Layouts, vehicle and settings of exploration of a data set.

    Raises:
        ConfigError: there is no data set.
        StoreError: a file of it is corrupted.
    """
    record = read_record(folder) if (folder / PROVENANCE).is_file() else {}
    if record.get("stage") != DATA.name:
        raise ConfigError(
            f"dataset = {format_value(str(folder))} is no data set; give the folder data/<digest> of a store, such as "
            "runs/store."
        )
    return dict(record["config"])


def _config(values: Mapping[str, Any], store: Path) -> Config:
    """The configuration of a job that trains the models of a call.

    Raises:
        ConfigError: a value is not allowed.
    """
    try:
        check_folder(store)
    except ValueError as error:
        raise ConfigError(f"folder = {format_value(str(store))} is not allowed: it {error}.") from None
    if store.exists() and not store.is_dir():
        raise ConfigError(f"folder = {format_value(str(store))} is a file; give another folder.")
    if lies_in(store, reference()):
        raise ConfigError(f"folder = {format_value(str(store))} is of the reference run; give a folder of your own.")
    # The stages of other commands lie elsewhere; none of these folders is made.
    places = {key: store.with_name(f"{store.name}-{key}") for key in ("output", "reference")}
    first = values["training_layouts"][0]
    layouts = {"control_layout": first, "map_layout": first}
    config = Config.checked({**values, **places, **layouts, "store": store}, "train")
    check_trials(config)
    memory.check(config, "train")
    return config
