"""The tables that `affmap-report` prints, against those of the published run and by hand."""

from pathlib import Path

import pandas as pd
import pytest
from rich.table import Table
from rich.text import Text

from affmap.cli.tables import claims, medians, show
from affmap.report.content import claim_rows
from affmap.results import scores, statistics
from affmap.results.claims import Claim, Criterion, Score

PUBLISHED = Path(__file__).parents[2] / "runs" / "reference"


def cells(table: Table) -> list[list[str]]:
    columns = [
        [cell.plain if isinstance(cell, Text) else str(cell) for cell in column.cells] for column in table.columns
    ]
    return [list(row) for row in zip(*columns, strict=True)]


def test_claims_are_those_of_the_report_s_page() -> None:
    """Of one part and of two, tested or not: name, effect, p and verdict as `claim_rows` has them for the page."""
    tested = statistics.same([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.1, 0.1, 0.2, 0.2, 0.3, 0.3], 0.05)
    paired = statistics.paired([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.2, 0.4, 0.6, 0.8, 1.0, 1.2], "lower")
    missing = statistics.undecided("test", 0, "nothing was run")
    parts = [Criterion("a", "x", "u", tested, "this"), Criterion("b", "y", "ratio", missing, "that")]
    scored = [
        Score(Claim("I-1", "It falls.", lambda _: []), (Criterion("", "x", "ratio", paired),)),
        Score(Claim("I-2", "Both.", lambda _: []), tuple(parts)),
    ]
    expected = [[row["name"], row["effect"], row["p"], row["verdict"]] for row in claim_rows(scored)]
    printed = [[name, effect, p, verdict] for name, _, effect, p, verdict in cells(claims(scores.as_table(scored)))]
    assert printed == expected and [row[-1] for row in printed][2] == "not tested"


def test_medians_of_the_published_run(capsys: pytest.CaptureFixture[str]) -> None:
    """Experiment I's table, by hand: EB's error at each context size; a training has neither planner nor layout."""
    rows = cells(medians(pd.read_csv(PUBLISHED / "exp1/tables/medians.csv")))
    assert len(rows) == 5
    assert rows[0][:4] == ["median validation loss (nats)", "", "", "−7.69"]
    assert rows[1] == ["median prediction error (nats)", "EB", "original", "−8.08", "−9.03", "−9.66", "−9.90", "−10.08"]
    show(PUBLISHED / "exp1/tables")
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["planner", "layout", *(word for size in (0, 1, 3, 5, 8) for word in ("C", "=", str(size)))] in lines
    assert sum("not decided" in " ".join(line) for line in lines) == 1  # I-5


@pytest.mark.parametrize(("members", "said"), [(2, True), (4, True), (5, False)])
def test_too_few_members_for_tests_are_said_once(
    members: int, said: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two claims tested with so many members, and one of which nothing was run."""
    scores_of = [[0.1 * member + 0.01 * (member % 2) for member in range(members)], [0.0] * members]
    tested = statistics.paired(*scores_of, "lower")
    outcomes = [tested, tested, statistics.undecided("test", 0, "nothing was run")]
    scored = [
        Score(Claim(f"I-{place}", "It falls.", lambda _: []), (Criterion("", "x", "ratio", outcome),))
        for place, outcome in enumerate(outcomes)
    ]
    scores.as_table(scored).to_csv(tmp_path / "claims.csv", index=False)
    pd.read_csv(PUBLISHED / "exp1/tables/medians.csv").to_csv(tmp_path / "medians.csv", index=False)
    show(tmp_path)
    sentence = f"Tests need at least 5 members; there are at most {members} here."
    assert capsys.readouterr().out.splitlines().count(sentence) == said


def test_a_sweep_over_another_key_has_a_row_for_each_of_its_values() -> None:
    """By hand; a value that trainings do not have is left out."""
    table = pd.DataFrame(
        {
            "metric": ["validation_nll", "success", "success"],
            "planner": [None, "EB", "EB"],
            "control_beta": [None, 0.0, 1.5],
            "context_size": [3, 3, 3],
            "statistic": ["median", "mean", "mean"],
            "center": [-1.234, 0.5, float("nan")],
        }
    )
    assert cells(medians(table)) == [
        ["median validation loss (nats)", "", "", "−1.23"],
        ["mean success (share)", "EB", "0.0", "0.50"],
        ["mean success (share)", "EB", "1.5", "–"],
    ]
