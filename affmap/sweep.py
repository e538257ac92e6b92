"""From a command line to the jobs it stands for, without running them: composing and expanding, as Hydra does.

An experiment names its sweep under `sweep`; a key that the command line sets is not swept over. Knows configuration
only.
"""

import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hydra import compose, initialize_config_dir
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override

from affmap.config import Config, plain
from affmap.files import write_json
from affmap.settings import ConfigError, folder

NOTE = "jobs/sweep.json"
"""File of an output folder that says what was last run into it."""


class Sweep(NamedTuple):
    """A command line whose sweep is written out, and the jobs that it stands for."""

    overrides: list[str]
    configs: list[Config]
    labels: list[str]
    """What tells a job from the others, in the words of the command line."""

    @classmethod
    def read(cls, arguments: Sequence[str]) -> "Sweep":
        """The sweep of a command line.

        Raises:
            ConfigError: a value that is not allowed; the message names the key, its file, the value and what is right.
        """
        overrides = complete(arguments)
        return cls(overrides, jobs(overrides), labels(overrides))

    @classmethod
    def noted(cls, output: Path) -> "Sweep":
        """The sweep that was last run into a folder.

        Raises:
            ConfigError: none is known; or see `read`.
        """
        path = output / NOTE
        try:
            overrides = json.loads(path.read_text("utf-8"))["overrides"]
        except (OSError, ValueError, KeyError, TypeError):
            raise ConfigError(f"{path} does not say what was run; give the overrides of the sweep instead.") from None
        return cls.read(overrides)

    def note(self) -> None:
        """Note in the output's folder what is run, for `noted`."""
        path = self.first.output / NOTE
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, {"overrides": self.overrides})

    @property
    def first(self) -> Config:
        """What all jobs agree on, as far as reports are concerned."""
        return self.configs[0]

    def growth(self) -> "Sweep | None":
        """The experiment whose growing maps belong to this one, if there is one."""
        if not self.first.growth:
            return None
        # A folder given for the output is for this experiment's report.
        return Sweep.read(instead(self.overrides, self.first.growth, {*self.first.sweep, "output"}))


def complete(overrides: Sequence[str]) -> list[str]:
    """The command line with the experiment's sweep written out, in the experiment's order.

    Raises:
        ConfigError: several experiments at once.
    """
    parsed = {override.key_or_group: override for override in _parse(overrides)}
    if "experiment" in parsed and parsed["experiment"].is_sweep_override():
        raise ConfigError("experiment takes one name at a time; run several experiments one after the other.")
    single = [str(override.input_line) for override in parsed.values() if not override.is_sweep_override()]
    sweep = plain(_compose(single)).get("sweep", {})
    given = {key: str(override.input_line) for key, override in parsed.items()}
    # In the experiment's order, so that jobs that share a model are not started at the same time.
    swept = [given.get(key, f"{key}={values}") for key, values in sweep.items()]
    return [line for key, line in given.items() if key not in sweep] + swept


def instead(overrides: Sequence[str], experiment: str, dropped: Collection[str]) -> list[str]:
    """The same command line for another experiment, without the keys in `dropped`."""
    kept = [each for each in _parse(overrides) if each.key_or_group not in {"experiment", *dropped}]
    return [*(str(override.input_line) for override in kept), f"experiment={experiment}"]


def is_sweep(overrides: Sequence[str]) -> bool:
    """Whether a command line asks for a sweep, though it may be one of a single job."""
    return any(override.is_sweep_override() for override in _parse(overrides))


def jobs(overrides: Sequence[str]) -> list[Config]:
    """The configuration of each job of a command line whose sweep is written out.

    Raises:
        ConfigError: a value that is not allowed; the message names the key, its file, the value and what is right.
    """
    return [_check(job) for job in _split(overrides)]


def labels(overrides: Sequence[str]) -> list[str]:
    """The values swept over in each job of a command line; its experiment where nothing is swept over."""
    swept = {override.key_or_group for override in _parse(overrides) if override.is_sweep_override()}
    chosen = [[each for each in job if each.partition("=")[0].lstrip("+") in swept] for job in _split(overrides)]
    return [" ".join(each) or "the only setting" for each in chosen]


def _split(overrides: Sequence[str]) -> list[list[str]]:
    """The overrides of each job."""
    jobs: list[list[str]] = BasicSweeper.split_arguments(_parse(overrides), max_batch_size=None)[0]
    return jobs


def _check(overrides: Sequence[str]) -> Config:
    composed = _compose(overrides)
    choices = composed.hydra.runtime.choices
    origins = {group: f"conf/{group}/{choice}.yaml or the command line" for group, choice in choices.items()}
    origins[""] = f"conf/layout with {origins['vehicle']}"  # checked together
    return Config.checked(plain(composed), "conf/config.yaml or the command line", origins)


def _parse(overrides: Sequence[str]) -> list[Override]:
    with initialize_config_dir(str(folder()), version_base="1.3"):
        # The loader knows the groups that `glob(...)` chooses from.
        return OverridesParser.create(GlobalHydra.instance().config_loader()).parse_overrides([*overrides])


def _compose(overrides: Sequence[str]) -> Any:
    with initialize_config_dir(str(folder()), version_base="1.3"):
        return compose("config", [*overrides], return_hydra_config=True)
