"""From a command line to a search: what is tried, what for, and where its trials are. Runs nothing.

Hydra's sweeper on hyperopt (`hydra/sweeper=hyperopt`) makes it; an experiment gives a search its configuration, and not
its sweep.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from affmap.config.compose import check, compose, parse
from affmap.config.root import Config
from affmap.settings import ConfigError
from hydra_plugins.hyperopt_sweeper import TRIALS, read_trials

AFTER_TRAINING = ("agent", "planner", "control", "lookup", "control_layout", "map_layout", "report")
"""Groups that a training does not depend on."""


class Search(NamedTuple):
    """A command line that asks for a search."""

    overrides: list[str]
    config: Config
    """Of a trial, but for what is searched."""
    folder: Path
    """Where the sweeper keeps the trials."""
    num_trials: int
    log_keys: frozenset[str]
    """Of what is searched, that on a logarithmic scale."""

    @classmethod
    def read(cls, arguments: Sequence[str]) -> "Search | None":
        """The search of a command line; None where it asks for none.

        Raises:
            ConfigError: it cannot be made; the message says why.
        """
        overrides = parse(arguments)
        fixed = [str(each.input_line) for each in overrides if not each.is_sweep_override()]
        composed = compose(fixed)
        if composed.hydra.runtime.choices["hydra/sweeper"] != "hyperopt":
            return None
        config = check(fixed)
        settings = composed.hydra.sweeper
        if config.objective is None:
            raise ConfigError("a search needs an objective; say objective=validation_nll, mean_distance or success.")
        direction = "maximize" if config.objective == "success" else "minimize"
        if settings.direction.value != direction:
            raise ConfigError(f"objective={config.objective} needs hydra.sweeper.direction={direction}.")
        searched = {each.key_or_group: str(each.input_line) for each in overrides if each.is_sweep_override()}
        spaces = {**settings.params, **searched}
        groups = {key.partition(".")[0] for key in spaces}
        if config.objective == "validation_nll" and groups and groups <= {*AFTER_TRAINING}:
            raise ConfigError(
                f"objective=validation_nll does not depend on {', '.join(spaces)}; search over something "
                "of the training, or say objective=mean_distance or success."
            )
        log_keys = frozenset(key for key, space in spaces.items() if "log" in space.partition("interval")[0])
        folder = Path(composed.hydra.sweep.dir)
        return cls([*fixed, *searched.values()], config, folder, settings.num_trials, log_keys)

    @property
    def num_complete(self) -> int:
        """How many trials have been made.

        Raises:
            SearchError: their file is damaged.
        """
        path = self.folder / TRIALS
        return len(read_trials(path)[1]) if path.is_file() else 0
