"""The command `affmap`: run the incomplete jobs of a sweep, or the missing trials of a search.

It takes Hydra overrides. The jobs of a sweep run wherever Hydra's launcher puts them.
"""

import logging
import os
import shlex
import sys

import hydra
from hydra.errors import HydraException
from omegaconf import DictConfig

from affmap.cli.app import SweepError, command, end_with_parent, ended_by_scheduler, flags, read_sweep
from affmap.config import sweep
from affmap.config.root import Config, plain
from affmap.config.search import Search
from affmap.config.sweep import Sweep
from affmap.pipeline import status
from affmap.pipeline.job import all_stages, check_logger, check_models, check_trials, find, is_complete
from affmap.results.manifest import check_output
from affmap.settings import ConfigError, folder
from affmap.store.files import locked
from affmap.store.stage import StoreError
from hydra_plugins.hyperopt_sweeper import TrialError

log = logging.getLogger("affmap")

HYDRA = {"--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc"}
"""Hydra's own flags that print something and run nothing."""

IRRELEVANT = ("threads", "compiled", "versions", "logger", "store", "reference", "output", "title", "notice")
"""Keys that change no result of a trial, or only its rounding."""


def main() -> None:
    """`affmap`: run what is not complete yet."""
    printing = HYDRA & {flag.partition("=")[0] for flag in flags()}
    if printing & {"--cfg", "-c"}:
        command(_check, known=flags())
    if printing:
        _job()
    else:
        command(_run)


def _check(arguments: list[str]) -> None:
    """Refuse to print a configuration that cannot be run."""
    read_sweep([argument for argument in arguments if "=" in argument])  # else it belongs to a flag


def _run(arguments: list[str]) -> None:
    if search := Search.read(arguments):
        _run_search(search)
    else:
        _run_sweep(read_sweep(arguments))


def _run_search(search: Search) -> None:
    """Make the trials of a search that have not been made."""
    check_output(search.config.output, ())
    check_logger(search.config)
    sweep.write_note(search.config.output, search.overrides)
    same = f"hydra.sweeper.irrelevant={list(IRRELEVANT)}"
    search.folder.mkdir(parents=True, exist_ok=True)
    try:
        with locked(search.folder / "search.lock", f"another command that searches in {search.folder}"):
            problem = _launch(["-m", *search.overrides, same])
    except TrialError as error:
        raise SweepError(str(error)) from None
    if problem:
        raise SweepError("\n".join([*problem, "The same command goes on where this one stopped."]))
    print(f"{search.config.name}: the search is complete; affmap-report {shlex.join(sys.argv[1:])} draws it.")


def _run_sweep(jobs: Sweep) -> None:
    """Run what is not complete of a sweep.

    Raises:
        SweepError: some of it is not complete afterwards.
    """
    first, count = jobs.first, len(jobs.configs)
    check_output(first.output, all_stages(jobs))
    complete = sum(is_complete(config) for config in jobs.configs)
    print(f"{first.name}: {complete} of {count} settings are complete.", flush=True)
    if complete == count:
        for config in jobs.configs:
            find(config)  # which looks at every file
        _run_companions(jobs)
        return
    for config in jobs.configs:
        check_models(config)
        check_trials(config)
        check_logger(config)
    sweep.write_note(first.output, jobs.overrides)
    arguments = [*(["-m"] if sweep.is_sweep(jobs.overrides) else []), *jobs.overrides]
    problem = _launch(arguments)
    while problem and complete < (now := sum(is_complete(config) for config in jobs.configs)):
        # A worker that was killed took the others with it, whose jobs are not to blame.
        complete = now
        problem = _launch(arguments)
    failed = status.failures(status.jobs(jobs, check=True))
    if problem or failed:
        lines = [f"{first.name}: {len(failed)} of {count} settings are not complete:", *failed, *problem]
        more = f"All logs are in {first.output / 'jobs'}; the same command goes on where this one stopped."
        raise SweepError("\n".join([*lines, more]))
    _run_companions(jobs)
    print(f"{first.name}: all {count} settings are complete; affmap-report {shlex.join(sys.argv[1:])} draws them.")


def _run_companions(jobs: Sweep) -> None:
    """Run the sweeps that belong to a sweep: after it, because they share its models."""
    for companion in jobs.companions():
        _run_sweep(companion)


def _launch(arguments: list[str]) -> list[str]:
    """Let Hydra run the jobs of a command line; returns what its launcher stumbled over, in a sentence."""
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions come here, and not as text to the terminal
    given, sys.argv[1:] = sys.argv[1:], arguments
    try:
        _job()
    except HydraException:  # which is a sentence already
        raise
    except Exception as error:
        log.debug("The launcher failed.", exc_info=error)
        return [f"The launcher stopped: {type(error).__name__}: {error}"]
    finally:
        sys.argv[1:] = given
    return []


@hydra.main(version_base="1.3", config_path=str(folder()), config_name="config")
def _job(composed: DictConfig) -> float | list[float] | None:
    """Run one job of a sweep, in whatever process its launcher has made; failures are reported in its log.

    A trial of a search returns its objective, and raises where it fails, for the sweeper.
    """
    end_with_parent()
    try:
        with ended_by_scheduler():
            from affmap.pipeline.execution import run, score  # torch takes seconds to import

            config = Config.checked(plain(composed), "the configuration")
            if config.objective:
                return score(config)
            run(config)
    except Exception as error:
        is_sentence = isinstance(error, (ConfigError, StoreError))
        words = "This job failed: %s The same command goes on where it stopped."
        log.error(words, str(error).rstrip(".") + ".", exc_info=not is_sentence)
        if composed.get("objective"):
            raise
    return None
