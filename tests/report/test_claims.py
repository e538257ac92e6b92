"""Reference: synthetic stages whose structure is written by hand, so each verdict is known before it is computed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.report import claims
from affmap.report.statistics import Verdict
from affmap.report.tables import Job, Results

WriteStages = Callable[..., list[Job]]


@pytest.fixture(scope="module")
def results(write_stages: WriteStages, tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Losses and errors fall with the context size; without a context GB beats EB, with one EB beats GB."""
    return Results(tuple(write_stages(tmp_path_factory.mktemp("stages"))))


def verdicts(results: Results) -> dict[str, Verdict]:
    return {score.claim.name: score.verdict for score in claims.score(results)}


def by_claim(results: Results) -> dict[str, Any]:
    return {row["claim"]: row for row in claims.as_table(claims.score(results)).to_dict("records")}


def test_claims_that_were_built_into_the_data_hold(results: Results) -> None:
    assert verdicts(results) == {f"I-{number}": Verdict.HOLDS for number in range(1, 9)}


def test_claims_whose_opposite_was_built_into_the_data_do_not_hold(results: Results) -> None:
    """Swapping the planners' names turns I-3, I-5, I-6 and I-7 around and leaves the rest."""
    swapped = Results(results.jobs)
    swapped.runs["planner"] = swapped.runs["planner"].map({"cem": "gradient", "gradient": "cem"})
    turned = {name for name, verdict in verdicts(swapped).items() if verdict == Verdict.DOES_NOT_HOLD}
    assert turned == {"I-3", "I-5", "I-6", "I-7"}


def test_the_effect_is_the_hand_computed_mean_over_members(results: Results) -> None:
    rows = by_claim(results)
    runs = results.runs.query("planner == 'cem'")
    by_size = runs.groupby("context_size")["mean_distance"].mean()  # all members have four runs: means of means
    assert rows["I-3"]["effect"] == pytest.approx(by_size[8] - by_size[0])
    assert rows["I-3"]["low"] < rows["I-3"]["effect"] < rows["I-3"]["high"]
    last = results.validation.query("epoch == 4").groupby("context_size")["validation_nll"].mean()
    assert rows["I-1"]["effect"] == pytest.approx(last[8] - last[0])


def test_every_context_size_is_listed_with_claim_seven(results: Results) -> None:
    note = by_claim(results)["I-7"]["note"]
    assert "C = 1: " in note and "C = 8: " in note and "C = 0" not in note


def test_a_run_without_a_number_is_not_left_out(results: Results) -> None:
    broken = Results(results.jobs)
    broken.runs.loc[0, "prediction_error"] = np.nan  # one of the four runs of a member of EB without a context
    row = by_claim(broken)["I-2"]
    assert (row["verdict"], row["note"]) == ("not decided", "1 of 6 members lack a finite score")


def test_noise_is_not_decided(results: Results) -> None:
    noisy = Results(results.jobs)
    signs = np.where(noisy.runs["member"] % 2 == 0, 1.0, -1.0)  # half of the members say the opposite of the others
    noisy.runs["mean_distance"] = signs * noisy.runs["context_size"] + 0.1 * noisy.runs["member"]
    assert {verdicts(noisy)[name] for name in ("I-3", "I-5")} == {Verdict.NOT_DECIDED}


@pytest.mark.parametrize(
    ("sizes", "planners", "members"), [((0, 8), ("cem", "gradient"), 2), ((0,), ("cem",), 6), ((8,), ("gradient",), 6)]
)
def test_what_was_not_run_is_not_decided(
    write_stages: WriteStages, tmp_path: Path, sizes: tuple[int, ...], planners: tuple[str, ...], members: int
) -> None:
    results = Results(tuple(write_stages(tmp_path, sizes, planners, members, epochs=2)))
    scores = claims.score(results)
    decided = {score.claim.name for score in scores if score.verdict != Verdict.NOT_DECIDED}
    assert decided <= ({"I-8"} if sizes == (8,) else set())
    table = claims.as_table(scores)
    assert (table.loc[table["p"].isna(), "note"] != "").all(), "what is missing is said"


def test_medians_against_the_papers_axes(results: Results) -> None:
    table = claims.medians(results)
    assert len(table) == 3 + 2 * 3 * 2, "three losses, and two metrics of two planners at three sizes"
    row = table.query("metric == 'mean_distance' and planner == 'EB' and context_size == 0").iloc[0]
    runs = results.runs.query("planner == 'cem' and context_size == 0")["mean_distance"]
    assert row["median"] == pytest.approx(np.sort(runs)[11:13].mean()), "the middle two of 24 runs"
    assert row["inside"] == (0.4 <= row["median"] <= 1.2)
    assert not table.query("metric == 'validation_nll' and context_size == 0")["inside"].item()


def test_tables_name_what_is_wrong(results: Results, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="planner is 'mppi'"):
        Job(0, "mppi", tmp_path, tmp_path, tmp_path, tmp_path)
    with pytest.raises(ValueError, match="at least one job"):
        Results(())
    with pytest.raises(ValueError, match="may occur once"):
        Results(results.jobs[:1] * 2)
    pd.DataFrame({"member": [0]}).to_csv(tmp_path / "runs.csv")
    with pytest.raises(ValueError, match="lacks the columns"):
        _ = Results((Job(0, "cem", tmp_path, tmp_path, tmp_path, tmp_path),)).runs


def test_what_an_untrained_map_shows_already_was_not_learned(write_stages: WriteStages, tmp_path: Path) -> None:
    """By construction the maps are the same before and after training: the contrasts hold, but were not learned."""
    jobs = write_stages(tmp_path, context_sizes=(8,))
    with np.load(jobs[0].map / "maps.npz") as arrays:
        content = dict(arrays)
    np.savez(jobs[0].map / "maps.npz", **{**content, "initial_codes": content["codes"]})
    (encoding,) = [score for score in claims.score(Results(tuple(jobs))) if score.claim.name == "I-8"]
    verdicts = {part.name: part.outcome.verdict for part in encoding.parts}
    assert verdicts["a"] == verdicts["b"] == Verdict.HOLDS
    assert verdicts["a, learned"] == verdicts["b, learned"] == encoding.verdict == Verdict.NOT_DECIDED
