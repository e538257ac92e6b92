"""Agents that learn online: what they predict and where they have been, by the steps that they have made."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure

from affmap.env.layout import Layout
from affmap.report.drawing import arena
from affmap.report.drawing.colors import names_of, x_colors
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.files import Experience, Floats
from affmap.results.metrics import METRICS
from affmap.results.numbers import listed
from affmap.results.setting import LEARNING, Factor, ReportSettings, Value
from affmap.results.tables import Results

EARLIER = (0.1, 0.4)
"""Shares of the rounds after which the places of an agent are drawn, besides all of them."""

LINEAR = 10.0
"""Losses (nats) beyond which the axis is logarithmic."""

BEGIN = 0.1
"""Share of the rounds, the first, whose losses may be cut off."""


class Kind(NamedTuple):
    """A kind of learning."""

    name: str
    """For readers."""
    color: str
    losses: Floats
    """Validation loss after each epoch, `[E, M]` in nats."""
    layouts: Sequence[Layout]
    """Of the experience."""
    experience: Experience | None
    """None where models learn offline."""


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None if no agent learned online."""
    kinds = _kinds(results, settings)
    online = [kind for kind in kinds if kind.experience]
    if not online:
        return None
    last = min(len(kind.losses) for kind in online)
    rounds = sorted({math.ceil(share * last) for share in (*EARLIER, 1)})
    figure = new_figure(3.0 + 1.2 * len(rounds))
    above, below = figure.subfigures(2, 1, height_ratios=(2.4, 0.6 + 1.2 * len(rounds)), squeeze=False)[:, 0]
    losses, coverage, share = above.subplots(1, 3)
    _losses(losses, kinds)
    _shares(coverage, online, [kind.experience.coverage for kind in online if kind.experience])
    coverage.set(ylabel="share of free cells", ylim=(0, 1))
    coverage.set_title("B  Coverage", loc="left")
    foggy = [["fog" in layout.effects for layout in kind.layouts] for kind in online]
    has_fog = any(each for layouts in foggy for each in layouts)
    goals = [1000 * kind.experience.goals for kind in online if kind.experience and kind.experience.goals is not None]
    if goals:
        _shares(share, online, goals)
    elif has_fog:
        _shares(share, online, [kind.experience.in_fog for kind in online if kind.experience], foggy)
    else:
        _shares(share, online, [kind.experience.touching for kind in online if kind.experience])
    share.set(ylabel="goals per 1,000 steps" if goals else "share of steps", ylim=(0, None))
    share.set_title("C  " + ("Goals reached" if goals else "In fog" if has_fog else "Touching a surface"), loc="left")
    above.legend(*losses.get_legend_handles_labels(), loc="outside lower center", ncols=len(kinds), frameon=False)
    _places(below, online, rounds)
    return Drawn(figure, _caption(kinds, has_fog, bool(goals)))


def _kinds(results: Results, settings: ReportSettings) -> list[Kind]:
    """The kinds of learning of a report, in its order; where there is one, those of the x axis."""
    learned = results.validation.get(LEARNING.column)
    factor = results.training_factor if learned is None or learned.nunique() == 1 else LEARNING
    values = list(dict.fromkeys(each.values[factor.key] for each in results.settings))
    colors, names = x_colors(factor, values), names_of(factor, values, settings)
    return [_kind(results, factor, value, names[value], colors[value]) for value in values]


def _kind(results: Results, factor: Factor, value: Value, name: str, color: str) -> Kind:
    setting = results.where({factor.key: value})[0]
    table = results.validation
    own = table[table[factor.column] == value].drop_duplicates(["member", "epoch"])
    losses = own.pivot(index="epoch", columns="member", values="validation_nll").to_numpy()
    return Kind(name, color, losses, results.training_layouts(setting), results.experience(setting))


def _losses(ax: Axes, kinds: Sequence[Kind]) -> None:
    """Draw median and quartiles of the members by steps; of a training offline, the median at its end."""
    for kind in kinds:
        low, middle, high = np.quantile(kind.losses, [0.25, 0.5, 0.75], axis=1)
        if kind.experience:
            ax.plot(kind.experience.steps, middle, color=kind.color, label=kind.name, lw=1.3)
            ax.fill_between(kind.experience.steps, low, high, color=kind.color, alpha=0.18, lw=0)
        else:
            ax.axhline(middle[-1], color=kind.color, label=kind.name, lw=1.3, ls=(0, (4, 2)))
    later = np.concatenate([np.median(kind.losses, axis=1)[math.ceil(BEGIN * len(kind.losses)) :] for kind in kinds])
    low, high = later.min(), later.max()
    if high > LINEAR:
        ax.set_yscale("symlog", linthresh=LINEAR)
    elif high > low:
        ax.set_ylim(low - 0.1 * (high - low), min(ax.get_ylim()[1], high + 0.5 * (high - low)))
    ax.set(xlabel="steps of an agent", ylabel=METRICS["validation_nll"].label)
    ax.set_title("A  Validation loss", loc="left")


def _shares(
    ax: Axes, online: Sequence[Kind], shares: Sequence[Floats], where: Sequence[Sequence[bool]] | None = None
) -> None:
    """Draw mean and standard deviation over agents of shares `[A, R]`.

    With `where`, one value for each layout of a kind, rounds in the other layouts are left out.
    """
    for kind, share, chosen in zip(online, shares, where or [[True]] * len(online), strict=True):
        if kind.experience:
            rounds = np.resize(chosen, share.shape[1])
            mean, std, steps = share.mean(0)[rounds], share.std(0)[rounds], kind.experience.steps[rounds]
            ax.plot(steps, mean, color=kind.color, lw=1.3)
            ax.fill_between(steps, np.maximum(mean - std, 0), mean + std, color=kind.color, alpha=0.18, lw=0)
    ax.set_xlabel("steps of an agent")


def _places(panel: SubFigure, online: Sequence[Kind], rounds: Sequence[int]) -> None:
    """Draw the places that the first agent of each kind had visited in the first layout, time from top to bottom."""
    grid = panel.subplots(len(rounds), len(online), sharex=True, sharey=True, squeeze=False)
    parts = [(kind, kind.experience, _visits(kind.experience)) for kind in online if kind.experience]
    most = max(2, *(int(visits[-1].max()) for _, _, visits in parts))
    for column, (kind, experience, visits) in zip(grid.T, parts, strict=True):
        for ax, number in zip(column, rounds, strict=True):
            image = arena.visit_image(ax, visits[number - 1], experience.free[0], kind.layouts[0], most)
            ax.set_title(kind.name if number == rounds[0] else "", loc="left")
            ax.set_ylabel(f"{experience.steps[number - 1]:,} steps\ny (u)")
            ax.label_outer()
    panel.colorbar(image, ax=grid, location="bottom", label=arena.VISITS, fraction=0.05, aspect=50, shrink=0.6)


def _visits(experience: Experience) -> Floats:
    """Visits of the first agent to the cells of the first layout by the end of each round, `[R, Y, X]`."""
    counts = experience.counts[0].copy()
    counts[np.arange(len(counts)) % len(experience.free) > 0] = 0
    return counts.cumsum(0)


def _caption(kinds: Sequence[Kind], has_fog: bool, has_goals: bool) -> str:
    offline = [kind.name for kind in kinds if not kind.experience]
    dashed = f"; dashed: {listed(offline)}, at the end of the training" if offline else ""
    several = max(len(kind.layouts) for kind in kinds) > 1
    share = "was in fog" if has_fog else "touched an obstacle or a border"
    rounds = "a round in a world with fog" if has_fog and several else "a round"
    where = " in the first layout" if several else ""
    third = f"share of the steps of {rounds} at whose end it {share}"
    if has_goals:
        third = "goals that it reached in a round, by 1,000 steps"
    return (
        "Agents that learn online, by the steps that they have made. A: validation loss, median and quartiles over "
        f"models{dashed}. B: share of the free cells that an agent has visited, and C: {third}, mean and standard "
        f"deviation over agents. Below: the places that the first agent of each kind had visited{where}, and how "
        "often; free cells that it had not are red."
    )
