"""From a command line to its jobs, composed and expanded as Hydra does. Runs nothing, knows configuration only.

An experiment names its sweep under `sweep`; a key that the command line sets is not swept over.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from hydra.core.override_parser.types import Override, RangeSweep

from affmap.config.compose import compose, values
from affmap.config.explain import groups, hydra_errors
from affmap.config.jobs import Checker, expand
from affmap.config.overrides import keys, parse, replace_experiment, without_sweeps
from affmap.config.root import Config
from affmap.control.registry import is_learned
from affmap.settings import ConfigError
from affmap.settings.messages import one_line

MAX_JOBS = 20_000
"""Most jobs of a command line; more must be a mistake. All are validated before the first one starts."""

MAX_COMPOSED = 1000
"""Most combinations of files and of texts with special characters, each of which takes Hydra a tenth of a second."""

BASELINE_KEYS = ("control_layout", "world", "variation", "seed", "members")
"""Keys that baselines are swept over, too: layouts, their variations, and members."""


class Sweep(NamedTuple):
    """A command line whose sweep is written out, and its jobs."""

    overrides: list[str]
    configs: list[Config]
    values: list[dict[str, str]]
    """For each job: swept key -> its value, as on the command line."""

    @classmethod
    def read(cls, arguments: Sequence[str]) -> "Sweep":
        """The sweep of a command line.

        Raises:
            ConfigError: a value is not allowed; the message names key, file, value and remedy.
        """
        overrides = complete(arguments)
        return cls(overrides, jobs(overrides), swept_values(overrides))

    @property
    def labels(self) -> list[str]:
        """A label of each job: its swept keys, as on the command line."""
        lines = [" ".join(f"{key}={value}" for key, value in values.items()) for values in self.values]
        return [line or "the only setting" for line in lines]

    @property
    def first(self) -> Config:
        """The first job; all share the settings of reports."""
        return self.configs[0]

    def companions(self) -> "list[Sweep]":
        """The sweeps that belong to this one: growth and baselines, where it has them."""
        return [each for each in (self.growth(), self.baselines()) if each]

    def baselines(self) -> "Sweep | None":
        """The sweep over agents without a learned model: the same members and layouts, else the first job's values.

        They plan as the first job does, or by CEM where that follows gradients, which the true physics does not have.
        """
        first = self.first
        if not first.baselines or first.report.compare:
            return None
        fixed = {key: value for key, value in self.values[0].items() if key not in BASELINE_KEYS}
        dropped = {*fixed, "agent", "baselines", "growth", "name", "output"}
        if first.planner.kind == "gradient":
            planner_keys = {key for key in keys(self.overrides) if key.partition(".")[0] == "planner"}
            dropped |= planner_keys
            fixed = {key: value for key, value in fixed.items() if key not in planner_keys} | {"planner": "cem"}
        rest = [str(each.input_line) for each in parse(self.overrides) if each.key_or_group not in dropped]
        fixed.pop("agent", None)
        own_names = {"name": f"{first.name}/baselines", "output": str(first.output / "baselines")}
        fixed |= {"growth": "null", "baselines": "[]", **own_names}
        lines = [f"{key}={value}" for key, value in fixed.items()]
        baselines = Sweep.read([*rest, *lines, f"agent={','.join(first.baselines)}"])
        if kinds := [config.agent.kind for config in baselines.configs if is_learned(config.agent)]:
            raise ConfigError(
                f"baselines = {list(first.baselines)} has {kinds[0]!r}, which imagines with a trained model; sweep "
                "over it instead, as in agent=planner,true_mean."
            )
        return baselines

    def growth(self) -> "Sweep | None":
        """The experiment whose maps after several epochs belong to this one's report, if there is one."""
        first = self.first
        if not first.growth:
            return None
        # An output folder on the command line is that of this experiment's report.
        dropped = {*first.sweep, "output", "growth", "baselines"}
        growth = Sweep.read(replace_experiment(self.overrides, first.growth, dropped))
        if growth.first.growth:
            raise ConfigError(
                f"growth = {first.growth!r} names an experiment that has a growth of its own; it must not."
            )
        return growth


def complete(overrides: Sequence[str]) -> list[str]:
    """The command line with the experiment's sweep written out, in the experiment's order.

    Raises:
        ConfigError: there are several experiments, a group has a list of files, or an override is malformed.
    """
    parsed = {override.key_or_group: override for override in parse(overrides)}
    experiment = parsed.get("experiment")
    if experiment and (experiment.is_sweep_override() or isinstance(experiment.value(), list)):
        raise ConfigError("experiment takes one name at a time; run several experiments one after the other.")
    known = groups()
    for key, override in parsed.items():
        files = override.value() if key in known else None
        if isinstance(files, list) and len(files) > 1:  # Hydra would lay one file over the other
            line = one_line(f"{key}={','.join(map(str, files))}")
            raise ConfigError(f"{key} takes one file, and no list; write {line} for a job of each.")
    lines = {key: str(override.input_line) for key, override in parsed.items()}
    sweep = values(compose(without_sweeps(lines.values()))).get("sweep")
    # Malformed sweeps are reported when the jobs are validated.
    entries = sweep.items() if isinstance(sweep, Mapping) else []
    choices = {key: values for key, values in entries if isinstance(values, (str, int))}
    # In the experiment's order, so that jobs that share a model do not start at the same time.
    sweep_lines = [lines.get(key, f"{key}={values}") for key, values in choices.items()]
    return [line for key, line in lines.items() if key not in choices] + sweep_lines


def jobs(overrides: Sequence[str]) -> list[Config]:
    """The configuration of each job of a command line whose sweep is written out.

    Raises:
        ConfigError: a value is not allowed (the message names key, file, value and remedy) or given twice, or there are
            no jobs or more than `MAX_JOBS` or `MAX_COMPOSED`.
    """
    parsed = parse(overrides)
    swept = {override.key_or_group: override for override in parsed if override.is_sweep_override()}
    with hydra_errors():
        counts = {key: _count(override) for key, override in swept.items()}
    number = math.prod(counts.values())
    if not 0 < number <= MAX_JOBS:
        values = " x ".join(f"{count} of {key}" for key, count in counts.items())
        raise ConfigError(f"the sweep has {number} jobs ({one_line(values)}); it should have 1 to {MAX_JOBS}.")
    for override in swept.values():
        if twice := [text for text, count in Counter(override.sweep_string_iterator()).items() if count > 1]:
            raise ConfigError(f"{override.input_line} gives {twice[0]} twice; give each value once.")
    assigned = expand(parsed)
    composed = {tuple(each.line for each in job if not each.is_plain) for job in assigned}
    if len(composed) > MAX_COMPOSED:
        raise ConfigError(
            f"the sweep has {len(composed)} combinations of files and of texts with special characters; it should have "
            f"at most {MAX_COMPOSED}."
        )
    checker = Checker()
    return [checker.check(job) for job in assigned]


def swept_values(overrides: Sequence[str]) -> list[dict[str, str]]:
    """For each job of a command line: swept key -> its value."""
    parsed = parse(overrides)
    keys = {override.key_or_group for override in parsed if override.is_sweep_override()}
    lines = [[each.line.lstrip("+").partition("=") for each in job] for job in expand(parsed)]
    return [{key: value for key, _, value in job if key in keys} for job in lines]


def _count(override: Override) -> int:
    """Number of values of a sweep over one key, without writing out a range."""
    values = override.value()
    if isinstance(values, RangeSweep):
        assert values.start is not None and values.stop is not None
        return max(0, math.ceil((values.stop - values.start) / values.step))
    return sum(1 for _ in override.sweep_iterator())
