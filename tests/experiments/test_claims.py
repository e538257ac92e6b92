"""Reference: synthetic stages whose structure is written by hand, so each verdict is known before it is computed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.experiments import claims_about, encoding
from affmap.experiments.exp4 import claims as experiment4
from affmap.experiments.exp5 import claims as experiment5
from affmap.results import claims, scores
from affmap.results.claims import Score
from affmap.results.files import Maps
from affmap.results.setting import STAGES, ReportSettings, Setting, make_factor
from affmap.results.statistics import Verdict
from affmap.results.tables import Results

WriteStages = Callable[..., list[Setting]]
WriteGrowth = Callable[..., Setting]
EXPERIMENTS = ("exp1", "exp2", "exp3", "exp4", "exp5")
HOLDS, DOES_NOT_HOLD, NOT_DECIDED, NOT_TESTED = Verdict


@pytest.fixture(scope="module")
def stages(
    write_stages: WriteStages, write_growth: WriteGrowth, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Results]:
    """Experiment -> results in which all of its claims hold; written once, not to be changed."""
    root = tmp_path_factory.mktemp("stages")
    growth = {"exp3": write_growth(root)}
    return {name: Results(tuple(write_stages(root, experiment=name)), growth.get(name)) for name in EXPERIMENTS}


@pytest.fixture
def fresh(stages: dict[str, Results]) -> Callable[[str], Results]:
    """Results of an experiment that a test may change."""
    return lambda name: Results(stages[name].settings, stages[name].growth)


Fresh = Callable[[str], Results]


def verdicts(results: Results, experiment: str) -> dict[str, Verdict]:
    return {score.claim.name: score.verdict for score in scores.score(results, claims_about(experiment))}


def parts(results: Results, experiment: str, claim: str) -> dict[str, dict[str, Any]]:
    """Part of a claim -> its row of the table."""
    (tested,) = [item for item in claims_about(experiment) if item.name == claim]
    table = scores.as_table([Score(tested, tuple(tested.test(results)))])
    return {row["part"]: row for row in table.to_dict("records")}


def settings(**changes: Any) -> ReportSettings:
    values: dict[str, Any] = {
        "map_spacing": 0.02,
        "snapshots": False,
        "compare": None,
        "partial": False,
        "claims": None,
        "names": {},
        "outcome": "mean_distance",
        "axes": {"validation_nll": (-10, -8), "prediction_error": (-12, -8), "mean_distance": (0.4, 1.2)},
    }
    return ReportSettings(**values | changes)


def test_claims_that_were_built_into_the_data_hold(stages: dict[str, Results]) -> None:
    found = {
        name: verdict
        for experiment in EXPERIMENTS
        for name, verdict in verdicts(stages[experiment], experiment).items()
    }
    counts = {"I": 8, "II": 3, "III": 3, "IV": 4, "V": 5}
    assert found == {f"{numeral}-{index + 1}": HOLDS for numeral, count in counts.items() for index in range(count)}


def test_an_experiment_that_the_paper_does_not_have_has_no_claims(stages: dict[str, Results]) -> None:
    assert scores.score(stages["exp1"], claims_about(None)) == []
    table = scores.as_table([])
    assert (len(table), tuple(table)) == (0, scores.COLUMNS)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_test_says_what_it_is(stages: dict[str, Results], experiment: str) -> None:
    """No part is unnamed or unexplained where a claim has several; numbers are there or the note says why not."""
    found = scores.score(stages[experiment], claims_about(experiment))
    for score in found:
        names = [part.name for part in score.parts]
        assert len(set(names)) == len(names)
        assert len(names) == 1 or all(part.name and part.statement for part in score.parts)
    table = scores.as_table(found)
    assert table[["test", "effect_of", "unit"]].ne("").all(axis=None)
    assert table[["effect", "low", "high"]].notna().all(axis=None)
    assert (table["p"].notna() | table["test"].str.startswith("95 % interval")).all()


@pytest.mark.parametrize("experiment", EXPERIMENTS)
@pytest.mark.parametrize(
    ("sizes", "members"),
    [((0, 8), 2), ((0,), 6), ((8,), 6), ((3,), 1)],
    ids=["2 members", "C = 0", "C = 8", "1 member"],
)
def test_what_was_not_run_is_not_tested(
    write_stages: WriteStages, tmp_path: Path, experiment: str, sizes: tuple[int, ...], members: int
) -> None:
    """In every part of a sweep, too: only the first layout, or only the last planner or layout."""
    jobs = write_stages(tmp_path, sizes, members=members, epochs=2, experiment=experiment)
    for some in (jobs, jobs[: len(sizes)], jobs[-len(sizes) :]):
        table = scores.as_table(scores.score(Results(tuple(some)), claims_about(experiment)))
        decided = table[~table["part_verdict"].isin([NOT_DECIDED, NOT_TESTED])]
        assert (table["part_verdict"].eq(NOT_TESTED) == table["members"].eq(0)).all(), "nobody was there to test"
        assert decided["members"].eq(6).all(), "from six members only"
        assert decided[["effect", "low", "high"]].notna().all(axis=None)
        assert (table.loc[table["low"].isna(), "note"] != "").all(), "what is missing is said"
        if len(sizes) == 1:
            assert "-1" not in set(decided["claim"].str[-2:]) or experiment == "exp3", "one size has no trend"


def test_maps_and_runs_of_one_context_size_decide_what_they_can(stages: dict[str, Results]) -> None:
    largest = {
        name: tuple(job for job in results.settings if job.context_size == 8) for name, results in stages.items()
    }
    found: dict[str, Verdict] = {}
    for name in EXPERIMENTS:
        found |= verdicts(Results(largest[name]), name)
    decided = {"I-7", "I-8", "II-3", "III-1", "III-2", "IV-3", "IV-4", "V-2", "V-4", "V-5"}
    assert {name for name, verdict in found.items() if verdict == HOLDS} == decided
    assert {found[name] for name in found.keys() - decided} == {NOT_TESTED}


def test_what_is_missing_is_named(stages: dict[str, Results]) -> None:
    of_layout = {
        name: Results(tuple(job for job in results.settings if job.layout == results.layouts[0]))
        for name, results in stages.items()
    }
    assert parts(of_layout["exp2"], "exp2", "II-1")["b"]["note"] == "EB in the world with 12 obstacles was not run"
    assert parts(of_layout["exp2"], "exp2", "II-3")["a"]["note"] == "needs runs of both layouts"
    assert parts(of_layout["exp3"], "exp3", "III-1")["loss"]["note"] == "needs runs of both layouts"
    assert parts(of_layout["exp3"], "exp3", "III-2")["a"]["note"] == "needs a context size above 0"
    assert "longer training" in parts(of_layout["exp3"], "exp3", "III-3")["a"]["note"]
    assert parts(of_layout["exp5"], "exp5", "V-2")["error"]["note"] == "needs runs of both layouts"
    gradient = Results(tuple(job for job in stages["exp1"].settings if job.planner == "gradient"))
    assert parts(gradient, "exp1", "I-2")[""]["note"] == "EB was not run"
    assert parts(gradient, "exp1", "I-6")[""]["note"] == "needs runs of both planners"


# Experiment I


def test_claims_whose_opposite_was_built_into_the_data_do_not_hold(fresh: Fresh) -> None:
    """Swapping the planners' names turns I-3, I-5, I-6 and I-7 around and leaves the rest."""
    swapped = fresh("exp1")
    swapped.runs["planner"] = swapped.runs["planner"].map({"cem": "gradient", "gradient": "cem"})
    turned = {name for name, verdict in verdicts(swapped, "exp1").items() if verdict == DOES_NOT_HOLD}
    assert turned == {"I-3", "I-5", "I-6", "I-7"}


def test_the_effect_is_the_hand_computed_mean_or_median_over_members(stages: dict[str, Results]) -> None:
    results = stages["exp1"]
    distance = parts(results, "exp1", "I-3")[""]
    runs = results.runs.query("planner == 'cem'")
    by_size = runs.groupby("context_size")["mean_distance"].mean()  # all members have four runs: means of means
    assert distance["effect"] == pytest.approx(by_size[8] - by_size[0])
    assert distance["low"] < distance["effect"] < distance["high"]
    last = results.validation.query("epoch == 4").pivot(index="member", columns="context_size", values="validation_nll")
    assert parts(results, "exp1", "I-1")[""]["effect"] == pytest.approx((last[8] - last[0]).median())


def test_every_context_size_is_listed_with_claim_seven(stages: dict[str, Results]) -> None:
    note = parts(stages["exp1"], "exp1", "I-7")[""]["note"]
    assert "C = 1: " in note and "C = 8: " in note and "C = 0" not in note
    assert parts(stages["exp1"], "exp1", "I-6")[""]["note"] == ""


def test_a_run_without_a_number_is_not_left_out(fresh: Fresh) -> None:
    broken = fresh("exp1")
    broken.runs.loc[0, "prediction_error"] = np.nan  # one of the four runs of a member of EB without a context
    row = parts(broken, "exp1", "I-2")[""]
    assert (row["verdict"], row["note"]) == ("not decided", "1 of 6 members lack a finite score")


def test_noise_is_not_decided(fresh: Fresh) -> None:
    noisy = fresh("exp1")
    signs = np.where(noisy.runs["member"] % 2 == 0, 1.0, -1.0)  # half of the members say the opposite of the others
    noisy.runs["mean_distance"] = signs * noisy.runs["context_size"] + 0.1 * noisy.runs["member"]
    assert {verdicts(noisy, "exp1")[name] for name in ("I-3", "I-5")} == {NOT_DECIDED}


def test_what_an_untrained_map_shows_already_was_not_learned(write_stages: WriteStages, tmp_path: Path) -> None:
    """By construction the maps are the same before and after training: the contrasts hold, but were not learned.

    Learned parts are shown, but do not count: the paper claims nothing about untrained maps.
    """
    for experiment, claim, names in (("exp1", "I-8", "ab"), ("exp4", "IV-4", "abc")):
        jobs = write_stages(tmp_path / experiment, context_sizes=(8,), experiment=experiment)
        change_maps(jobs[0], lambda arrays: {"initial_codes": arrays["codes"]})
        rows = parts(Results(tuple(jobs)), experiment, claim)
        assert {rows[name]["part_verdict"] for name in names} == {"holds"}
        assert {rows[f"{name}, learned"]["part_verdict"] for name in names} == {"not decided"}
        assert {row["verdict"] for row in rows.values()} == {"holds"}


def change_maps(job: Setting, change: Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]) -> None:
    with np.load(job.map[0] / "maps.npz") as arrays:
        content = dict(arrays)
    np.savez(job.map[0] / "maps.npz", **content | change(content))


# Experiment II


def test_the_worlds_are_told_apart(fresh: Fresh) -> None:
    """Swapping the new worlds turns II-3 around; turning one of them's distances around turns its part of II-2."""
    swapped = fresh("exp2")
    names = {"two_obstacles": "twelve_obstacles", "twelve_obstacles": "two_obstacles", "original": "original"}
    swapped.runs["layout"] = swapped.runs["layout"].map(names)
    assert {row["part_verdict"] for row in parts(swapped, "exp2", "II-3").values()} == {"does not hold"}
    turned = fresh("exp2")
    turned.runs.loc[turned.runs["layout"] == "twelve_obstacles", ["prediction_error", "mean_distance"]] *= -1
    for claim in ("II-1", "II-2"):
        rows = parts(turned, "exp2", claim)
        assert [rows[part]["part_verdict"] for part in "ab"] == ["holds", "does not hold"]
    assert "II-1" not in {name for name, verdict in verdicts(swapped, "exp2").items() if verdict != HOLDS}


def test_context_sizes_weigh_the_same_and_only_common_ones_count(stages: dict[str, Results]) -> None:
    """C = 8 was not run with 2 obstacles, so it does not count for the original world, either."""
    jobs = [job for job in stages["exp2"].settings if (job.layout, job.context_size) != ("two_obstacles", 8)]
    results = Results(tuple(jobs))
    row = parts(results, "exp2", "II-3")["a"]
    runs = results.runs[results.runs["context_size"] < 8]
    means = runs.groupby(["layout", "context_size"])["mean_distance"].mean().groupby("layout").mean()
    assert row["effect"] == pytest.approx(means["two_obstacles"] - means["original"])
    assert "C = 0: " in row["note"] and "C = 1: " in row["note"] and "C = 8: " not in row["note"]


@pytest.mark.parametrize("experiment", EXPERIMENTS[1:])
def test_the_gradient_based_planner_is_left_out_where_the_paper_has_it_not(
    write_stages: WriteStages, tmp_path: Path, experiment: str
) -> None:
    """GB's runs differ, so that any of them among the others would show."""
    both = Results(tuple(write_stages(tmp_path, (0, 8), ("cem", "gradient"), steps=30, experiment=experiment)))
    evolutionary = Results(tuple(job for job in both.settings if job.planner == "cem"))
    claims = claims_about(experiment)
    assert scores.score(both, claims) == scores.score(evolutionary, claims)


# Experiment III


@pytest.mark.parametrize(
    ("metric", "part", "margin"),
    [("validation_nll", "loss", 0.5), ("prediction_error", "error", 0.5), ("mean_distance", "distance", 0.05)],
)
def test_conditions_are_the_same_up_to_the_margin(fresh: Fresh, metric: str, part: str, margin: float) -> None:
    for shift, expected in (
        (0.0, HOLDS),
        (0.8 * margin, HOLDS),
        (3 * margin, DOES_NOT_HOLD),
        (-3 * margin, DOES_NOT_HOLD),
    ):
        results = fresh("exp3")
        table = results.last_epoch if metric == "validation_nll" else results.runs
        easy, hard = (table["layout"] == name for name in ("original", "three_looks"))
        table.loc[hard, metric] = table.loc[easy, metric].to_numpy() + shift + table.loc[hard, "member"] * 1e-4
        row = parts(results, "exp3", "III-1")[part]
        assert row["part_verdict"] == expected
        assert row["effect"] == pytest.approx(shift + 2.5e-4), "hard minus easy"
        assert np.isnan(row["p"]) and f"{margin:g}" in row["test"]


def test_members_that_differ_in_both_directions_do_not_show_sameness(fresh: Fresh) -> None:
    results = fresh("exp3")
    hard = results.runs["layout"] == "three_looks"
    results.runs.loc[hard, "mean_distance"] += np.where(results.runs.loc[hard, "member"] % 2 == 0, 0.5, -0.5)
    assert parts(results, "exp3", "III-1")["distance"]["part_verdict"] == NOT_DECIDED


def test_the_trace_is_that_of_the_hard_world_at_the_largest_context(
    fresh: Fresh, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half an obstacle's distance is a trace, a twentieth is none, and about a tenth is not decided."""
    seen = []

    def trace(maps: Maps, world: Any, radius: float) -> tuple[np.ndarray, np.ndarray]:
        trained = maps.codes is not maps.initial_codes
        seen.append((world.name, maps.codes.shape[-1], trained))
        return (np.full(6, ratio) + wobble if trained else np.full(6, 2.0)) * 3.0, np.full(6, 3.0)

    monkeypatch.setattr(encoding, "meaningless_trace", trace)
    wobble = np.array([0.02, -0.02] * 3)
    for ratio, expected in ((0.5, DOES_NOT_HOLD), (0.05, HOLDS), (0.1, NOT_DECIDED)):
        rows = parts(fresh("exp3"), "exp3", "III-2")
        assert (rows["a"]["part_verdict"], rows["a"]["effect"]) == (expected, pytest.approx(ratio))
        assert rows["a, learned"]["part_verdict"] == HOLDS
        assert rows["a, learned"]["effect"] == pytest.approx(ratio - 2)
    assert set(seen) == {("three_looks", 8, True), ("three_looks", 8, False)}


def test_maps_that_are_constant_show_no_absence_of_a_trace(write_stages: WriteStages, tmp_path: Path) -> None:
    """0 of 0 is no ratio."""
    jobs = write_stages(tmp_path, context_sizes=(8,), experiment="exp3")
    change_maps(jobs[1], lambda arrays: {"codes": np.zeros_like(arrays["codes"])})
    rows = parts(Results(tuple(jobs)), "exp3", "III-2")
    assert {row["note"] for row in rows.values()} == {"6 of 6 members lack a finite score"}


def test_looks_that_come_to_matter_do_not_vanish(
    write_growth: WriteGrowth, stages: dict[str, Results], tmp_path: Path
) -> None:
    """The snapshots in reverse: after the last epoch looks matter most, yet less than in codes that are all noise."""
    growth = write_growth(tmp_path)
    change_maps(growth, lambda arrays: {"snapshot_codes": arrays["snapshot_codes"][::-1]})
    rows = parts(Results(stages["exp3"].settings, growth), "exp3", "III-3")
    assert (rows["a"]["part_verdict"], rows["b"]["part_verdict"]) == (DOES_NOT_HOLD, HOLDS)
    first = parts(stages["exp3"], "exp3", "III-3")
    assert rows["a"]["effect"] == pytest.approx(-first["a"]["effect"])
    assert first["a"]["effect_of"].endswith("epoch 100 minus epoch 1")
    assert rows["b"]["effect"] - first["b"]["effect"] == pytest.approx(rows["a"]["effect"]), "the last epoch counts"
    change_maps(growth, lambda arrays: {"initial_codes": arrays["codes"]})  # no looks from the start
    assert parts(Results(stages["exp3"].settings, growth), "exp3", "III-3")["b"]["part_verdict"] == DOES_NOT_HOLD


@pytest.mark.parametrize(("epochs", "members", "expected"), [((1, 2), 2, NOT_DECIDED), ((2,), 6, NOT_TESTED)])
def test_few_snapshots_or_members_decide_no_growth(
    write_growth: WriteGrowth,
    stages: dict[str, Results],
    tmp_path: Path,
    epochs: tuple[int, ...],
    members: int,
    expected: Verdict,
) -> None:
    results = Results(stages["exp3"].settings, write_growth(tmp_path, members, epochs))
    row = parts(results, "exp3", "III-3")["a"]
    assert (row["part_verdict"], row["note"] != "") == (expected, True)


# Experiment IV


def test_a_context_that_harms_does_not_help(fresh: Fresh) -> None:
    results = fresh("exp4")
    results.last_epoch["validation_nll"] *= -1
    results.runs["prediction_error"] *= -1
    found = verdicts(results, "exp4")
    assert (found["IV-1"], found["IV-2"], found["IV-3"]) == (DOES_NOT_HOLD, DOES_NOT_HOLD, HOLDS)


def test_contexts_are_averaged_and_compared_with_none(stages: dict[str, Results]) -> None:
    row = parts(stages["exp4"], "exp4", "IV-2")[""]
    means = stages["exp4"].runs.pivot_table(index="member", columns="context_size", values="prediction_error")
    assert row["effect"] == pytest.approx(((means[1] + means[8]) / 2 - means[0]).median())
    assert "C = 1: " in row["note"] and "C = 8: " in row["note"] and "C = 0" not in row["note"]


@pytest.mark.parametrize(("fails", "expected"), [(0, HOLDS), (1, NOT_DECIDED), (3, DOES_NOT_HOLD)])
def test_the_share_of_successes_is_close_to_one(fresh: Fresh, fails: int, expected: Verdict) -> None:
    """With a context all runs succeed, or one or three of four of all members but one fail; C = 0 does not count."""
    results = fresh("exp4")
    runs = results.runs
    runs["success"] = (runs["context_size"] > 0) & ((runs["run"] >= fails) | (runs["member"] < 1))
    row = parts(results, "exp4", "IV-3")[""]
    assert row["part_verdict"] == expected
    assert row["effect"] == pytest.approx((1 + 5 * (4 - fails) / 4) / 6)
    assert row["note"].startswith("C = 0: 0.00; C = 1: ")
    assert experiment4.CLOSE_TO_ONE == 0.8


# Experiment V


def test_hard_worlds_that_are_easier_turn_the_claims_around(fresh: Fresh) -> None:
    """Swapping the conditions' names turns V-2 around; with the largest context a quarter of "easy" then fails."""
    swapped = fresh("exp5")
    names = {"procedural_easy": "procedural_hard", "procedural_hard": "procedural_easy"}
    swapped.runs["layout"] = swapped.runs["layout"].map(names)
    assert {row["part_verdict"] for row in parts(swapped, "exp5", "V-2").values()} == {"does not hold"}
    assert verdicts(swapped, "exp5") == {
        "V-1": HOLDS,
        "V-2": DOES_NOT_HOLD,
        "V-3": HOLDS,
        "V-4": DOES_NOT_HOLD,
        "V-5": HOLDS,
    }


@pytest.mark.parametrize(("metric", "part", "sign"), [("success", "success", -1), ("prediction_error", "error", 1)])
def test_easy_has_to_be_better_at_every_context_size(fresh: Fresh, metric: str, part: str, sign: int) -> None:
    """At C = 1 the conditions are made equal, then reversed; the effect is that of the mean over all sizes."""
    for difference, expected in ((None, HOLDS), (0.0, NOT_DECIDED), (0.25, DOES_NOT_HOLD)):
        results = fresh("exp5")
        runs = results.runs.astype({"success": float})
        results.__dict__["runs"] = runs
        easy, hard = (
            (runs["layout"] == f"procedural_{name}") & (runs["context_size"] == 1) for name in ("easy", "hard")
        )
        if difference is not None:
            runs.loc[easy, metric] = runs.loc[hard, metric].to_numpy() + sign * difference
        row = parts(results, "exp5", "V-2")[part]
        means = runs.pivot_table(index="member", columns="layout", values=metric)  # all sizes have four runs
        differences = means["procedural_easy"] - means["procedural_hard"]
        assert row["part_verdict"] == expected
        assert row["effect"] == pytest.approx(differences.mean() if metric == "success" else differences.median())
        assert [f"C = {size}: " in row["note"] for size in (0, 1, 8)] == [True] * 3
        assert (row["p"] < 0.05) == (expected == HOLDS) or np.isnan(row["p"])


def test_each_condition_and_metric_has_its_own_trend(fresh: Fresh) -> None:
    turned = fresh("exp5")
    turned.runs.loc[turned.runs["layout"] == "procedural_hard", "prediction_error"] *= -1
    rows = parts(turned, "exp5", "V-3")
    wrong = {name for name, row in rows.items() if row["part_verdict"] == DOES_NOT_HOLD}
    assert wrong == {"hard, error"} and len(rows) == 4
    assert {row["unit"] for name, row in rows.items() if name.endswith("success")} == {"share"}
    turned.runs["success"] = ~turned.runs["success"]
    assert parts(turned, "exp5", "V-3")["easy, success"]["part_verdict"] == DOES_NOT_HOLD


def test_nearly_always_is_asked_of_easy_worlds_and_the_largest_context(fresh: Fresh) -> None:
    """Of 24 runs one fails: 0.96; the one world without a way is that of the failure, so of the rest all succeed."""
    results = fresh("exp5")
    runs = results.runs
    largest = (runs["layout"] == "procedural_easy") & (runs["context_size"] == 8)
    runs["success"] = largest
    row = parts(results, "exp5", "V-4")[""]
    assert (row["part_verdict"], row["effect"], row["effect_of"]) == (HOLDS, 1.0, "share at C = 8")
    runs.loc[runs.index[largest][0], ["success", "crossable"]] = False
    row = parts(results, "exp5", "V-4")[""]
    assert row["effect"] == pytest.approx(23 / 24)
    assert row["note"] == "where a way is known to exist: 1.00 (23 of 24 runs)"
    runs["success"] = largest & (runs["run"] > 0)
    assert parts(results, "exp5", "V-4")[""]["part_verdict"] == DOES_NOT_HOLD
    assert experiment5.NEARLY_ALWAYS == 0.9


# Tables


def test_medians_against_the_papers_axes(stages: dict[str, Results]) -> None:
    results = stages["exp1"]
    table = scores.medians(results, settings())
    assert len(table) == 3 + 2 * 3 * 2, "three losses, and two metrics of two planners at three sizes"
    row = table.query("metric == 'mean_distance' and planner == 'EB' and context_size == 0").iloc[0]
    runs = results.runs.query("planner == 'cem' and context_size == 0")["mean_distance"]
    assert row["center"] == pytest.approx(np.sort(runs)[11:13].mean()), "the middle two of 24 runs"
    assert (row["statistic"], row["layout"], row["number"]) == ("median", "original", 24)
    assert row["inside"] == (0.4 <= row["center"] <= 1.2)
    losses = table.query("metric == 'validation_nll'")
    assert not losses.query("context_size == 0")["inside"].item()
    assert set(losses["planner"]) == set(losses["layout"]) == {""}


def test_success_is_shown_by_its_mean_as_in_the_papers_bars(stages: dict[str, Results]) -> None:
    table = scores.medians(stages["exp5"], settings(outcome="success", axes={"success": (0.0, 0.6)}))
    shares = table[table["metric"] == "success"].set_index(["layout", "context_size"])
    assert set(shares["statistic"]) == {"mean"} and set(shares["unit"]) == {"share"}
    by_hand = {(f"procedural_{name}", size): share for name, size, share in (("easy", 0, 0.5), ("hard", 8, 0.75))}
    for key, share in by_hand.items():
        assert (shares.loc[key, "center"], shares.loc[key, "inside"]) == (share, share <= 0.6)
    assert "mean_distance" not in set(table["metric"])


def test_what_the_paper_has_no_axis_for_stays_empty(stages: dict[str, Results]) -> None:
    table = scores.medians(stages["exp3"], settings(axes={"mean_distance": (0.4, 1.2)}))
    without = table[table["metric"] != "mean_distance"]
    assert without[["paper_low", "paper_high", "inside"]].isna().all(axis=None)
    assert table[table["metric"] == "mean_distance"][["paper_low", "paper_high", "inside"]].notna().all(axis=None)
    assert set(table.query("metric == 'validation_nll'")["layout"]) == {"original", "three_looks"}


def test_a_missing_number_has_no_median(fresh: Fresh) -> None:
    results = fresh("exp1")
    results.runs.loc[0, "mean_distance"] = np.nan
    table = scores.medians(results, settings())
    assert table["center"].isna().sum() == 1 and not table.loc[table["center"].isna(), "inside"].item()


def test_tables_name_what_is_wrong(stages: dict[str, Results], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one completed setting"):
        Results(())
    with pytest.raises(ValueError, match="tells settings apart by their values"):
        Results(stages["exp1"].settings[:1] * 2)
    pd.DataFrame({"member": [0]}).to_csv(tmp_path / "runs.csv")
    with pytest.raises(ValueError, match="lacks the columns"):
        _ = Results(
            (
                Setting(
                    {"model.context_size": 0, "planner": "cem", "control_layout": "original"},
                    dict.fromkeys(STAGES, (tmp_path,)),
                ),
            )
        ).runs


def test_a_trend_may_be_over_any_factor() -> None:
    """By hand: each of six members scores 1, 2, 3 at beta 0, 1, 10."""
    rows = [(member, beta, place) for member in range(6) for place, beta in enumerate((0.0, 1.0, 10.0), 1)]
    runs = pd.DataFrame(rows, columns=["member", "control_beta", "mean_distance"])
    criterion = claims.trend(runs, "mean_distance", "rises", "EB", factor=make_factor("control.beta"))
    assert criterion.effect_of == "beta = 10 minus beta = 0"
    assert (criterion.outcome.effect, criterion.outcome.verdict) == (2.0, "holds")
