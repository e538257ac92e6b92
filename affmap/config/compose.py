"""The validated configuration of one job, composed by Hydra from its overrides."""

import re
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import hydra
from hydra import initialize_config_dir
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.plugins import Plugins
from hydra.errors import ConfigCompositionException
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from affmap.config import interpolations, memory
from affmap.config.explain import groups, hydra_errors, options
from affmap.config.overrides import parse
from affmap.config.root import Config, plain
from affmap.settings import ConfigError, check_folder, folder, folders, plain_yaml
from affmap.settings.base import find
from affmap.settings.messages import format_value

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
    plain_values = values(composed)
    if unknown := plain_values.keys() - Config.model_fields.keys():
        _check_packages(choices, unknown)
    config = Config.checked(plain_values, "conf/config.yaml or the command line", origins)
    memory.check(config)
    check_launch(launch_settings(composed))
    return config


def _check_packages(choices: Mapping[str, str | None], unknown: Collection[str]) -> None:
    """Make sure that files of groups without a key of their own, such as experiments, set the keys of all.

    Args:
        choices: group -> chosen file.
        unknown: keys of the configuration that should not be there.

    Raises:
        ConfigError: a file lacks the line that says so.
    """
    for group, choice in choices.items():
        if not choice or "/" in group or group in Config.model_fields:
            continue
        # The chosen file may build on another one of its group.
        for each in folders():
            others = sorted((each / group).rglob("*.yaml")) if group in unknown else []
            for path in (each / group / f"{choice}.yaml", *others):
                if path.is_file():
                    _check_package(path, each)


def _check_package(path: Path, conf: Path) -> None:
    """Make sure that a file of `conf` begins with the line that makes its keys those of the whole configuration.

    Raises:
        ConfigError: the line is missing, misspelt or in another place.
    """
    text, line = path.read_text("utf-8"), "# @package _global_"
    if re.match(r"\s*#\s*@package\s+_global_(\s|$)", text):
        return
    remedy = "add it"
    if found := re.search(r"^\s*#\s*@.*", text, re.MULTILINE):
        number, present = text.count("\n", 0, found.end()) + 1, found[0].strip()
        steps = [*(["correct it"] if present != line else []), *(["move it to the top"] if number > 1 else [])]
        remedy = f"line {number} is {format_value(present)}, so {' and '.join(steps)}"
    raise ConfigError(f"conf/{path.relative_to(conf)} should begin with the line `{line}`; {remedy}.")


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


def runs_here(composed: Any) -> bool:
    """Whether Hydra's launcher runs the jobs on this machine, and on no other of a cluster."""
    return composed.hydra.runtime.choices["hydra/launcher"] in ("basic", "joblib")


def num_workers(composed: Any) -> int:
    """The number of jobs that Hydra's launcher runs at the same time on this machine."""
    import joblib  # takes a fifth of a second to import

    return int(joblib.effective_n_jobs(launch_settings(composed)[WORKERS]))


def compose(overrides: Sequence[str]) -> Any:
    """Compose the overrides of one job, Hydra's own settings included; cached, so not to be changed."""
    paths = [path for each in folders() for path in (each, *each.rglob("*"))]
    modified = max(path.stat().st_mtime_ns for path in paths if path.exists())
    _check_aliases(folders(), modified)
    return _compose(tuple(overrides), folders(), modified)


@lru_cache(maxsize=1)
def _check_aliases(confs: tuple[Path, ...], _modified: int) -> None:
    """Make sure that Hydra, which writes out all aliases, can read any file."""
    for path, place in ((path, path.relative_to(conf)) for conf in confs for path in sorted(conf.rglob("*.yaml"))):
        if path.is_file() and (confs[0] / place.parts[0]).exists():  # else it is of no group of ours
            name = f"conf/{place}"
            plain_yaml.check_size(path, name)
            plain_yaml.check_aliases(path.read_text("utf-8", errors="replace"), name)


class OwnFolder(SearchPathPlugin):
    """Lets Hydra find files in `conf` of the current folder, too, where it composes our configuration."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Add that folder, after ours."""
        is_ours = any(each.provider == "main" and each.path == str(folder()) for each in search_path.get_path())
        for own in folders()[1:]:
            if is_ours:
                search_path.append("affmap", str(own))


@lru_cache(maxsize=64)
def _compose(overrides: tuple[str, ...], confs: tuple[Path, ...], _modified: int) -> Any:
    _check_choices(overrides)
    Plugins.instance().register(OwnFolder)  # each time: Hydra's launchers forget what was registered
    with hydra_errors(), initialize_config_dir(str(confs[0]), version_base="1.3"):
        try:
            composed = hydra.compose("config", [*overrides], return_hydra_config=True)
        except ConfigCompositionException as error:
            # What such a file overrides, Hydra looks for in the file's own group.
            file = re.match(r"In '((\w+)/.+?)': Could not override '.+@\2\.", str(error))
            if file and file[2] not in Config.model_fields:
                for each in confs:
                    if (path := each / f"{file[1]}.yaml").is_file():
                        _check_package(path, each)
            raise
        for group, choice in composed.hydra.runtime.choices.items():
            find(group, choice or "")
        interpolations.check(composed)
        return composed


def _check_choices(overrides: Sequence[str]) -> None:
    """Make sure that no override chooses null from a group; Hydra's error would not name the group.

    Raises:
        ConfigError: one does.
    """
    for each in parse(overrides):
        group = each.key_or_group
        if group in groups() and each.value() is None and not each.is_delete():
            files = ", ".join(options(group))
            raise ConfigError(f"{each.input_line} names no file of conf/{group}; leave it out, or name one: {files}.")


def values(composed: Any) -> dict[str, Any]:
    """The plain values of a composed configuration, not validated."""
    with hydra_errors():
        return plain(composed)
