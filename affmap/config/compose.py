"""The checked configuration of one job, composed by Hydra from its overrides; Hydra's errors become sentences."""

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
from omegaconf import OmegaConf

from affmap.config import memory
from affmap.config.root import Config, plain
from affmap.settings import ConfigError, check_folder, folder, read
from affmap.settings.messages import one_line, shown

FOLDERS = ("hydra.run.dir", "hydra.sweep.dir", "hydra.sweep.subdir")
LAUNCHER, WORKERS = "hydra.launcher", "hydra.launcher.n_jobs"

MAX_WORKERS = 1024
"""Jobs at the same time."""


def check(overrides: Sequence[str]) -> Config:
    """The configuration of one job.

    Raises:
        ConfigError: a value that is not allowed; the message names the key, its file, the value and what is right.
    """
    composed = compose(overrides)
    choices = composed.hydra.runtime.choices
    origins = {group: f"conf/{group}/{choice}.yaml or the command line" for group, choice in choices.items()}
    origins[""] = "the configuration"  # checked together
    config = Config.checked(values(composed), "conf/config.yaml or the command line", origins)
    memory.check(config)
    check_launch(launch(composed))
    return config


def check_launch(settings: Mapping[str, Any]) -> None:
    """Refuse what Hydra would stumble over only when it starts the jobs: its folders and the number of workers.

    Args:
        settings: what `launch` returned.

    Raises:
        ConfigError: one of them cannot be used.
    """
    for key in FOLDERS:
        path = settings[key]
        try:
            check_folder(Path(path or ""))
        except ValueError as error:
            raise ConfigError(f"{key} = {shown(path)} is not allowed: it {error}.") from None
    workers = settings[WORKERS]
    if settings[LAUNCHER] is None or not isinstance(workers, int) or not 0 < abs(workers) <= MAX_WORKERS:
        raise ConfigError(
            f"hydra.launcher.n_jobs = {shown(workers)} is not allowed: it should be 1 to {MAX_WORKERS}, or -1 for a "
            "job on each core."
        )


def launch(composed: Any) -> dict[str, Any]:
    """Hydra's settings of how jobs are launched: their folders, and the number of workers where the launcher has it."""
    composed.hydra.job.num, composed.hydra.job.id = 0, "0"  # folders are named by the job's number
    with hydra_errors():
        settings = {key: OmegaConf.select(composed, key) for key in (*FOLDERS, LAUNCHER)}
        return {**settings, WORKERS: OmegaConf.select(composed, WORKERS, default=1)}


def parse(overrides: Sequence[str]) -> list[Override]:
    """The overrides of a command line."""
    with hydra_errors(), initialize_config_dir(str(folder()), version_base="1.3"):
        # The loader knows the groups that `glob(...)` chooses from.
        return OverridesParser.create(GlobalHydra.instance().config_loader()).parse_overrides([*overrides])


def compose(overrides: Sequence[str]) -> Any:
    """What Hydra makes of the overrides of one job, its own settings included; the same object if asked again."""
    files = [folder(), *folder().rglob("*")]
    return _compose(tuple(overrides), folder(), max(path.stat().st_mtime_ns for path in files))


@lru_cache(maxsize=64)
def _compose(overrides: tuple[str, ...], conf: Path, changed: int) -> Any:
    """The same, of a folder whose files were last `changed` at some time."""
    with hydra_errors(), initialize_config_dir(str(conf), version_base="1.3"):
        return hydra.compose("config", [*overrides], return_hydra_config=True)


def values(composed: Any) -> dict[str, Any]:
    """The plain values of a composed configuration, checked by nothing."""
    with hydra_errors():
        return plain(composed)


@contextmanager
def hydra_errors() -> Iterator[None]:
    """Tell in a sentence whatever Hydra finds wrong with a command line.

    Nothing but Hydra runs in here, and its parser, its YAML and its interpolations let through what Python raises:
    ValueError for a step of 0, RecursionError for brackets in brackets, AttributeError for a group that is null.
    """
    try:
        yield
    except Exception as error:
        text = str(error) or str(error.__cause__ or "") or "Hydra does not say why"
        # Hydra's messages end in addresses, its own places and types, and name classes and columns.
        text = re.split(r"\n\s*(?:See http|Config search path|full_key|reference_type|\^)", text)[0]
        text = re.sub(r"^\w+Exception: |\w+(?:Error|Exception) (?:raised )?(?=while )", "", text)
        raise ConfigError(f"this cannot be read: {one_line(text).rstrip('.')}{_in_folders(text)}.") from None


def _in_folders(text: str) -> str:
    """The options of a group that Hydra's list of them leaves out: files in folders of its folder."""
    group = re.search(r"Available options in '([\w/]+)'", text)
    if not group:
        return ""
    paths = sorted(folder().glob(f"{group[1]}/*/**/*.yaml"))
    groups = {key for entry in read(".", "config")["defaults"] if isinstance(entry, dict) for key in entry}
    options = [path for path in paths if path.parent.relative_to(folder()).as_posix() not in groups]
    return "".join(f" {path.relative_to(folder() / group[1]).with_suffix('')}" for path in options)
