"""Jobs whose differences are filled in have the configurations that Hydra composes, one by one."""

import random
from collections.abc import Callable
from typing import Any

import pytest

from affmap.config import compose, jobs
from affmap.config.overrides import parse
from affmap.config.root import Config
from affmap.results.provenance import leaves
from affmap.settings import ConfigError, folder

LINES = ["seed=0"] + [
    f"{group}={path.relative_to(folder() / group).with_suffix('')}"
    for group in ("experiment", "search")
    for path in sorted(folder().glob(f"{group}/**/*.yaml"))
]
CHOICES = {
    "planner": ["cem", "gradient"],
    "lookup": ["map", "exact"],
    "agent": ["planner", "random", "straight", "oracle", "true_mean"],
    "scale": ["full", "smoke"],
    "models": ["train", "reference"],
    "logger": ["csv", "tensorboard"],
    "versions": ["same", "any"],
    "acts": ["null", "center", "rim"],
    "baselines": ["[]", "[oracle]", "[straight,random]"],
    "world": ["original", "fog", "three_looks"],
    "control_layout": ["original", "two_obstacles", "procedural_crowded_easy"],
    "map_layout": ["original", "four_properties", "two_obstacles"],
    "training_layouts": ["[original]", "[two_obstacles,original]"],
    "output": ["/absolute/here", "elsewhere/of/${name}", "runs/${world}"],
}
STRANGE = [
    "-1",
    "nan",
    "1e-5",
    "1.0",
    "true",
    "null",
    "???",
    "'1'",
    "'a b'",
    "a\\,b",
    "${seed}",
    "[1]",
    "{a: 1}",
    "9" * 30,
]


def values_of(key: str, value: Any, draw: random.Random) -> list[str]:
    """Two values of a key, which has one now."""
    if draw.random() < 0.03:
        return draw.sample(STRANGE, 2)
    if key in CHOICES:
        return [str(value) if isinstance(value, str) else CHOICES[key][0], draw.choice(CHOICES[key])]
    if isinstance(value, bool):
        return ["true", "false"]
    if isinstance(value, (int, float)):
        return [str(value), str(type(value)(value * draw.uniform(0.9, 1.1)))]
    if key in ("name", "title", "notice"):
        return [f"another_{key}", "a" * draw.randrange(1, 9)]
    return 2 * ["null" if value is None else str(value).replace(" ", "")]


def outcome(check: Callable[[Any], Config], job: Any) -> str:
    """All values of a configuration, with their types, or what is wrong with it."""
    try:
        return repr(check(job).complete())
    except ConfigError as error:
        return str(error)


@pytest.mark.parametrize("line", LINES)
def test_a_job_has_the_configuration_that_hydra_composes(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand random values, groups and wrong ones among them, beside Hydra itself; most are really filled in."""
    alone: list[Any] = []
    monkeypatch.setattr(jobs, "check", lambda lines: alone.append(lines) or compose.check(lines))
    draw = random.Random(line)
    written = compose.values(compose.compose([line]))
    first = {key: str(values).split(",")[0] for key, values in written["sweep"].items()}
    known = leaves(written)
    keys = sorted(key for key in {**known, **dict.fromkeys(CHOICES)} if not key.startswith(("sweep", "report.")))
    checked = 0
    for _ in range(9):
        swept = draw.sample(keys, 8)
        values = first | {key: ",".join(values_of(key, known.get(key), draw)) for key in swept}
        expanded = jobs.expand(parse([line, *(f"{key}={value}" for key, value in values.items())]))
        assert len(expanded) == 2 ** len(swept)
        checker = jobs.Checker()
        for job in draw.sample(expanded, 3):
            lines = [each.line for each in job]
            assert outcome(checker.check, job) == outcome(compose.check, lines), lines
            checked += 1
    assert len(alone) < checked


@pytest.mark.parametrize(
    ("overrides", "compositions"),
    [
        (["seed=range(0,50)", "members=1"], 1),
        (["planner=cem,gradient", "model.context_size=0,1,3", "seed=0,1"], 2),
        (["experiment=exp2", "world=fog,original", "title=a,b,c"], 1),  # the three layouts follow from the world
        (["members=1,2", "members=3,4"], 2),  # the same key again
        (["planner=cem,gradient", "planner.horizon=10,20", "lookup=map,exact"], 4),
        (["training_layouts=[fog],[original]", "world=fog,original"], 2),
        (["agent.kind=planner,random", "seed=range(0,3)"], 1),  # folders of jobs are named by it
        (["++seed=0,1", "members=1,2"], 2),
        (["title='a b','$'"], 2),
    ],
)
def test_hydra_composes_once_for_each_choice_of_groups(
    overrides: list[str], compositions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Counted by hand; beside groups, only what is no plain value is composed by itself."""
    composed: list[Any] = []
    monkeypatch.setattr(jobs, "compose", lambda lines: composed.append(lines) or compose.compose(lines))
    checker = jobs.Checker()
    for job in jobs.expand(parse(overrides)):
        outcome(checker.check, job)
    assert len(composed) == compositions


def test_a_rule_of_one_job_is_not_that_of_the_next() -> None:
    """Layouts of a sweep over `acts`, whose rule is written into layouts, beside each job alone; both orders."""
    for values in ("rim,null", "null,rim", "rim,center,null"):
        checker = jobs.Checker()
        for job in jobs.expand(
            parse(["experiment=exp5", "planner=cem", "control_layout=procedural_easy", f"acts={values}"])
        ):
            alone = compose.check([each.line for each in job])
            assert checker.check(job).training_layouts == alone.training_layouts
            assert checker.check(job).control_layout == alone.control_layout
