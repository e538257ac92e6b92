"""The overrides of a command line, a text each: read by Hydra's grammar, told apart, replaced. Composes nothing."""

from collections.abc import Collection, Iterable
from typing import Any, NoReturn

from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override

from affmap.config.explain import hydra_errors
from affmap.settings import ConfigError, folder
from affmap.settings.messages import format_value


def parse(overrides: Iterable[str]) -> list[Override]:
    """The overrides of a command line."""
    with hydra_errors():
        parsed = overrides_parser().parse_overrides([*overrides])
    for each in parsed:
        if not each.key_or_group:
            raise ConfigError(
                f"the override {format_value(each.input_line)} cannot be read: it has no key; write key=value, such as "
                "model.context_size=3."
            )
    return parsed


def overrides_parser() -> OverridesParser:
    """Hydra's parser of overrides, which knows the groups of `conf` that `glob(...)` chooses from."""
    with initialize_config_dir(str(folder()), version_base="1.3"):
        parser = OverridesParser.create(GlobalHydra.instance().config_loader())
    parser.functions.functions["shuffle"] = _shuffle
    return parser


def _shuffle(*_: Any, **__: Any) -> NoReturn:
    raise ValueError("it has another order each time it is read; write the order itself")


def keys(overrides: Iterable[str]) -> list[str]:
    """The keys and groups of a command line."""
    return [override.key_or_group for override in parse(overrides)]


def is_sweep(overrides: Iterable[str]) -> bool:
    """Whether a command line has a sweep, be it one of a single job."""
    return any(override.is_sweep_override() for override in parse(overrides))


def without_sweeps(overrides: Iterable[str]) -> list[str]:
    """The overrides that have one value in all jobs of a command line."""
    return [str(override.input_line) for override in parse(overrides) if not override.is_sweep_override()]


def replace_experiment(overrides: Iterable[str], experiment: str, dropped: Collection[str]) -> list[str]:
    """A command line with another experiment, and without the keys in `dropped`."""
    rest = [each for each in parse(overrides) if each.key_or_group not in {"experiment", *dropped}]
    return [*(str(override.input_line) for override in rest), f"experiment={experiment}"]
