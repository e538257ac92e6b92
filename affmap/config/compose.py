"""The validated configuration of one job, composed by Hydra from its overrides; Hydra's errors become sentences."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import hydra
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import OverrideParseException
from omegaconf import OmegaConf

from affmap.config import memory
from affmap.config.root import Config, plain
from affmap.settings import ConfigError, check_folder, folder, read
from affmap.settings.messages import format_value, one_line

FOLDERS = ("hydra.run.dir", "hydra.sweep.dir", "hydra.sweep.subdir")
LAUNCHER, WORKERS, CHDIR = "hydra.launcher", "hydra.launcher.n_jobs", "hydra.job.chdir"

MAX_WORKERS = 1024
"""Most jobs at the same time."""


def check(overrides: Sequence[str]) -> Config:
    """The configuration of one job.

    Raises:
        ConfigError: a value is not allowed; the message names key, file, value and remedy.
    """
    composed = compose(overrides)
    choices = composed.hydra.runtime.choices
    origins = {group: f"conf/{group}/{choice}.yaml or the command line" for group, choice in choices.items()}
    origins[""] = "the configuration"  # of checks of several keys
    config = Config.checked(values(composed), "conf/config.yaml or the command line", origins)
    memory.check(config)
    check_launch(launch_settings(composed))
    return config


def check_launch(settings: Mapping[str, Any]) -> None:
    """Validate settings that Hydra only checks when it starts the jobs: its folders and the number of workers.

    Args:
        settings: returned by `launch_settings`.

    Raises:
        ConfigError: one of them cannot be used.
    """
    for key in FOLDERS:
        path = settings[key]
        try:
            check_folder(Path(path or ""))
        except ValueError as error:
            raise ConfigError(f"{key} = {format_value(path)} is not allowed: it {error}.") from None
    workers = settings[WORKERS]
    if settings[LAUNCHER] is None or not isinstance(workers, int) or not 0 < abs(workers) <= MAX_WORKERS:
        raise ConfigError(
            f"hydra.launcher.n_jobs = {format_value(workers)} is not allowed: it should be 1 to {MAX_WORKERS}, or -1 "
            "for a job on each core."
        )
    if settings[CHDIR]:
        raise ConfigError(
            "hydra.job.chdir = True is not allowed: store, output and reference are relative to the folder in which "
            "the command starts; leave it out."
        )


def launch_settings(composed: Any) -> dict[str, Any]:
    """Hydra's settings for launching jobs: their folders, and the number of workers where the launcher has one."""
    composed.hydra.job.num, composed.hydra.job.id = 0, "0"  # folders are named by the job's number
    with hydra_errors():
        settings = {key: OmegaConf.select(composed, key) for key in (*FOLDERS, LAUNCHER, CHDIR)}
        return {**settings, WORKERS: OmegaConf.select(composed, WORKERS, default=1)}


def parse(overrides: Sequence[str]) -> list[Override]:
    """The overrides of a command line."""
    with hydra_errors(), initialize_config_dir(str(folder()), version_base="1.3"):
        # The loader knows the groups that `glob(...)` chooses from.
        return OverridesParser.create(GlobalHydra.instance().config_loader()).parse_overrides([*overrides])


def compose(overrides: Sequence[str]) -> Any:
    """Compose the overrides of one job, Hydra's own settings included; cached, so not to be changed."""
    files = [folder(), *folder().rglob("*")]
    return _compose(tuple(overrides), folder(), max(path.stat().st_mtime_ns for path in files))


@lru_cache(maxsize=64)
def _compose(overrides: tuple[str, ...], conf: Path, _modified: int) -> Any:
    with hydra_errors(), initialize_config_dir(str(conf), version_base="1.3"):
        return hydra.compose("config", [*overrides], return_hydra_config=True)


def values(composed: Any) -> dict[str, Any]:
    """The plain values of a composed configuration, not validated."""
    with hydra_errors():
        return plain(composed)


@contextmanager
def hydra_errors() -> Iterator[None]:
    """Turn whatever Hydra raises about a command line into a ConfigError with a remedy.

    Only Hydra runs in the block. Its parser, its YAML and its interpolations let Python's own errors through:
    ValueError for a step of 0, RecursionError for brackets in brackets, AttributeError for a group that is null.
    """
    try:
        yield
    except Exception as error:
        raise ConfigError(_explain(error)) from None


def _explain(error: Exception) -> str:
    """Hydra's error as a sentence: a malformed override, an unknown key, an unknown option, or anything else."""
    text = str(error) or str(error.__cause__ or "") or "Hydra gives no reason"
    if isinstance(error, OverrideParseException):
        reason = re.search(r"while (evaluating .*)", text)
        remedy = one_line(reason[1]) if reason else "write key=value, with quotes around special characters"
        return f"the override {format_value(error.override)} cannot be read: {remedy}."
    if override := re.search(r"^Could not override '(.+)'\.\nTo append to your config", text):
        return _explain_key(getattr(error.__cause__, "full_key", None) or override[1])
    if choice := re.search(r"Could not find '(.*)'\n+Available options in '([\w/]+)':((?:\n\t.*)*)", text):
        path, group, options = choice.groups()
        names = ", ".join([*options.split(), *_nested(group)])
        return f"{group} = {format_value(path.removeprefix(f'{group}/'))} does not exist; there are: {names}."
    if extra := re.search(r"In 'hydra/launcher/(\w+)': Could not load '(.+)'", text):
        return (
            f"hydra/launcher = {extra[1]!r} needs {extra[2]}, which is not installed: pip install 'affmap[{extra[1]}]'."
        )
    # Hydra's messages end in addresses, its own places and types, and name classes and columns.
    text = re.split(r"\n\s*(?:See http|Config search path|full_key|reference_type|To append|\^)", text)[0]
    text = re.sub(r"^\w+Exception: |\w+(?:Error|Exception) (?:raised )?(?=while )", "", text)
    return f"this cannot be read: {one_line(text).rstrip('.')}."


def _explain_key(key: str) -> str:
    """A key that no configuration has, as a sentence; capitals are those of make's variables."""
    key = one_line(key)
    if key.isupper():
        return (
            f"{key} is a variable of make, as in make exp1 {key}=...; affmap takes overrides such as scale=smoke, "
            "models=reference or hydra.launcher.n_jobs=1 instead."
        )
    return f"{key} is not a known key; correct its spelling."


def _nested(group: str) -> list[str]:
    """Options of a group that Hydra's list leaves out: files in its folders, but for those that are groups."""
    groups = {key for entry in read(".", "config")["defaults"] if isinstance(entry, dict) for key in entry}
    paths = [path.relative_to(folder()) for path in sorted(folder().glob(f"{group}/*/**/*.yaml"))]
    return [str(path.relative_to(group).with_suffix("")) for path in paths if path.parent.as_posix() not in groups]
