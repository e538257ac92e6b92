"""From a command line to its jobs, composed and expanded as Hydra does. Runs nothing, knows configuration only.

An experiment names its sweep under `sweep`; a key that the command line sets is not swept over.
"""

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hydra.core.override_parser.types import Override, RangeSweep
from pydantic import TypeAdapter

from affmap.config.compose import compose, parse, values
from affmap.config.explain import groups, hydra_errors
from affmap.config.interpolations import refers_to_keys_only
from affmap.config.jobs import Checker, expand
from affmap.config.root import Config
from affmap.control.registry import is_learned
from affmap.settings import ConfigError, names
from affmap.settings.messages import format_value, nearest, one_line
from affmap.store.files import read_json, write_json
from affmap.store.provenance import has_valid_checksum, with_checksum

MAX_JOBS = 20_000
"""Most jobs of a command line; more must be a mistake. All are validated before the first one starts."""

MAX_COMPOSED = 1000
"""Most combinations of files and of texts with special characters, each of which takes Hydra a tenth of a second."""

NOTE = "jobs/sweep.json"
"""File of an output folder with the overrides of the last sweep run into it."""

LARGEST_NOTE = 30_000
"""Most bytes of such a file; one of a thousand values has 5,000."""

MOST_FOLDERS = 5
"""Most folders of sweeps that a message lists; further ones are only counted."""

SEARCH_KEYS = ("hydra/sweeper", "hydra.sweep.dir")
"""Keys of Hydra's that describe a search, besides those of its sweeper."""

BASELINE_KEYS = ("control_layout", "world", "seed", "members")
"""Keys that baselines are swept over, too: layouts and members."""


class Sweep(NamedTuple):
    """A command line whose sweep is written out, and its jobs."""

    overrides: list[str]
    configs: list[Config]
    values: list[dict[str, str]]
    """For each job: swept key -> its value, as on the command line."""

    @classmethod
    def read(cls, arguments: Sequence[str]) -> "Sweep":
        """The sweep of a command line.

        Raises:
            ConfigError: a value is not allowed; the message names key, file, value and remedy.
        """
        overrides = complete(arguments)
        return cls(overrides, jobs(overrides), swept_values(overrides))

    @property
    def labels(self) -> list[str]:
        """A label of each job: its swept keys, as on the command line."""
        lines = [" ".join(f"{key}={value}" for key, value in values.items()) for values in self.values]
        return [line or "the only setting" for line in lines]

    @property
    def first(self) -> Config:
        """The first job; all share the settings of reports."""
        return self.configs[0]

    def companions(self) -> "list[Sweep]":
        """The sweeps that belong to this one: growth and baselines, where it has them."""
        return [each for each in (self.growth(), self.baselines()) if each]

    def baselines(self) -> "Sweep | None":
        """The sweep over agents without a learned model: the same members and layouts, else the first job's values.

        They plan as the first job does, or by CEM where that follows gradients, which the true physics does not have.
        """
        first = self.first
        if not first.baselines or first.report.compare:
            return None
        fixed = {key: value for key, value in self.values[0].items() if key not in BASELINE_KEYS}
        dropped = {*fixed, "agent", "baselines", "growth", "name", "output"}
        if first.planner.kind == "gradient":
            planner_keys = {key for key in _keys(self.overrides) if key.partition(".")[0] == "planner"}
            dropped |= planner_keys
            fixed = {key: value for key, value in fixed.items() if key not in planner_keys} | {"planner": "cem"}
        rest = [str(each.input_line) for each in parse(self.overrides) if each.key_or_group not in dropped]
        fixed.pop("agent", None)
        own_names = {"name": f"{first.name}/baselines", "output": str(first.output / "baselines")}
        fixed |= {"growth": "null", "baselines": "[]", **own_names}
        lines = [f"{key}={value}" for key, value in fixed.items()]
        baselines = Sweep.read([*rest, *lines, f"agent={','.join(first.baselines)}"])
        if kinds := [config.agent.kind for config in baselines.configs if is_learned(config.agent)]:
            raise ConfigError(
                f"baselines = {list(first.baselines)} has {kinds[0]!r}, which imagines with a trained model; sweep "
                "over it instead, as in agent=planner,true_mean."
            )
        return baselines

    def growth(self) -> "Sweep | None":
        """The experiment whose maps after several epochs belong to this one's report, if there is one."""
        first = self.first
        if not first.growth:
            return None
        # An output folder on the command line is that of this experiment's report.
        dropped = {*first.sweep, "output", "growth", "baselines"}
        growth = Sweep.read(replace_experiment(self.overrides, first.growth, dropped))
        if growth.first.growth:
            raise ConfigError(
                f"growth = {first.growth!r} names an experiment that has a growth of its own; it must not."
            )
        return growth


def expand_folder(arguments: Sequence[str]) -> list[str]:
    """A command line in which a folder stands for the overrides of the last sweep run into it; other overrides win.

    Raises:
        ConfigError: there are several folders, or no such folder, or `read_note` cannot read its note; or the sweep
            writes to another folder.
    """
    folders = [argument for argument in arguments if is_folder(argument)]
    if not folders:
        return [*arguments]
    if len(folders) > 1:
        raise ConfigError(f"{format_value(folders[1])} is a second folder; give one folder at a time.")
    path, own = Path(folders[0]), [argument for argument in arguments if argument not in folders]
    overrides = [*read_note(path), *own]
    single = [str(each.input_line) for each in parse(overrides) if not each.is_sweep_override()]
    output = Path(str(values(compose(single))["output"]))
    if "output" not in _keys(own) and output.resolve() != path.resolve():
        raise ConfigError(
            f"the sweep of {path} writes to {output}; say that folder, where the sweep was run, or output={path}."
        )
    return overrides


def is_folder(argument: str) -> bool:
    """Whether an argument of a command line is the folder of a sweep, and no override."""
    return bool(argument.strip()) and "=" not in argument and not argument.startswith("~")


def folders_with_notes(parent: Path = Path("runs")) -> list[Path]:
    """Folders below `parent` that sweeps were run into."""
    return sorted(path.parents[1] for path in parent.rglob(NOTE))


def write_note(output: Path, overrides: Sequence[str]) -> None:
    """Note the overrides of a sweep in its output folder, with a checksum, for `read_note`."""
    path = output / NOTE
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, with_checksum({"overrides": [*overrides]}))


def read_note(output: Path) -> list[str]:
    """The overrides of the last sweep run into a folder, perhaps by somebody else.

    Hydra's own are left out, but for those of a search.

    Raises:
        ConfigError: there is no such folder, and the message lists those there are; or it has no note; or the note is
            corrupted, or it reads more than a configuration.
    """
    path = output / NOTE
    remedy = "give the overrides of the sweep instead, such as experiment=exp1."
    if not output.is_dir():
        raise ConfigError(f"{output} is neither a folder nor an override key=value{_other_folders(output)}")
    if not path.is_file():
        raise ConfigError(f"{output} holds no note of a sweep ({NOTE}); {remedy}")
    try:
        if path.stat().st_size > LARGEST_NOTE:
            raise ValueError(path)
        note = TypeAdapter(dict[str, Any]).validate_python(read_json(path))
        if not has_valid_checksum(note):
            raise ValueError(path)
        lines = TypeAdapter(list[str]).validate_python(note["overrides"])
    except (OSError, ValueError, KeyError):
        raise ConfigError(f"{path} is corrupted; {remedy}") from None
    overrides = [override for override in parse(lines) if not _is_hydra(override) or _is_of_search(override)]
    for override in overrides:
        if not refers_to_keys_only(repr(override.value())):
            raise ConfigError(
                f"{path}: {format_value(override.input_line)} reads more than keys of the configuration, which a file "
                "must not; give the overrides of the sweep instead."
            )
    return [str(override.input_line) for override in overrides]


def _other_folders(output: Path) -> str:
    """The end of a sentence on a folder that does not exist: folders of sweeps in its place."""
    place = Path("runs") if output.parent == Path() else output.parent
    folders = {str(path.relative_to(place)): str(path) for path in folders_with_notes(place)}
    near = nearest(output.name, folders)
    meant = [f"experiment={output}"] if output.name in names(f"experiment/{output.parent}") else []
    question = " or ".join([*meant, *([folders[near]] if near else [])])
    if not folders:
        begin = f"did you mean {question}" if question else "`affmap experiment=exp1` begins one"
        return f"; there is no sweep in {place}, {begin}{'?' if question else '.'}"
    listed = [*folders.values()][:MOST_FOLDERS]
    more = f" and {len(folders) - len(listed)} more" if len(folders) > len(listed) else ""
    return f"{f'; did you mean {question}?' if question else '.'} Folders of sweeps: {', '.join(listed)}{more}."


def _is_hydra(override: Override) -> bool:
    """Whether an override may change a key of Hydra's own."""
    return "hydra" in re.split(r"[./]", f"{override.key_or_group}.{override.package}")


def _is_of_search(override: Override) -> bool:
    """Whether an override describes a search."""
    key = override.key_or_group
    return override.package is None and (key in SEARCH_KEYS or key.startswith("hydra.sweeper."))


def complete(overrides: Sequence[str]) -> list[str]:
    """The command line with the experiment's sweep written out, in the experiment's order.

    Raises:
        ConfigError: there are several experiments, a group has a list of files, or an override is malformed.
    """
    parsed = {override.key_or_group: override for override in parse(overrides)}
    experiment = parsed.get("experiment")
    if experiment and (experiment.is_sweep_override() or isinstance(experiment.value(), list)):
        raise ConfigError("experiment takes one name at a time; run several experiments one after the other.")
    known = groups()
    for key, override in parsed.items():
        files = override.value() if key in known else None
        if isinstance(files, list) and len(files) > 1:  # Hydra would lay one file over the other
            line = one_line(f"{key}={','.join(map(str, files))}")
            raise ConfigError(f"{key} takes one file, and no list; write {line} for a job of each.")
    single = [str(override.input_line) for override in parsed.values() if not override.is_sweep_override()]
    sweep = values(compose(single)).get("sweep")
    # Malformed sweeps are reported when the jobs are validated.
    entries = sweep.items() if isinstance(sweep, Mapping) else []
    choices = {key: values for key, values in entries if isinstance(values, (str, int))}
    lines = {key: str(override.input_line) for key, override in parsed.items()}
    # In the experiment's order, so that jobs that share a model do not start at the same time.
    sweep_lines = [lines.get(key, f"{key}={values}") for key, values in choices.items()]
    return [line for key, line in lines.items() if key not in choices] + sweep_lines


def replace_experiment(overrides: Sequence[str], experiment: str, dropped: Collection[str]) -> list[str]:
    """A command line with another experiment, and without the keys in `dropped`."""
    rest = [each for each in parse(overrides) if each.key_or_group not in {"experiment", *dropped}]
    return [*(str(override.input_line) for override in rest), f"experiment={experiment}"]


def _keys(overrides: Sequence[str]) -> list[str]:
    """The keys and groups of a command line."""
    return [override.key_or_group for override in parse(overrides)]


def fixed_keys(overrides: Sequence[str]) -> list[str]:
    """The keys and groups that have one value in all jobs of a command line."""
    return [override.key_or_group for override in parse(overrides) if not override.is_sweep_override()]


def is_sweep(overrides: Sequence[str]) -> bool:
    """Whether a command line has a sweep, be it one of a single job."""
    return any(override.is_sweep_override() for override in parse(overrides))


def jobs(overrides: Sequence[str]) -> list[Config]:
    """The configuration of each job of a command line whose sweep is written out.

    Raises:
        ConfigError: a value is not allowed (the message names key, file, value and remedy) or given twice, or there are
            no jobs or more than `MAX_JOBS` or `MAX_COMPOSED`.
    """
    parsed = parse(overrides)
    swept = {override.key_or_group: override for override in parsed if override.is_sweep_override()}
    with hydra_errors():
        counts = {key: _count(override) for key, override in swept.items()}
    number = math.prod(counts.values())
    if not 0 < number <= MAX_JOBS:
        values = " x ".join(f"{count} of {key}" for key, count in counts.items())
        raise ConfigError(f"the sweep has {number} jobs ({one_line(values)}); it should have 1 to {MAX_JOBS}.")
    for override in swept.values():
        if twice := [text for text, count in Counter(override.sweep_string_iterator()).items() if count > 1]:
            raise ConfigError(f"{override.input_line} gives {twice[0]} twice; give each value once.")
    assigned = expand(parsed)
    composed = {tuple(each.line for each in job if not each.is_plain) for job in assigned}
    if len(composed) > MAX_COMPOSED:
        raise ConfigError(
            f"the sweep has {len(composed)} combinations of files and of texts with special characters; it should have "
            f"at most {MAX_COMPOSED}."
        )
    checker = Checker()
    return [checker.check(job) for job in assigned]


def swept_values(overrides: Sequence[str]) -> list[dict[str, str]]:
    """For each job of a command line: swept key -> its value."""
    parsed = parse(overrides)
    keys = {override.key_or_group for override in parsed if override.is_sweep_override()}
    lines = [[each.line.lstrip("+").partition("=") for each in job] for job in expand(parsed)]
    return [{key: value for key, _, value in job if key in keys} for job in lines]


def _count(override: Override) -> int:
    """Number of values of a sweep over one key, without writing out a range."""
    values = override.value()
    if isinstance(values, RangeSweep):
        assert values.start is not None and values.stop is not None
        return max(0, math.ceil((values.stop - values.start) / values.step))
    return sum(1 for _ in override.sweep_iterator())
