"""The claims of Experiment I, obstacle avoidance. EB: evolutionary-based, GB: gradient-based planning."""

from functools import partial

from affmap.experiments import encoding
from affmap.results import claims
from affmap.results.claims import Claim, Contrast, Criterion, Pair
from affmap.results.setting import short_name
from affmap.results.statistics import Direction, Order
from affmap.results.tables import Results


def _control(results: Results, planner: str, metric: str, direction: Direction) -> list[Criterion]:
    return [claims.trend(claims.select_runs(results, planner=planner), metric, direction, short_name(planner))]


def _without_context(results: Results) -> list[Criterion]:
    runs = results.runs.query("context_size == 0")
    outcome = claims.paired(runs, "mean_distance", Pair("planner", "gradient", "cem"), "lower")
    return [Criterion("", "GB minus EB at C = 0", "u", outcome)]


def _with_context(results: Results) -> list[Criterion]:
    runs = results.runs.query("context_size > 0")
    outcome = claims.paired(runs, "mean_distance", Pair("planner", "cem", "gradient"), "lower")
    return [Criterion("", "EB minus GB, mean over C > 0", "u", outcome)]


def _encoding(results: Results) -> list[Criterion]:
    maps = claims.largest_maps(results)
    criteria: list[Criterion] = []
    for name, (statement, effect_of, contrast, order) in _CONTRASTS.items():
        criteria += claims.encoded(maps, contrast, order, name, effect_of, statement)
    return criteria


_CONTRASTS: dict[str, tuple[str, str, Contrast, Order]] = {
    "a": (
        "Codes beside a surface are farther from the free-space code than codes elsewhere.",
        "distance to the free-space code, beside minus elsewhere",
        encoding.obstacle_contrast,
        "higher",
    ),
    "b": (
        "Codes beside an obstacle's side are nearer to those beside the border side that blocks the same direction.",
        "distance to the matching minus to the other border sides",
        encoding.side_match,
        "lower",
    ),
}

CLAIMS = (
    Claim("I-1", "The validation loss falls with the context size.", claims.loss_falls),
    Claim(
        "I-2",
        "EB: the prediction error falls with the context size.",
        partial(_control, planner="cem", metric="prediction_error", direction="falls"),
    ),
    Claim(
        "I-3",
        "EB: the mean distance falls with the context size.",
        partial(_control, planner="cem", metric="mean_distance", direction="falls"),
    ),
    Claim(
        "I-4",
        "GB: the prediction error falls with the context size.",
        partial(_control, planner="gradient", metric="prediction_error", direction="falls"),
    ),
    Claim(
        "I-5",
        "GB: the mean distance rises with the context size.",
        partial(_control, planner="gradient", metric="mean_distance", direction="rises"),
    ),
    Claim("I-6", "Without a context, GB comes closer to the goal than EB.", _without_context),
    Claim("I-7", "With a context, EB comes closer to the goal than GB.", _with_context),
    Claim(
        "I-8",
        "The map encodes obstacles unlike free space, and their sides like the matching sides of the border.",
        _encoding,
    ),
)
