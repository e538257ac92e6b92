"""How a sweep stands: what is complete, running, failed, missing, with the time spent and left. Runs nothing."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import mean
from typing import NamedTuple

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from affmap.config import Config
from affmap.stage import Stage
from affmap.stages import stages
from affmap.store import State
from affmap.sweep import Sweep

COLORS = {"complete": "green", "running": "cyan", "failed": "red", "damaged": "red", "stopped": "yellow"}

REASONS = {
    "running": "another job works on it",
    "stopped": "its process ended in the middle; was it killed, perhaps for lack of memory?",
    "missing": "it was not begun",
}
"""Why a stage is not complete, where it has no error to tell."""


class Part(NamedTuple):
    """A stage of a setting."""

    name: str
    digest: str
    state: State


class Setting(NamedTuple):
    """One job of a sweep."""

    label: str
    parts: tuple[Part, ...]

    @property
    def current(self) -> Part | None:
        """The first stage that is not complete; None where all are."""
        return next((part for part in self.parts if part.state.name != "complete"), None)

    @property
    def state(self) -> str:
        """How the setting stands."""
        return self.current.state.name if self.current else "complete"


def settings(asked: Sweep, check: bool = False) -> list[Setting]:
    """How each job of a sweep stands; `check` looks at every file of what is complete, once though jobs share it."""
    known: dict[str, Part] = {}
    return [
        Setting(label, tuple(_part(stage, config, check, known) for stage in stages(config)))
        for config, label in zip(asked.configs, asked.labels, strict=True)
    ]


def _part(stage: Stage, config: Config, check: bool, known: dict[str, Part]) -> Part:
    if stage.digest not in known:
        known[stage.digest] = Part(stage.name, stage.digest, config.open_store().state(stage, check))
    return known[stage.digest]


def failures(found: Iterable[Setting]) -> list[str]:
    """A line or two on each setting that is not complete: why, and where its log is."""
    return [_failure(setting.label, setting.current.state) for setting in found if setting.current]


def _failure(label: str, state: State) -> str:
    log = f"\n    log: {shown(Path(state.log))}" if state.log else ""
    return f"{label}: {state.error or REASONS[state.name]}{log}"


MAX_ROWS = 50
"""Of a table that shows all settings; longer ones leave out those that are complete or missing."""


def table(found: Sequence[Setting]) -> Table:
    """One row a setting: its state, the stage that it is at, the time spent and left.

    Of many settings only those that are running, have stopped or failed.
    """
    expected = _typical(found)
    listed = [each for each in found if len(found) <= MAX_ROWS or each.state not in ("complete", "missing")]
    rows = Table("setting", "state", "stage", box=SIMPLE_HEAD, pad_edge=False)
    rows.add_column("spent", justify="right")
    rows.add_column("left", justify="right")
    for setting in listed:
        current = setting.current
        rows.add_row(
            setting.label,
            Text(setting.state, COLORS.get(setting.state, "")),
            _stage(current) if current else "",
            duration(sum(part.state.seconds for part in setting.parts)),
            duration(_left(setting.parts, expected)) if current else "",
        )
    return rows


def _stage(part: Part) -> str:
    return f"{part.name} {part.state.finished}/{part.state.total}" if part.state.total else part.name


def summary(found: Sequence[Setting]) -> str:
    """How many settings are in which state, and what all together took and will take."""
    counts = Counter(setting.state for setting in found)
    rest = [f"{count} {name}" for name, count in counts.items() if name != "complete"]
    parts = _distinct(found)
    time = f"{duration(sum(part.state.seconds for part in parts))} spent"
    if rest:
        time += f", {duration(_left(parts, _typical(found)))} left, one job at a time"
    return ", ".join([f"{counts['complete']} of {len(found)} settings complete", *rest]) + f"; {time}"


def _distinct(found: Sequence[Setting]) -> list[Part]:
    """All stages, once each: settings share some."""
    return list({(part.name, part.digest): part for setting in found for part in setting.parts}.values())


def _typical(found: Sequence[Setting]) -> dict[str, float]:
    """Stage name -> mean seconds of those that are complete."""
    seconds = defaultdict(list)
    for part in _distinct(found):
        if part.state.name == "complete":
            seconds[part.name].append(part.state.seconds)
    return {name: mean(values) for name, values in seconds.items()}


def _left(parts: Sequence[Part], expected: dict[str, float]) -> float | None:
    """Seconds that stages still take: as they go now, or as others of their kind; None where nothing tells."""
    total = 0.0
    for part in parts:
        if part.state.name == "complete":
            continue
        left = part.state.seconds_left
        if left is None:
            if part.name not in expected:
                return None
            left = max(expected[part.name] - part.state.seconds, 0.0)
        total += left
    return total


def duration(seconds: float | None) -> str:
    """Hours, minutes and seconds; a question mark where it is not known."""
    if seconds is None:
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def shown(path: Path) -> Path:
    """A path as seen from here, where it is below."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
