"""From a command line to a search: its space, its objective and its folder. Runs nothing.

Hydra's sweeper on hyperopt (`hydra/sweeper=hyperopt`) runs it, or another one of Hydra's, such as Optuna's. A search
takes an experiment's configuration, but not its sweep.
"""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from hydra.errors import HydraException

from affmap.config.compose import check, compose, values
from affmap.config.overrides import overrides_parser, parse, without_sweeps
from affmap.config.root import Config
from affmap.results.provenance import leaves
from affmap.settings import ConfigError, Settings
from hydra_plugins.hyperopt_sweeper import TRIALS, read_trials, trials_table
from hydra_plugins.hyperopt_sweeper.hyperopt_sweeper import stored_trials

AFTER_TRAINING = ("agent", "planner", "control", "lookup", "control_layout", "map_layout", "report")
"""Groups that training does not depend on."""

IRRELEVANT = (
    *("threads", "compiled", "versions", "logger", "store", "reference", "output", "title", "notice"),
    *(
        f"{group}.{key}"
        for group, field in Config.model_fields.items()
        if isinstance(field.annotation, type) and issubclass(field.annotation, Settings)
        for key, each in field.annotation.model_fields.items()
        if each.exclude
    ),
)
"""Keys that change no result of a trial, or its rounding only, such as those that the digests leave out."""


class OtherSearch(NamedTuple):
    """A search by another sweeper of Hydra's, which reads its space, and keeps its trials, in its own way."""

    sweeper: str
    """Option of `hydra/sweeper`."""
    overrides: list[str]
    config: Config
    """Configuration of the trials, but for the searched keys."""
    folder: Path
    """Folder of the trials' logs and of the sweeper's result."""

    @classmethod
    def read(cls, arguments: Sequence[str]) -> "OtherSearch | None":
        """The search of a command line; None where it asks for no other sweeper.

        Raises:
            ConfigError: it is invalid; the message says why.
        """
        overrides = parse(arguments)
        fixed = without_sweeps(arguments)
        composed = compose(fixed)
        sweeper = composed.hydra.runtime.choices["hydra/sweeper"]
        if sweeper in ("basic", "hyperopt"):
            return None
        lines = [str(each.input_line) for each in overrides]
        return cls(sweeper, lines, _check(fixed), Path(composed.hydra.sweep.dir))


class Search(NamedTuple):
    """A search by the sweeper on hyperopt, as a command line describes it."""

    fixed: list[str]
    """Overrides of all trials, and Hydra's own."""
    searched: list[str]
    """Overrides with a space."""
    config: Config
    """Configuration of the trials, but for the searched keys."""
    folder: Path
    """Folder in which the sweeper keeps the trials."""
    num_trials: int
    log_keys: frozenset[str]
    """Keys searched on a logarithmic scale."""

    @classmethod
    def read(cls, arguments: Sequence[str]) -> "Search | None":
        """The search of a command line; None where it asks for none.

        Raises:
            ConfigError: it is invalid, or another sweeper's; the message says why.
        """
        if other := OtherSearch.read(arguments):
            raise ConfigError(
                f"hydra/sweeper = {other.sweeper!r} keeps its trials in its own way, which only affmap itself can run; "
                "hydra/sweeper=hyperopt has progress and reports."
            )
        overrides = parse(arguments)
        fixed = without_sweeps(arguments)
        composed = compose(fixed)
        if composed.hydra.runtime.choices["hydra/sweeper"] == "basic":
            return None
        config = _check(fixed)
        settings = composed.hydra.sweeper
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
        return cls(fixed, [*searched.values()], config, folder, settings.num_trials, log_keys)

    @property
    def overrides(self) -> list[str]:
        """All overrides."""
        return [*self.fixed, *self.searched]

    @property
    def trials(self) -> str:
        """The sweeper's table of the trials that are complete, as CSV.

        Raises:
            SearchError: their file is corrupted or belongs to another search.
        """
        return trials_table(self._complete)

    @property
    def num_complete(self) -> int:
        """Number of trials that are complete.

        Raises:
            SearchError: their file is corrupted or belongs to another search.
        """
        return len(self._complete)

    @property
    def _complete(self) -> list[Any]:
        sweeper = compose(self.fixed).hydra.sweeper
        fixed = [str(each.input_line) for each in parse(self.fixed) if not each.is_hydra_override()]
        arguments = [*self._as_stored(fixed), *self.searched]
        return stored_trials(self.folder, sweeper, IRRELEVANT, overrides_parser(), arguments)

    def _as_stored(self, fixed: list[str]) -> list[str]:
        """Fixed overrides in the words of the stored trials, where those mean the same, as with a default spelled out.

        Raises:
            SearchError: the file of the trials is corrupted.
        """
        path = self.folder / TRIALS
        if path.exists():
            stored = read_trials(path)[0].get("fixed", fixed)
            with suppress(ConfigError, HydraException):  # overrides for other files of conf
                if _relevant(stored) == _relevant(fixed):
                    return [*stored]
        return fixed


def _check(fixed: Sequence[str]) -> Config:
    """The configuration of a search's trials, but for the searched keys.

    Raises:
        ConfigError: a value is not allowed, or there is no objective.
    """
    config = check(fixed)
    if config.objective is None:
        raise ConfigError("a search needs an objective; say objective=validation_nll, mean_distance or success.")
    return config


def _relevant(overrides: Sequence[str]) -> dict[str, Any]:
    """Key -> value, of a configuration without irrelevant keys."""
    return {key: value for key, value in leaves(values(compose(overrides))).items() if key not in IRRELEVANT}
