"""From a command line to the jobs it stands for, without running them: composing and expanding, as Hydra does.

An experiment names its sweep under `sweep`; a key that the command line sets is not swept over. Knows configuration
only.
"""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from hydra.core.override_parser.types import Override, RangeSweep
from pydantic import TypeAdapter

from affmap.config.compose import compose, hydra_errors, parse, values
from affmap.config.jobs import Checker, expand
from affmap.config.root import Config
from affmap.control.registry import is_learned
from affmap.settings import ConfigError
from affmap.settings.messages import one_line
from affmap.store.files import write_json

MAX_JOBS = 20_000
"""Jobs of a command line; more are taken for a mistake. All are checked before the first one starts."""

NOTE = "jobs/sweep.json"
"""File of an output folder that says what was last run into it."""

BASELINE_KEYS = ("control_layout", "world", "seed", "members")
"""Keys that baselines are swept over, too: where they fly, and who."""


class Sweep(NamedTuple):
    """A command line whose sweep is written out, and the jobs that it stands for."""

    overrides: list[str]
    configs: list[Config]
    swept: list[dict[str, str]]
    """Key -> value of what is swept over in each job, in the words of the command line."""

    @classmethod
    def read(cls, arguments: Sequence[str]) -> "Sweep":
        """The sweep of a command line.

        Raises:
            ConfigError: a value that is not allowed; the message names the key, its file, the value and what is right.
        """
        overrides = complete(arguments)
        configs = jobs(overrides)
        return cls(overrides, configs, swept(overrides))

    @property
    def labels(self) -> list[str]:
        """What tells each job from the others, in the words of the command line."""
        lines = [" ".join(f"{key}={value}" for key, value in values.items()) for values in self.swept]
        return [line or "the only setting" for line in lines]

    @property
    def first(self) -> Config:
        """What all jobs agree on, as far as reports are concerned."""
        return self.configs[0]

    def companions(self) -> "list[Sweep]":
        """The sweeps that belong to this one: of its growing maps, and of its baselines, where there are any."""
        return [each for each in (self.growth(), self.baselines()) if each]

    def baselines(self) -> "Sweep | None":
        """Flights of agents without a learned model: the same members and worlds, else the first job's values.

        They plan as the first job does, but where that follows gradients, which the true physics does not have.
        """
        first = self.first
        if not first.baselines or first.report.compare:
            return None
        fixed = {key: value for key, value in self.swept[0].items() if key not in BASELINE_KEYS}
        dropped = {*fixed, "agent", "baselines", "growth", "name", "output"}
        if first.planner.kind == "gradient":
            own = {key for key in _keys(self.overrides) if key.partition(".")[0] == "planner"}
            dropped |= own
            fixed = {key: value for key, value in fixed.items() if key not in own} | {"planner": "cem"}
        kept = [str(each.input_line) for each in parse(self.overrides) if each.key_or_group not in dropped]
        fixed.pop("agent", None)
        own_names = {"name": f"{first.name}/baselines", "output": str(first.output / "baselines")}
        fixed |= {"growth": "null", "baselines": "[]", **own_names}
        lines = [f"{key}={value}" for key, value in fixed.items()]
        baselines = Sweep.read([*kept, *lines, f"agent={','.join(first.baselines)}"])
        if learned := [config.agent.kind for config in baselines.configs if is_learned(config.agent)]:
            raise ConfigError(
                f"baselines = {list(first.baselines)} has {learned[0]!r}, which imagines with a trained model; sweep "
                "over it instead, as in agent=planner,true_mean."
            )
        return baselines

    def growth(self) -> "Sweep | None":
        """The experiment whose growing maps belong to this one, if there is one."""
        first = self.first
        if not first.growth:
            return None
        # A folder given for the output is for this experiment's report.
        dropped = {*first.sweep, "output", "growth", "baselines"}
        growth = Sweep.read(instead(self.overrides, first.growth, dropped))
        if growth.first.growth:
            raise ConfigError(
                f"growth = {first.growth!r} names an experiment that has a growth of its own; it must not."
            )
        return growth


def note(output: Path, overrides: Sequence[str]) -> None:
    """Note in an output folder what is run into it, for `noted`."""
    path = output / NOTE
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"overrides": [*overrides]})


def noted(output: Path) -> list[str]:
    """The overrides of what was last run into a folder.

    Raises:
        ConfigError: nothing is known of it.
    """
    path = output / NOTE
    try:
        return TypeAdapter(list[str]).validate_python(json.loads(path.read_text("utf-8"))["overrides"])
    except (OSError, ValueError, KeyError, TypeError):
        raise ConfigError(
            f"{path} does not say what was run; give the overrides of the sweep instead, such as experiment=exp1."
        ) from None


def complete(overrides: Sequence[str]) -> list[str]:
    """The command line with the experiment's sweep written out, in the experiment's order.

    Raises:
        ConfigError: several experiments at once, or a line that cannot be read.
    """
    parsed = {override.key_or_group: override for override in parse(overrides)}
    experiment = parsed.get("experiment")
    if experiment and (experiment.is_sweep_override() or isinstance(experiment.value(), list)):
        raise ConfigError("experiment takes one name at a time; run several experiments one after the other.")
    single = [str(override.input_line) for override in parsed.values() if not override.is_sweep_override()]
    written = values(compose(single)).get("sweep")
    # What is no sweep is told when the jobs are checked.
    entries = written.items() if isinstance(written, Mapping) else []
    sweep = {key: values for key, values in entries if isinstance(values, (str, int))}
    given = {key: str(override.input_line) for key, override in parsed.items()}
    # In the experiment's order, so that jobs that share a model are not started at the same time.
    swept = [given.get(key, f"{key}={values}") for key, values in sweep.items()]
    return [line for key, line in given.items() if key not in sweep] + swept


def instead(overrides: Sequence[str], experiment: str, dropped: Collection[str]) -> list[str]:
    """The same command line for another experiment, without the keys in `dropped`."""
    kept = [each for each in parse(overrides) if each.key_or_group not in {"experiment", *dropped}]
    return [*(str(override.input_line) for override in kept), f"experiment={experiment}"]


def _keys(overrides: Sequence[str]) -> list[str]:
    """The keys and groups of a command line."""
    return [override.key_or_group for override in parse(overrides)]


def is_sweep(overrides: Sequence[str]) -> bool:
    """Whether a command line asks for a sweep, though it may be one of a single job."""
    return any(override.is_sweep_override() for override in parse(overrides))


def jobs(overrides: Sequence[str]) -> list[Config]:
    """The configuration of each job of a command line whose sweep is written out.

    Raises:
        ConfigError: a value that is not allowed; the message names the key, its file, the value and what is right. Or
            no jobs, or so many that they are a mistake.
    """
    parsed = parse(overrides)
    with hydra_errors():
        counts = {override.key_or_group: _count(override) for override in parsed if override.is_sweep_override()}
    number = math.prod(counts.values())
    if not 0 < number <= MAX_JOBS:
        values = " x ".join(f"{count} of {key}" for key, count in counts.items())
        raise ConfigError(f"the sweep has {number} jobs ({one_line(values)}); it should have 1 to {MAX_JOBS}.")
    checker = Checker()
    return [checker.check(job) for job in expand(parsed)]


def swept(overrides: Sequence[str]) -> list[dict[str, str]]:
    """Key -> value of what is swept over, for each job of a command line."""
    parsed = parse(overrides)
    keys = {override.key_or_group for override in parsed if override.is_sweep_override()}
    lines = [[each.line.lstrip("+").partition("=") for each in job] for job in expand(parsed)]
    return [{key: value for key, _, value in job if key in keys} for job in lines]


def _count(override: Override) -> int:
    """How many values a sweep over one key has, without writing out a range."""
    values = override.value()
    if isinstance(values, RangeSweep):
        assert values.start is not None and values.stop is not None
        return max(0, math.ceil((values.stop - values.start) / values.step))
    return sum(1 for _ in override.sweep_iterator())
