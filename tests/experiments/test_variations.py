"""The claims of Experiment X, twelve factors: verdicts on tables whose shares are known by construction."""

from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from affmap.control.settings import ControlSettings
from affmap.control.variation import FACTORS, HOME, Task, Variation
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.experiments.exp10_factors.claims import CLAIMS, NUM_FACTORS
from affmap.experiments.exp10_factors.figures import factors, left
from affmap.experiments.exp10_factors.levels import AGENT, BLIND, levels
from affmap.results.claims import Score
from affmap.results.setting import ReportSettings, Setting
from affmap.results.statistics import Verdict

MEMBERS, RUNS = 8, 20
TESTED = [name for name in FACTORS if name != "thrust"]
TEXTS = [HOME, *(f"{factor}/{value}" for factor in TESTED for value in (3, 1, 2))]


def results(blind: float = 0.5, oracle: float = 1.0, texts: list[str] = TEXTS, **changes: float) -> Any:
    """Results with these runs; a change, such as `mass=0.5`, is of the agent at the factor's level 2."""

    def runs(agent: int | str, share: float) -> list[dict[str, Any]]:
        places = {text: changes.get(text.removesuffix("/2"), share) if agent == AGENT else share for text in texts}
        return [
            {"variation": text, "planner": agent if isinstance(agent, str) else "cem", "member": member, "run": run}
            | {"context_size": agent, "success": run < round(RUNS * place) - 2 * (member % 2 and place < 1)}
            for text, place in places.items()
            for member in range(MEMBERS)
            for run in range(RUNS)
        ]

    return SimpleNamespace(
        settings=[Setting({"variation": text}, {}) for text in texts],
        runs=pd.DataFrame([*runs(AGENT, 1.0), *runs(BLIND, blind)]),
        baseline_runs=pd.DataFrame(runs("oracle", oracle)),
    )


def verdicts(found: Any) -> dict[str, Verdict]:
    return {claim.name: Score(claim, tuple(claim.test(found))).verdict for claim in CLAIMS}


def test_the_experiment_has_twelve_factors() -> None:
    """All there are but the thrust, which is the mass where no field pulls."""
    assert len(TESTED) == NUM_FACTORS
    found = levels(results())
    assert list(found) == TESTED
    assert found["mass"] == [Variation(factor="mass", value=value) for value in (1, 2, 3)]


def test_claims_that_were_built_into_the_data_hold() -> None:
    """The parts: a factor each, and one that counts them."""
    parts = {claim.name: claim.test(results()) for claim in CLAIMS}
    assert {name: len(each) for name, each in parts.items()} == {"X-1": 13, "X-2": 12, "X-3": 13, "X-4": 12}
    assert parts["X-1"][0].outcome.effect == 12 and [part.counts for part in parts["X-1"]] == [True] + [False] * 12
    assert set(verdicts(results()).values()) == {Verdict.HOLDS}


@pytest.mark.parametrize(
    ("failing", "expected"),
    [(2, Verdict.HOLDS), (3, Verdict.DOES_NOT_HOLD)],
)
def test_ten_of_twelve_factors_are_enough(failing: int, expected: Verdict) -> None:
    """One bad level is enough to lose a factor; the oracle keeps its own."""
    lost = dict.fromkeys(TESTED[:failing], 0.5)
    found = verdicts(results(**lost))
    assert found["X-1"] == found["X-3"] == expected
    assert found["X-2"] == Verdict.HOLDS


def test_a_factor_that_is_on_the_edge_leaves_the_count_open() -> None:
    """0.95 of the success in half of the members, 0.85 in the others."""
    parts = CLAIMS[0].test(results(mass=0.93, size=0.5, look=0.5))
    by_name = {part.name: part.outcome for part in parts}
    assert by_name["mass"].verdict == Verdict.NOT_DECIDED and by_name["all"].verdict == Verdict.NOT_DECIDED
    assert "left: 1.00 at 1 kg, 0.90 at 2 kg, 1.00 at 3 kg" in by_name["mass"].note
    assert by_name["all"].note == "do not hold: 2, not decided: 1"


def test_what_even_the_oracle_loses_is_not_held_against_the_agent() -> None:
    """At every level both succeed in half of the runs that they do at home."""
    found = results(**dict.fromkeys(TESTED, 0.5))
    found.baseline_runs = results(texts=TEXTS).runs.query("context_size == 8").assign(planner="oracle")
    found.baseline_runs["success"] = found.runs.query("context_size == 8")["success"].to_numpy()
    verdict = verdicts(found)
    assert verdict["X-1"] == verdict["X-2"] == Verdict.DOES_NOT_HOLD and verdict["X-3"] == Verdict.HOLDS


def test_codes_that_do_not_help_are_found_out() -> None:
    assert verdicts(results(blind=1.0))["X-4"] != Verdict.HOLDS


def test_a_part_of_the_sweep_leaves_claims_untested() -> None:
    """Two factors cannot be ten; nothing varied, or no oracle, is nothing to test."""
    assert verdicts(results(texts=TEXTS[:7]))["X-1"] == Verdict.NOT_DECIDED
    assert set(verdicts(results(texts=[HOME])).values()) == {Verdict.NOT_TESTED}
    found = results()
    found.baseline_runs = found.baseline_runs.iloc[:0]
    assert verdicts(found)["X-2"] == verdicts(found)["X-3"] == Verdict.NOT_TESTED


def texts(drawn: Any) -> list[str]:
    """What is written in a figure."""
    return [each.get_text() for ax in drawn.figure.axes for each in (*ax.texts, *ax.get_yticklabels(), ax.title)]


def test_figures_show_levels_around_home(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ranges that are kept end before the first level that is not, and begin at home where home is the smallest value:
    of the mass, at home 0.1 kg, 1 kg is kept and 2 kg is not."""
    files = (("layout", "original", Layout), ("vehicle", "default", Vehicle), ("control", "default", ControlSettings))
    task = Task(*(kind.load(group, name) for group, name, kind in files))
    for module in (factors, left):
        monkeypatch.setattr(module, "home_task", lambda results: task)
    settings = ReportSettings.load("report", "default")
    found = results(mass=0.5, number=0.5)
    table = texts(left.draw(found, settings))
    assert {"0.1 to 1 kg", "3 to 6", "0 to 3 u", "1 to 3 times", "1 to 33.3 ms"} <= set(table)
    assert "0.45 (1.00)" in table and table.count("1.00 (1.00)") == 34
    panels = factors.draw(found, settings)
    assert panels is not None and len(panels.figure.axes) == NUM_FACTORS
    (mass,) = (ax for ax in panels.figure.axes if ax.get_title(loc="left") == "mass (kg)")
    assert [label.get_text() for label in mass.get_xticklabels()] == ["0.1", "1", "2", "3"]
    assert [label.get_fontweight() for label in mass.get_xticklabels()] == ["bold", *["normal"] * 3]
    lines = [line.get_ydata() for line in mass.lines]
    kept = [0.9, 0.9]  # of the agent's success at home
    assert lines == [pytest.approx(share) for share in ([1, 1, 1, 1], [1, 1, 0.45, 1], [0.45] * 4, kept)]


def test_there_is_no_figure_where_nothing_is_varied() -> None:
    settings = ReportSettings.load("report", "default")
    assert factors.draw(results(texts=[HOME]), settings) is None
    assert left.draw(results(texts=[HOME]), settings) is None
