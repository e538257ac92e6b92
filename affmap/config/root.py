"""The whole configuration and its types: one job of a sweep."""

import os.path
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationInfo, field_validator, model_validator

from affmap.compiled import installed
from affmap.control.registry import PLANNER, AnyAgent, OracleSettings
from affmap.control.settings import ControlSettings
from affmap.control.variation import Task, Variation
from affmap.data.settings import Exploration
from affmap.env import procedural
from affmap.env.body import Vehicle
from affmap.env.effects import check_compiled
from affmap.env.layout import Acts, Layout
from affmap.env.procedural import Procedural, is_procedural
from affmap.env.rules import Rules
from affmap.env.walls import Walls
from affmap.learning.settings import OFFLINE, AnyLearning, AnyPlanningLearning, OfflineLearning
from affmap.model.registry import EffectsSettings, unit_ends
from affmap.model.settings import NO_MEMORY, AnyMemory, LookupSettings, MemorySettings, ModelSettings
from affmap.planning.registry import AnyPlanner
from affmap.random import generator
from affmap.results.setting import ReportSettings
from affmap.rivals.settings import NONE, PPO, ROLLOUT, AnyRival, Rival
from affmap.settings import Count, Folder, Line, Name, NamePath, Neutral, Positive, Seed, Settings, lies_in, names
from affmap.settings.messages import format_value
from affmap.training.settings import TrainingSettings


def _layout(name: Any) -> Any:
    """The layout of `conf/layout/<name>.yaml`; whatever is no name is left to the next check."""
    if isinstance(name, str) and is_procedural(name):
        raise ValueError("is procedural, which only control_layout may be; name a fixed layout")
    return Layout.load("layout", name) if isinstance(name, str) else name


def _any_layout(name: Any) -> Any:
    """The fixed or procedural layout of `conf/layout/<name>.yaml`."""
    if isinstance(name, str) and is_procedural(name):
        return procedural.load(name)
    return _layout(name)


def _kind(layout: Any) -> str:
    if isinstance(layout, Mapping):
        return procedural.kind(layout).__name__
    return type(layout).__name__ if isinstance(layout, Rules) else Layout.__name__


def _choices(values: Any) -> Any:
    return str(values) if type(values) is int else values  # a sweep over a single number


NamedLayout = Annotated[Layout, BeforeValidator(_layout)]
AnyLayout = Annotated[
    Annotated[Layout, Tag("Layout")] | Annotated[Procedural, Tag("Procedural")] | Annotated[Walls, Tag("Walls")],
    Discriminator(_kind),
    BeforeValidator(_any_layout),
]
Choices = Annotated[Line, BeforeValidator(_choices)]


class Config(Settings):
    """`conf/config.yaml` and its groups; one job of a sweep."""

    name: NamePath
    """Name of the experiment, that of its file in `conf/experiment`."""
    title: Line
    """Heading of the report."""
    seed: Seed
    """Seed of the first member; member m has seed + m."""
    members: Count
    """M, members of the stack."""
    threads: Annotated[Count, Field(le=1024)]
    """Threads of a job."""
    compiled: bool
    """Whether inner loops are compiled by numba; otherwise PyTorch runs them, more slowly."""
    models: Literal["train", "reference"]
    """Train the models, or take those of the reference run."""
    notice: Line | None
    """A notice on every figure, such as that of a smoke run; None for results."""
    output: Folder
    """Folder of the report."""
    store: Folder
    """Folder of the stages."""
    reference: Folder
    """Folder of the reference run's stages."""
    versions: Literal["same", "any"]
    """Whether stages made with other versions of packages may be used."""
    logger: Literal["csv", "tensorboard", "wandb", "mlflow", "trackio"]
    """Program that shows the losses of running trainings; csv for none, their tables are always written."""
    sweep: Mapping[Line, Choices]
    """The experiment's sweep: key -> values, as Hydra's sweeper takes them."""
    objective: Literal["validation_nll", "mean_distance", "success"] | None
    """The objective of a search; None where nothing is searched."""
    baselines: tuple[Name, ...]
    """Agents (files of `conf/agent`) that fly the same runs for comparison; they need no model."""
    growth: NamePath | None
    """Another experiment, of one job, whose maps after several epochs the report shows; or None."""
    acts: Acts | None
    """Rule of every layout for when fog and force fields act; None for each layout's own."""
    world: Name
    """Layout (a file of `conf/layout`) wherever no other is named."""
    training_layouts: tuple[NamedLayout, ...]
    """Layouts that data are collected in, in equal parts."""
    control_layout: AnyLayout
    """Layout that agents fly in; a procedural one gives each run a layout of its own."""
    map_layout: NamedLayout
    """Layout of the affordance maps in the report."""
    variation: Annotated[Variation | None, BeforeValidator(Variation.read), Neutral(None)]
    """What is other in control than in training: a factor and its value, such as `mass/0.2`; None for nothing."""
    vehicle: Vehicle
    data: Exploration
    model: ModelSettings
    training: TrainingSettings
    learning: Annotated[AnyLearning, Neutral(OFFLINE)]
    lookup: LookupSettings
    memory: Annotated[AnyMemory, Neutral(NO_MEMORY)]
    """A memorised map, in which codes are looked up instead of in views."""
    planner: AnyPlanner
    agent: Annotated[AnyAgent, Neutral(PLANNER)]
    rival: Annotated[AnyRival, Neutral(NONE)]
    """A policy that flies instead of the agent."""
    rival_share: Annotated[Positive, Neutral(1.0), Field(le=1)]
    """Share of a rival's updates, flights or steps of training; less for toy runs."""
    control: ControlSettings
    report: ReportSettings

    @field_validator("training_layouts", "control_layout", "map_layout")
    @classmethod
    def _set_acts(cls, value: Any, info: ValidationInfo) -> Any:
        if (acts := info.data.get("acts")) is None:
            return value
        if isinstance(value, tuple):
            return tuple(layout.model_copy(update={"acts": acts}) for layout in value)
        return value.model_copy(update={"acts": acts})

    @model_validator(mode="after")
    def _check_training_layouts(self) -> Self:
        if not self.training_layouts:
            raise ValueError("training_layouts = [] names no layout; data must come from somewhere.")
        return self

    @property
    def published(self) -> Path:
        """The folder that `affmap-publish` copies the report to, at the same place beside the reference run's store."""
        runs, output = (Path(os.path.normpath(path)) for path in (self.store.parent, self.output))
        return self.reference.parent / (output.relative_to(runs) if output.is_relative_to(runs) else output.name)

    @model_validator(mode="after")
    def _check_baselines(self) -> Self:
        if twice := [name for name, count in Counter(self.baselines).items() if count > 1]:
            raise ValueError(f"baselines = {list(self.baselines)} has {twice[0]!r} twice; name each agent once.")
        return self

    @model_validator(mode="after")
    def _check_folders(self) -> Self:
        keys = ("output", "store", "reference")
        shown = {key: format_value(str(getattr(self, key))) for key in (*keys, "published")}
        for key, other in permutations(keys, 2):
            if lies_in(getattr(self, key), getattr(self, other)):
                if lies_in(getattr(self, other), getattr(self, key)):
                    two = f"both {shown[key]}" if shown[key] == shown[other] else f"one, {shown[key]} = {shown[other]}"
                    raise ValueError(f"{key} and {other} are {two}; give each a folder of its own.")
                raise ValueError(
                    f"{key} = {shown[key]} lies in {other} = {shown[other]}, and would be copied or removed with it; "
                    "give each a folder of its own, beside the other."
                )
        for key in ("store", "reference"):
            if lies_in(self.published, getattr(self, key)):
                raise ValueError(
                    f"output = {shown['output']} would be published as {shown['published']}, where {key} is; give it "
                    "another name."
                )
        return self

    @model_validator(mode="after")
    def _check_oracle(self) -> Self:
        if isinstance(self.agent, OracleSettings):
            if self.planner.kind == "gradient":
                raise ValueError(
                    f"agent = {self.agent.kind!r} imagines with the true physics, which has no gradients for planner = "
                    "'gradient'; say planner=cem."
                )
            if not installed():
                raise ValueError(
                    f"agent = {self.agent.kind!r} needs numba, which is not installed; leave it out, of "
                    "baselines as well: baselines=[straight,random]."
                )
            check_compiled(self.control_layout.effects)
        return self

    @model_validator(mode="after")
    def _check_layouts(self) -> Self:
        training = [("training_layouts", layout) for layout in self.training_layouts]
        for key, layout in [("control_layout", self.control_layout), ("map_layout", self.map_layout), *training]:
            if layout.channels != self.channels:
                raise ValueError(
                    f"{key} = {layout.name!r} has channels {list(layout.channels)}, but "
                    f"{self.training_layouts[0].name!r}, where data are collected, has {list(self.channels)}; "
                    f"a model sees the same ones everywhere{self._elsewhere(key, layout.name)}."
                )
        for layout in self.training_layouts:
            layout.check_corners(self.vehicle.radius)
        layout = self.control_layout
        if isinstance(layout, Rules):  # rules that cannot be met should not turn up after hours of training
            layout = layout.draw(generator(self.seed, "world", 0))
        layout.check_corners(self.vehicle.radius)
        task = Task(layout, self.vehicle, self.control)
        if self.variation:
            task = self.variation.vary(task, generator(self.seed, "variation", 0))
        if task.settings.goal_distance is not None:
            if self.control.goal_radius >= task.settings.goal_distance:
                raise ValueError(
                    f"control.goal_distance puts goals {task.settings.goal_distance:g} u away, and control.goal_radius "
                    f"= {self.control.goal_radius} would count runs as successes where they start; make it smaller."
                )
        elif self.control.goal_radius >= task.layout.shortest_way:
            raise ValueError(
                f"control.goal_radius = {self.control.goal_radius} would count runs as successes where they start: in "
                f"{layout.name!r} the goal may be {task.layout.shortest_way:.4g} u away; make it smaller."
            )
        return self

    def _elsewhere(self, key: str, name: str) -> str:
        """The end of a sentence on a layout with other channels than those of the data: one that has these."""
        for other in (self.world, *names("layout")) if key != "training_layouts" else ():
            with suppress(ValueError):  # rules for layouts, or a file with a mistake
                if _layout(other).channels == self.channels:
                    return f", so say {'world' if name == self.world else key}={other}"
        return ""

    @model_validator(mode="after")
    def _check_codes(self) -> Self:
        code, size, channels = self.model.code, self.model.context_size, len(self.channels)
        if code.encoder == "channels" and 0 < size < channels:
            raise ValueError(
                f"model.context_size = {size} leaves none of the code for some of {channels} channels, which "
                f"encoder = 'channels' gives units of their own; make it {channels} or more."
            )
        block = code.block_size if isinstance(code, EffectsSettings) else 1
        if code.encoder == "channels" and any(end % block for end in unit_ends(size, channels)[:-1]):
            raise ValueError(
                f"model.context_size = {size} and model.transition.block_size = {block} lay units of several of "
                f"{channels} channels into one block, which encoder = 'channels' keeps apart; say "
                f"model.context_size={channels * block} or model.transition.block_size=1."
            )
        return self

    @model_validator(mode="after")
    def _check_learning(self) -> Self:
        learning, training = self.learning, self.training
        if isinstance(learning, OfflineLearning):
            return self
        if self.members % learning.committee_size(self.members):
            raise ValueError(
                f"members = {self.members} is no multiple of learning.committee = {learning.committee}; every agent "
                "has a committee of its own."
            )
        if self.members == 1 and isinstance(learning, AnyPlanningLearning):
            raise ValueError(
                f"members = 1 is no committee, which learning = {learning.kind!r} needs; say members=2 or more."
            )
        if learning.round_steps % training.chunk_length:
            raise ValueError(
                f"learning.round_steps = {learning.round_steps} is no multiple of training.chunk_length = "
                f"{training.chunk_length}; rounds are cut into chunks."
            )
        if trials := next(iter(training.per_trial), None):
            raise ValueError(f"training.{trials} has several trials, which learn offline only; give a number.")
        for key, value, offline in (
            ("training.accelerator", training.accelerator, "cpu"),
            ("model.transition.paste", self.model.code.paste, 0.0),
            ("logger", self.logger, "csv"),
        ):
            if value != offline:
                raise ValueError(
                    f"{key} = {format_value(value)} is for learning = 'offline' only, and learning = "
                    f"{learning.kind!r}; say {key}={offline}."
                )
        return self

    @model_validator(mode="after")
    def _check_rival(self) -> Self:
        if not isinstance(self.rival, Rival):
            return self
        if self.agent != PLANNER:
            raise ValueError(
                f"rival = {self.rival.kind!r} flies instead of the agent, and agent = {self.agent.kind!r} would; say "
                "agent=planner or rival=none."
            )
        if isinstance(self.rival, PPO) and ROLLOUT % self.rival.num_vehicles:
            raise ValueError(
                f"rival.num_vehicles = {self.rival.num_vehicles} does not share a rollout of {ROLLOUT} steps in equal "
                "parts; make it a power of 2."
            )
        return self

    @model_validator(mode="after")
    def _check_memory(self) -> Self:
        if not isinstance(self.memory, MemorySettings):
            return self
        for key, wrong, remedy in (
            ("agent", self.agent != PLANNER, "agent=planner"),
            ("rival", isinstance(self.rival, Rival), "rival=none"),
            ("lookup.spacing", self.lookup.spacing == 0, "lookup=map"),
            ("model.context_size", self.model.context_size == 0, "model.context_size=8"),
            ("control.guide", self.control.guide != "none", "control.guide=none"),
            ("control.device", self.control.device != "cpu", "control.device=cpu"),
            ("variation", self.variation is not None, "variation=home"),
            ("control_layout", isinstance(self.control_layout, Rules), "control_layout=original"),
            ("control_layout", self._has_doors, "control_layout=original"),
        ):
            if wrong:
                raise ValueError(
                    f"memory = 'network' is for agents that plan with codes in a world that stays as it is, so that "
                    f"{key} cannot be as it is; say {remedy} or memory=none."
                )
        return self

    @property
    def _has_doors(self) -> bool:
        return isinstance(self.control_layout, Layout) and "door" in self.control_layout.effects

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the K channels of a view."""
        return self.training_layouts[0].channels

    @property
    def controller(self) -> str:
        """The kind of the planner, or of an agent that has none, or the name of a rival, as in tables."""
        if isinstance(self.rival, Rival):
            return self.rival.name
        return self.planner.kind if self.agent == PLANNER else self.agent.kind

    @property
    def seeds(self) -> range:
        """The members' seeds, M of them."""
        return range(self.seed, self.seed + self.members)

    @property
    def pilots(self) -> range:
        """Seeds of the members that fly: all, or the first ones, where a rival has fewer."""
        return self.seeds[: self.rival.members] if isinstance(self.rival, Rival) else self.seeds


def label(config: Config) -> str:
    """A short description of a job, for logs."""
    varied = f", {config.variation}" if config.variation else ""
    codes = config.memory.name if isinstance(config.memory, MemorySettings) else config.lookup.name
    return f"{config.control_layout.name}{varied}, {config.model.name}, {config.controller}, {codes}"


def plain(config: Any) -> dict[str, Any]:
    """The values of a composed Hydra configuration, without Hydra's own."""
    from omegaconf import OmegaConf

    own = {str(key): value for key, value in config.items() if key != "hydra"}
    return {
        key: OmegaConf.to_container(value, resolve=True, throw_on_missing=True) if OmegaConf.is_config(value) else value
        for key, value in own.items()
    }
