"""The command `affmap`: run the incomplete jobs of a sweep, or the missing trials of a search.

It takes Hydra overrides. Hydra's launcher decides where the jobs of a sweep run.
"""

import json
import logging
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import hydra
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from affmap.cli import help
from affmap.cli.app import MULTIRUN, SweepError, command, flags, read_jobs, read_sweep
from affmap.cli.processes import end_with_parent, interruption, sigint_spares_workers, sigterm_ends_process
from affmap.config.compose import compose, num_workers, runs_here
from affmap.config.notes import expand_folder, write_note
from affmap.config.overrides import is_sweep, keys, parse, without_sweeps
from affmap.config.root import Config, plain
from affmap.config.search import IRRELEVANT, OtherSearch, Search
from affmap.config.sweep import Sweep
from affmap.pipeline import status
from affmap.pipeline.completed import report_problem
from affmap.pipeline.job import (
    agents_without_models,
    all_stages,
    check_models,
    check_trials,
    find,
    incomplete,
    is_complete,
)
from affmap.pipeline.machine import MachineError, check_devices, check_logger
from affmap.pipeline.progress import follow
from affmap.pipeline.stage import CONTROL, TRAIN
from affmap.results.manifest import check_output
from affmap.settings import ConfigError, extensions, folder
from affmap.settings.messages import first_lines
from affmap.store.files import check_locks, locked
from affmap.store.stage import StoreError
from hydra_plugins.hyperopt_sweeper import TrialError

log = logging.getLogger("affmap")

HYDRA = {"--hydra-help", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc"}
"""Hydra's flags that print something and run nothing."""


def main() -> None:
    """`affmap`: run the incomplete jobs of a sweep, or the missing trials of a search."""
    given = {flag.partition("=")[0] for flag in flags()}
    if given & {"--help", "-h"}:
        command(lambda _: print(help.text()), known=flags())
    elif given & HYDRA:
        if given & {"--cfg", "-c"}:
            command(_check, known=flags())
        command(lambda _: _job(), known=flags())
    else:
        command(_run)


def _check(arguments: list[str]) -> None:
    """Validate a configuration before Hydra prints it.

    Raises:
        ConfigError: a value is not allowed; or there are several of one key, which Hydra cannot print.
    """
    overrides = [argument for argument in arguments if "=" in argument]  # others belong to a flag
    read_sweep(overrides)
    if swept := [each for each in parse(overrides) if each.is_sweep_override()]:
        raise ConfigError(f"--cfg shows a single job, and {swept[0].input_line} makes several; give one value.")


def _run(arguments: list[str]) -> None:
    if not arguments:
        raise ConfigError(help.SHORT)
    extensions.load()  # the report needs all of them; whoever named one that is broken hears it before hours of work
    overrides = expand_folder(arguments)
    if other := OtherSearch.read(overrides):
        _run_other_search(other)
        return
    jobs = read_jobs(overrides)
    if isinstance(jobs, Search):
        _run_search(jobs)
    else:
        _run_sweep(jobs)
        print(_next(jobs.first))


def _run_search(search: Search) -> None:
    """Run the missing trials of a search.

    Raises:
        SearchError: its folder holds the trials of another search, whose note is kept.
    """
    check_output(search.config.output, ())
    print(f"{search.config.name}: {search.num_complete} of {search.num_trials} trials are complete.", flush=True)
    if search.num_complete < search.num_trials:
        _check_machine([search.config], search.fixed)
    write_note(search.config.output, search.overrides)
    irrelevant = f"hydra.sweeper.irrelevant={list(IRRELEVANT)}"
    search.folder.mkdir(parents=True, exist_ok=True)
    try:
        with locked(search.folder / "search.lock", f"another command that searches in {search.folder}"):
            problem = _launch(["-m", *search.overrides, irrelevant])
    except TrialError as error:
        raise SweepError(str(error)) from None
    if problem:
        raise SweepError("\n".join([*problem, "Run the same command again to resume."]))
    print(f"{search.config.name}: the search is complete.\n{_next(search.config)}")


def _run_other_search(search: OtherSearch) -> None:
    """Let another sweeper of Hydra's search; its stages are kept as those of any job.

    Raises:
        SweepError: it has failed.
    """
    check_output(search.config.output, ())
    _check_machine([search.config], search.overrides)
    if problem := _launch(["-m", *search.overrides]):
        raise SweepError("\n".join(problem))
    print(f"{search.config.name}: the search is complete; {search.folder} holds what {search.sweeper} has found.")


def _run_sweep(jobs: Sweep) -> None:
    """Run the incomplete jobs of a sweep and of those that belong to it.

    Raises:
        SweepError: some are still incomplete afterwards.
    """
    first, count = jobs.first, len(jobs.configs)
    check_output(first.output, all_stages(jobs))
    complete = sum(is_complete(config) for config in jobs.configs)
    print(f"{first.name}: {complete} of {count} settings are complete.", flush=True)
    if complete == count:
        for config in jobs.configs:
            find(config)  # verifies every file
        _run_companions(jobs)
        return
    for config in jobs.configs:
        check_models(config)
        check_trials(config)
    if undrawn := report_problem(jobs):
        print(f"affmap-report will not draw this sweep: {undrawn}", flush=True)
    _check_machine(jobs.configs, jobs.overrides)
    check_locks(first.store)
    for kind in agents_without_models(jobs.configs):
        print(f"agent={kind} flies without a model; the models are trained for the losses and maps of its report only.")
    write_note(first.output, jobs.overrides)
    with _progress(jobs) as arguments:
        problem = _launch(arguments)
        while problem and complete < (now := sum(is_complete(config) for config in jobs.configs)):
            # A killed worker takes the others with it, whose jobs are not to blame.
            complete = now
            problem = _launch(arguments)
    failed = status.failures(status.jobs(jobs, check=True), first.output)
    if problem or failed:
        head = f"{first.name}: {len(failed)} of {count} settings are not complete:"
        lines = [head, *first_lines(failed, len(failed)), *problem]
        more = f"All logs are in {first.output / 'jobs'}; run the same command again to resume."
        raise SweepError("\n".join([*lines, more]))
    _run_companions(jobs)
    print(f"{first.name}: all {count} settings are complete.")


def _check_machine(configs: Sequence[Config], overrides: Sequence[str]) -> None:
    """Make sure that this machine has what jobs need before the first one starts; those of a cluster find out there.

    Raises:
        MachineError: a package or a GPU is missing.
    """
    is_here = runs_here(compose(without_sweeps(overrides)))
    for config in configs:
        check_logger(config)
        planned = [TRAIN] if config.objective == "validation_nll" else [TRAIN, CONTROL]
        check_devices(config, incomplete(config, planned) if is_here else [])


@contextmanager
def _progress(jobs: Sweep) -> Iterator[list[str]]:
    """Show the progress of several workers together; yields the command line for Hydra, on which they are silent.

    One worker, or a single job, shows the progress of its stages itself.
    """
    if not is_sweep(jobs.overrides):
        yield [*jobs.overrides]
        return
    composed = compose(without_sweeps(jobs.overrides))
    workers, arguments = num_workers(composed), ["-m", *jobs.overrides]
    if workers == 1 or len(jobs.configs) == 1:
        yield arguments
        return
    has_console = OmegaConf.select(composed, "hydra.job_logging.handlers.console") is not None
    silent = ["++hydra.job_logging.handlers.console.level=ERROR"] if has_console else []  # their logs are files, too
    with follow(jobs.first.name, lambda: status.overview(status.jobs(jobs), workers)):
        yield [*arguments, *silent]


def _next(config: Config) -> str:
    """The command that comes after a run."""
    return f"affmap-report {shlex.quote(str(config.output))} shows and draws the results."


def _run_companions(jobs: Sweep) -> None:
    """Run the sweeps that belong to a sweep, after it, because they share its models."""
    for companion in jobs.companions():
        _run_sweep(companion)


def _launch(arguments: list[str]) -> list[str]:
    """Let Hydra run the jobs of a command line; returns an error of its launcher as a sentence, if there is one."""
    os.environ["HYDRA_FULL_ERROR"] = "1"  # raise exceptions rather than print them
    fixed = keys(without_sweeps(each for each in arguments if each not in MULTIRUN))
    named = f"hydra.job.config.override_dirname.exclude_keys={json.dumps(fixed)}"  # log lines name the others
    original, sys.argv[1:] = sys.argv[1:], [*arguments, named]
    try:
        with sigint_spares_workers():
            _job()
    except (HydraException, MachineError):  # a sentence already
        raise
    except Exception as error:
        if interruption(error):
            raise
        log.debug("The launcher failed.", exc_info=error)
        return [f"The launcher stopped: {type(error).__name__}: {error}"]
    finally:
        sys.argv[1:] = original
    return []


@hydra.main(version_base="1.3", config_path=str(folder()), config_name="config")
def _job(composed: DictConfig) -> float | list[float] | None:
    """Run one job of a sweep, in a worker of its launcher; failures are reported in its log.

    A trial of a search returns its objective, or raises for the sweeper.
    """
    end_with_parent()
    try:
        with sigterm_ends_process():
            from affmap.pipeline.execution import run, score  # torch takes seconds to import

            config = Config.checked(plain(composed), "the configuration")
            if config.objective:
                return score(config)
            run(config)
    except Exception as error:
        if interruption(error):
            raise
        is_sentence = isinstance(error, (ConfigError, MachineError, StoreError))
        remedy = "" if is_sentence else " Run the same command again to resume."
        log.error("This job failed: %s.%s", str(error).rstrip("."), remedy, exc_info=not is_sentence)
        if composed.get("objective"):
            raise
    return None
