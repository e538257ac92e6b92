"""The commands `affmap`, which runs what is not complete of a setting or a sweep, and `affmap-status`, which looks on.

Both take Hydra overrides. The jobs of a sweep run wherever Hydra's launcher puts them.
"""

import logging
import os
import shlex
import sys
from pathlib import Path

import hydra
from hydra.errors import HydraException
from omegaconf import DictConfig
from rich.console import Console

from affmap import status, sweep
from affmap.command import SweepError, command, end_with_parent, ended_by_scheduler, flags
from affmap.config import Config, plain
from affmap.files import locked
from affmap.reporting import check_output, digests
from affmap.search import Search
from affmap.settings import ConfigError, folder
from affmap.stage import StoreError
from affmap.stages import check_logger, check_models, check_trials, find, is_complete, run, score
from affmap.sweep import Sweep
from hydra_plugins.hyperopt_sweeper._space import TrialError

log = logging.getLogger("affmap")

HYDRA = {"--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc"}
"""Hydra's own flags that print something and run nothing."""

IRRELEVANT = ("threads", "versions", "logger", "store", "reference", "output", "title", "notice")
"""Keys that change no result of a trial."""


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
    Sweep.read([argument for argument in arguments if "=" in argument])  # else it belongs to a flag


def _run(arguments: list[str]) -> None:
    if search := Search.read(arguments):
        _run_search(search)
    else:
        _run_sweep(Sweep.read(arguments))


def _run_search(search: Search) -> None:
    """Make the trials of a search that have not been made."""
    check_output(search.config.output, ())
    check_logger(search.config)
    sweep.note(search.config.output, search.overrides)
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


def _run_sweep(asked: Sweep) -> None:
    """Run what is not complete of a sweep.

    Raises:
        SweepError: some of it is not complete afterwards.
    """
    if growth := asked.growth():
        _run_sweep(growth)
    first, count = asked.first, len(asked.configs)
    check_output(first.output, digests(asked))
    complete = sum(is_complete(config) for config in asked.configs)
    print(f"{first.name}: {complete} of {count} settings are complete.", flush=True)
    if complete == count:
        for config in asked.configs:
            find(config)  # which looks at every file
        return
    for config in asked.configs:
        check_models(config)
        check_trials(config)
        check_logger(config)
    sweep.note(first.output, asked.overrides)
    arguments = [*(["-m"] if sweep.is_sweep(asked.overrides) else []), *asked.overrides]
    problem = _launch(arguments)
    while problem and complete < (now := sum(is_complete(config) for config in asked.configs)):
        # A worker that was killed took the others with it, whose jobs are not to blame.
        complete = now
        problem = _launch(arguments)
    failed = status.failures(status.settings(asked, check=True))
    if problem or failed:
        lines = [f"{first.name}: {len(failed)} of {count} settings are not complete:", *failed, *problem]
        more = f"All logs are in {first.output / 'jobs'}; the same command goes on where this one stopped."
        raise SweepError("\n".join([*lines, more]))
    print(f"{first.name}: all {count} settings are complete; affmap-report {shlex.join(sys.argv[1:])} draws them.")


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
    """One job of a sweep, in whatever process its launcher has made; what goes wrong is told in its log.

    That of a search returns what the search is for; the sweeper wants to know of failures.
    """
    end_with_parent()
    try:
        with ended_by_scheduler():
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


def stand() -> None:
    """`affmap-status`: how sweeps stand; of overrides, or of folders of reports, by default of all in `runs`."""
    command(_stand, about=stand.__doc__)


def _stand(arguments: list[str]) -> None:
    folders = [Path(argument) for argument in arguments if "=" not in argument]
    if folders and len(folders) < len(arguments):
        raise ConfigError(
            "affmap-status takes either folders, such as runs/exp1, or overrides, such as experiment=exp1."
        )
    if not arguments:
        folders = sorted(path.parents[1] for path in Path("runs").rglob(sweep.NOTE))
    console = Console(width=None if sys.stdout.isatty() else 200, highlight=False)
    if not arguments and not folders:
        print("There is no sweep in runs; `affmap experiment=exp1` begins one.")
    elif not folders:
        _show(arguments, console)
    problems = []
    for path in folders:
        try:
            _show(sweep.noted(path), console)
        except (ConfigError, HydraException) as error:  # the others can be told
            problems.append(f"{path}: {error}")
    if problems:
        raise ConfigError("\n".join(problems))


def _show(line: list[str], console: Console) -> None:
    """Print how a search stands, or a sweep and what belongs to it."""
    if search := Search.read(line):
        made = f"{search.num_complete} of {search.num_trials} trials complete"
        console.print(f"{search.config.title} ({search.config.output}): {made}", markup=False)
        return
    asked = Sweep.read(line)
    for part in filter(None, (asked.growth(), asked)):
        found = status.settings(part)
        console.print(f"{part.first.title} ({part.first.output}): {status.summary(found)}", markup=False)
        console.print(status.table(found))
        for failure in status.failures(setting for setting in found if setting.state in ("failed", "damaged")):
            console.print(failure, markup=False)
