"""What is written below figures. What states a result is made from the results: no verdict and no number is here."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from affmap.env.body import NUM_DEVIATIONS
from affmap.env.geometry import CELL
from affmap.report.drawing.colors import make_groups, name_of, readable
from affmap.report.figures import pictures
from affmap.report.figures.numbers import shown_outcomes
from affmap.report.sentences import verdicts
from affmap.results import examples, failures
from affmap.results.claims import Score
from affmap.results.examples import MAX_ROWS
from affmap.results.metrics import METRICS
from affmap.results.numbers import listed, number, span
from affmap.results.setting import CONTEXT_SIZE, PLANNERS, ReportSettings, Value, short_name
from affmap.results.tables import Results

PAPER_FIGURES = {"exp1": 4, "exp2": 7, "exp3": 9, "exp4": 10, "exp5": 11}
"""Experiment of the paper -> number of its main figure."""

_BOXES = (
    "Boxes: median and quartiles; whiskers end at the last point within 1.5 interquartile ranges, points beyond are "
    "not drawn."
)
_COLORS = (
    "Channels are principal components, fitted to the positions that the vehicle can reach; constant ones are a "
    "neutral grey, so a context size of 1 or 2 uses fewer colours. What differs little may be invisible in three "
    "components."
)


def captions(results: Results, scores: Sequence[Score], settings: ReportSettings) -> dict[str, str]:
    """Name of a figure -> its caption, for every figure that there may be."""
    return {
        "results": _results(results, scores, settings),
        "trajectories": _trajectories(results, settings),
        "maps": _maps(results, settings),
        "growth": (
            f"{'As the paper’s Figure 12 (appendix). ' if settings.claims == 'exp3' else ''}"
            "The affordance map of one member after different numbers of epochs of a longer training, in one basis: "
            f"colours can be compared between the panels. {_COLORS}"
        ),
        "world": _world(results, settings),
        "exploration": _exploration(results, settings),
        "steps": (
            "Validation losses by kind of step. Above: at the end of training, the median step and the mean of all "
            "steps; points: median over members, lines: quartiles. Below: what each kind of step adds to the mean "
            "loss in the course of training, and all together (dotted); medians over members, at the epochs whose "
            "weights were kept."
        ),
        "outcomes": _outcomes(results, settings),
        "failures": _failures(results, settings),
    }


def _world(results: Results, settings: ReportSettings) -> str:
    shown = pictures.shown_worlds(results, settings).values()
    acts = {world.acts for world in shown if any(circle.effect not in ("obstacle", "none") for circle in world.circles)}
    where = {"center": "where its centre is inside", "rim": "as soon as it overlaps them"}
    terrains = f" Fog and force fields act on it {' or '.join(where[each] for each in sorted(acts))}." if acts else ""
    return (
        "The worlds: circles by what they do, borders (frame), the squares that starts and goals are drawn from "
        f"(red, dashed), and the vehicle to scale (green).{terrains} Where every run has a world of its own, those of "
        f"the first {pictures.NUM_WORLDS} runs are shown."
    )


def _results(results: Results, scores: Sequence[Score], settings: ReportSettings) -> str:
    parts = [f"As the paper's Figure {PAPER_FIGURES[settings.claims]}."] if settings.claims else []
    size = pictures.map_size(results)
    member = results.runs["member"].min()
    if worlds := pictures.several_worlds(results)[:2]:
        names = listed([readable(part.world.name, settings) for part in worlds])
        parts.append(
            f"(A, B) Affordance maps of member {member} at C = {size} in the worlds {names}, in one basis: equal "
            "colours are equal codes. The models are the same in all worlds."
        )
    else:
        members = results.last_epoch["member"].nunique()
        parts.append(
            f"(A) Validation loss: mean and standard deviation (shade) over {members} members; where the axis cuts off "
            "a curve, it says so."
        )
        code = "(B) The largest context size is 0, so there is no map."
        if size:
            part = pictures.painted(results, size)[-1]
            world = readable(part.world.name, settings)
            code = (
                f"(B) Affordance map of member {member} at C = {size} in the world “{world}”: the context code at each "
                "position, three principal components as red, green and blue, circles outlined."
            )
        parts.append(code)
    parts.append(f"(C) Prediction error in control, {_per_box(results, settings)} runs a box. {_BOXES}")
    if settings.outcome == "success":
        parts.append(
            "(D) Share of successful runs, which reach the goal and are never in fog: mean over members, black lines: "
            "standard deviation over members."
        )
    else:
        parts.append("(D) Mean distance to the goal in control.")
    if results.baselines:
        parts.append(
            "Dashed and dotted lines: agents without a learned model in the same runs; the oracle has true physics."
        )
    if len(results.planners) > 1:
        methods = [f"{short_name(kind)}: {PLANNERS[kind].method}" for kind in results.planners if kind in PLANNERS]
        parts.append(f"{', '.join(methods)}." if methods else "")
    if settings.axes:
        parts.append("Grey dotted lines: lowest and highest tick of the paper's axis, where it is in view.")
    if scores:
        parts.append(f"Claims: {verdicts(scores)}.")
    return " ".join(filter(None, parts))


def _per_box(results: Results, settings: ReportSettings) -> str:
    return span(results.runs.groupby([results.x.column, make_groups(results, settings).column]).size())


def _trajectories(results: Results, settings: ReportSettings) -> str:
    stories = []
    fog = any(failures.has_fog(results, job) for job in results.settings)
    rows = examples.rows(results)
    for values in rows:
        where = f"{pictures.row_name(results, values, settings)}, " if len(rows) > 1 else ""
        for example in examples.choose_examples(results, values):
            value = name_of(results.x, example.setting.values[results.x.key], settings)
            run = _row(results, example)
            end = (
                f"reaches the goal after {run['steps_to_reach']} steps" if run["reached"] else "never reaches the goal"
            )
            in_fog = f", is in fog in {run['steps_in_fog']}" if fog else ""
            stories.append(
                f"{where}{value} (member {example.member}, run {example.run}): touches a "
                f"surface in {run['steps_touching']} steps{in_fog}, {end}, mean distance "
                f"{number(run['mean_distance'])} u"
            )
    noise = " Inside fog a plan starts at the noisy position that the vehicle reports." if fog else ""
    planner = results.planners[0]
    circles = (
        f" Blue circles: {NUM_DEVIATIONS} standard deviations of the predicted positions along the plan."
        if results.runs["prediction_error"].notna().any()
        else ""
    )
    kind = f"with {PLANNERS[planner].method} planning" if planner in PLANNERS else f"by “{planner}”"
    paper = "As the paper's Figure 5. " if settings.claims == "exp1" else ""
    return (
        f"{paper}One moment of a run {kind}. Runs were not picked by hand, but by a rule: "
        f"{examples.example_rule(results)}. {'; '.join(stories)}.{circles} Numbers are those of whole runs.{noise}"
    )


def _row(results: Results, example: examples.Example) -> "pd.Series[Any]":
    """The row of an example in the table of runs."""
    keys: dict[str, Value] = {"member": example.member, "run": example.run}
    keys |= {factor.column: example.setting.values[factor.key] for factor in results.factors}
    chosen = np.all([results.runs[key] == value for key, value in keys.items()], axis=0)
    return results.runs[chosen].iloc[0]


def _maps(results: Results, settings: ReportSettings) -> str:
    size = pictures.map_size(results)
    parts = pictures.painted(results, size) if size else []
    trainings = len({part.setting.train for part in parts})
    basis = "Every map has its own colours: they can be compared within a map, not between maps"
    if trainings < len(parts):
        basis = "Maps of one member in several worlds share their colours; others cannot be compared"
    each = f", and of one member at each {results.x.label}" if results.x == CONTEXT_SIZE or len(parts) > 1 else ""
    return (
        f"Affordance maps of several members at context size {size}{each}. {basis}, "
        f"because codes of different members and sizes mean different things. {_COLORS}"
    )


def _exploration(results: Results, settings: ReportSettings) -> str:
    parts = pictures.explored(results)
    covered = [f"{coverage:.1%} in {readable(world.name, settings)}" for _, _, coverage, world in parts]
    total = sum(int(counts.sum()) for counts, _, _, _ in parts)
    return (
        f"Where the data have been, validation included: {total} recorded positions in total. Of the cells whose "
        f"centre is free, {listed(covered)} were visited; free cells without a visit are red."
    )


def _outcomes(results: Results, settings: ReportSettings) -> str:
    groups = make_groups(results, settings)
    shares = results.runs.groupby([groups.column, results.x.column], sort=False)["reached"].mean()
    parts = []
    for value, name in groups.names.items():
        values = shares[value]
        first, last = values.index[0], values.index[-1]
        ends = [f"{values[value]:.0%} of the runs at {name_of(results.x, value, settings)}" for value in (first, last)]
        parts.append(f"{name} {' and '.join(dict.fromkeys(ends))}")
    letters = zip("CDEFGHIJKLMNOPQRSTUVWXYZ", shown_outcomes(settings), strict=False)
    more = "".join(f" ({letter}) {METRICS[metric].label.capitalize()}." for letter, metric in letters)
    return (
        "(A) Share of runs that reached the goal, whatever they touched, with 95 % bootstrap intervals over members: "
        f"{'; '.join(parts)}. (B) Steps of a run in which the vehicle touched an obstacle or a border.{more} The paper "
        "does not report these."
    )


def _failures(results: Results, settings: ReportSettings) -> str:
    contexts = "above 0" if max(results.context_sizes) > 0 else "0"
    if any(len(set(results.worlds(job))) > 1 for job in results.settings):
        others = (
            "Second: of the runs that never arrived, whether they were in fog or not, what the vehicle was nearest to "
            "at its end, or deepest inside of. Third: median prediction error of single steps, by the number of "
            "circles that acted on the vehicle (training has no place with more than one); steps in fog are left "
            "out, because there the reported positions are noise."
        )
    else:
        others = (
            f"Second and third: where runs with a context size {contexts} first entered fog, and where those that "
            "never arrived were at their end (their numbers in brackets; a run may be in both), in runs per cell of "
            f"{CELL} u where there are many."
        )
    if any(failures.has_fog(results, job) for job in results.settings):
        others += " Last: how far from fog runs that never arrived were at their end (u; dashed: its edge)."
    names = make_groups(results, settings).names.values()
    some = f" Rows: {listed(list(names)[:MAX_ROWS])} only." if len(names) > MAX_ROWS else ""
    return (
        "Left: share of the runs that failed, by reason. A run that was in fog counts as such, whether it arrived or "
        f"not; stuck: in its last quarter a run stays within a vehicle's diameter of its mean place. {others}{some} "
        "The paper does not report these."
    )
