"""The sweeper: batches of trials through Hydra's launcher, with a checkpoint after each.

Hydra imports this whenever an application starts, so hyperopt is imported only when a search begins.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.object_type import ObjectType
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf

from hydra_plugins.hyperopt_sweeper._outcomes import FinalError, failure, outcomes
from hydra_plugins.hyperopt_sweeper._space import Point, SearchError, Space, TrialError, parse
from hydra_plugins.hyperopt_sweeper._trials import TRIALS, Trial, load, save, write_results

log = logging.getLogger(__name__)


class Direction(Enum):
    """Direction of better results."""

    minimize = "minimize"
    maximize = "maximize"


class Algorithm(Enum):
    """Hyperopt's algorithms."""

    tpe = "tpe"
    random = "random"
    anneal = "anneal"


@dataclass
class HyperoptConf:
    """`hydra.sweeper` with `hydra/sweeper=hyperopt`."""

    _target_: str = "hydra_plugins.hyperopt_sweeper.hyperopt_sweeper.HyperoptSweeper"
    _convert_: str = "all"
    direction: Direction = Direction.minimize
    """Whether small or large results are better."""
    num_trials: int = 50
    """Trials of the whole search, those of earlier starts included."""
    batch_size: int = 1
    """Trials that are launched together."""
    algorithm: Algorithm = Algorithm.tpe
    """Tree of Parzen estimators, random search or annealing."""
    num_startup: int = 20
    """Trials that tpe draws at random before it models anything, `initial` among them."""
    seed: int = 0
    """Seed of all randomness."""
    initial: list[dict[str, Any]] = field(default_factory=list)
    """First trials: a value of each searched key."""
    max_failures: int = 0
    """Trials of the whole search that may fail for other reasons than their values, such as a lack of memory; one more
    ends the search, and the next start tries it again. Where a process is killed, all of its batch have failed. A
    ValueError or an ArithmeticError never ends a search."""
    stacked: bool = False
    """Whether a batch is one job, which gets a list of values for each searched key and returns as many results."""
    irrelevant: list[str] = field(default_factory=list)
    """Keys whose values change no result and do not count in the identity of a search."""
    params: dict[str, str] = field(default_factory=dict)
    """Key -> its space, in Hydra's grammar; the command line wins."""


ConfigStore.instance().store(group="hydra/sweeper", name="hyperopt", node=HyperoptConf, provider="hyperopt_sweeper")


def identity(settings: HyperoptConf, space: Space) -> dict[str, Any]:
    """The identity of the search that trials belong to; numbers of trials, batches and failures do not count."""
    return {
        "format": 1,
        "space": {key: str(dimension) for key, dimension in space.dimensions.items()},
        "fixed": sorted(each for each in space.fixed if _key(each) not in settings.irrelevant),
        "direction": settings.direction.value,
        "algorithm": settings.algorithm.value,
        "num_startup": settings.num_startup,
        "seed": settings.seed,
        "initial": settings.initial,
    }


def stored_trials(
    folder: Path, sweeper: DictConfig, irrelevant: Sequence[str], parser: OverridesParser, arguments: Sequence[str]
) -> list[Trial]:
    """The trials in the folder of a search, without searching.

    Args:
        folder: `hydra.sweep.dir`.
        sweeper: `hydra.sweeper`, in its composed configuration.
        irrelevant: `hydra.sweeper.irrelevant`, which replaces that of `sweeper`.
        parser: Hydra's, of overrides.
        arguments: overrides of the command line that are not Hydra's own.

    Raises:
        SearchError: their file is corrupted or belongs to another search, or the space cannot be searched.
    """
    settings: Any = OmegaConf.to_container(sweeper, resolve=True)
    conf = HyperoptConf(**{**settings, "irrelevant": [*irrelevant]})
    return load(folder / TRIALS, identity(conf, parse(parser, conf.params, arguments)))


class HyperoptSweeper(Sweeper):
    """Searches with hyperopt."""

    def __init__(self, **settings: Any) -> None:
        """Settings are the fields of `HyperoptConf`."""
        self.settings = HyperoptConf(**settings)
        self._sign = -1 if self.settings.direction == Direction.maximize else 1
        self.hydra_context: HydraContext | None = None
        self.config: DictConfig | None = None
        self.launcher: Launcher | None = None

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Take Hydra's context, task and configuration; called by Hydra first."""
        self.hydra_context = hydra_context
        self.config = config
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """Search, resuming from the trials on disk.

        Raises:
            SearchError: the space, the settings or the trials on disk cannot be used; or all trials failed.
            FinalError: raised by the application.
        """
        from hydra_plugins.hyperopt_sweeper._search import Search

        assert self.config is not None
        settings = self.settings
        self._check_counts()
        space = self._space(arguments)
        initial = [space.point(values, f"hydra.sweeper.initial[{i}]") for i, values in enumerate(settings.initial)]
        search = Search(
            space, settings.algorithm.value, num_startup=settings.num_startup, seed=settings.seed, initial=initial
        )
        folder = Path(self.config.hydra.sweep.dir).absolute()
        path, search_identity = folder / TRIALS, identity(self.settings, space)
        trials = load(path, search_identity)
        for trial in trials:
            search.restore(trial.point, self._loss(trial.result))
        folder.mkdir(parents=True, exist_ok=True)
        OmegaConf.save(self.config, folder / "multirun.yaml")
        log.info(
            f"{len(trials)} of {settings.num_trials} trials are complete; run the same command with "
            f"hydra.sweep.dir={folder} to resume."
        )
        while len(trials) < settings.num_trials:
            num = min(settings.batch_size, settings.num_trials - len(trials))
            batch = self._run(space, [search.ask() for _ in range(num)], trials)
            for trial in batch:
                search.tell(trial.trial, self._loss(trial.result))
            trials += batch
            save(path, search_identity, trials)
            write_results(folder, trials, self._best(trials))
            best = self._best(trials)
            log.info(f"{len(trials)} of {settings.num_trials} trials are complete; the best is {_describe(best)}.")
        self._finish(folder, trials)

    def _check_counts(self) -> None:
        for key, least in {"num_trials": 1, "batch_size": 1, "num_startup": 1, "seed": 0, "max_failures": 0}.items():
            value = getattr(self.settings, key)
            if value < least:
                raise SearchError(f"hydra.sweeper.{key} = {value} is not allowed; it should be {least} or more.")

    def _space(self, arguments: Sequence[str]) -> Space:
        assert self.hydra_context is not None
        loader = self.hydra_context.config_loader
        space = parse(OverridesParser.create(loader), self.settings.params, arguments)
        if self.settings.stacked:
            for key in space.dimensions:
                if loader.get_group_options(key.partition("@")[0], ObjectType.CONFIG):
                    raise SearchError(
                        f"{key} is a group of configurations, which a job has one of, so it cannot be searched with "
                        "hydra.sweeper.stacked=true; give it a fixed value, or set stacked to false."
                    )
        return space

    def _run(self, space: Space, points: Sequence[Point], before: Sequence[Trial]) -> list[Trial]:
        """Run a batch after the trials that were `before` it.

        Raises:
            TrialError: too many trials have failed for other reasons than their values.
            FinalError: raised by the application.
        """
        assert self.launcher is not None
        stacked, first = self.settings.stacked, len(before)
        jobs = [space.stacked(points)] if stacked else [space.overrides(point) for point in points]
        self.validate_batch_is_legal(jobs)
        start = time.perf_counter()
        try:
            results = outcomes(self.launcher.launch(jobs, initial_job_idx=first), len(points), stacked)
        except Exception as error:  # a process was killed, for lack of memory, say: nobody knows whose
            results = [failure(error)] * len(points)
        for outcome in results:
            if isinstance(outcome.raised, FinalError):
                raise outcome.raised
        seconds = round(time.perf_counter() - start, 3)
        crashed = {number: outcome for number, outcome in enumerate(results, start=first) if outcome.crashed}
        failures = sum(trial.crashed for trial in before) + len(crashed)
        if crashed and failures > self.settings.max_failures:
            numbers, outcome = ", ".join(map(str, crashed)), next(iter(crashed.values()))
            cause = str(outcome.error).rstrip(".")
            raise TrialError(
                f"Trial{'s' * (len(crashed) > 1)} {numbers} could not be run: {cause}; run the same command to "
                f"try again. If that never succeeds, add hydra.sweeper.max_failures={failures} to count this as failed."
            ) from outcome.raised
        trials = []
        for number, (point, outcome) in enumerate(zip(points, results, strict=True), start=first):
            values, (result, reason, _) = space.values(point), outcome
            trials.append(Trial(number, dict(point), values, result, reason, seconds, outcome.crashed))
            if outcome.error:
                log.warning(f"Trial {number} failed: {outcome.error}", exc_info=outcome.raised)
        return trials

    def _loss(self, result: float | None) -> float | None:
        """The loss that hyperopt minimizes."""
        return None if result is None else self._sign * result

    def _best(self, trials: Sequence[Trial]) -> Trial | None:
        complete = [(self._sign * trial.result, trial.trial) for trial in trials if trial.result is not None]
        return trials[min(complete)[1]] if complete else None

    def _finish(self, folder: Path, trials: Sequence[Trial]) -> None:
        best = self._best(trials)
        write_results(folder, trials, best)
        failed = [trial for trial in trials if trial.status == "fail"]
        if not best:
            raise SearchError(
                f"All {len(trials)} trials failed, the first one with {failed[0].error}; correct the application, "
                f"remove {folder / TRIALS} and start again."
            )
        if failed:
            log.warning(f"{len(failed)} of {len(trials)} trials failed: {', '.join(str(t.trial) for t in failed)}.")
        log.info(f"The best is {_describe(best)}; all trials are in {folder}.")


def _key(override: str) -> str:
    return override.partition("=")[0].lstrip("+~")


def _describe(trial: Trial | None) -> str:
    if trial is None:
        return "not known, because all failed"
    return f"trial {trial.trial} with {trial.result}: " + ", ".join(f"{k}={v}" for k, v in trial.values.items())
