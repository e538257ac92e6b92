"""What a user meets first: the names of the package, and the README against the files it quotes."""

import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import affmap

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", affmap.__all__)
def test_every_public_name_is_there(name: str) -> None:
    """By hand: the name is that of the object."""
    assert getattr(affmap, name).__name__ == name


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Ensemble'"):
        affmap.Ensemble  # noqa: B018


def test_importing_the_package_needs_no_torch() -> None:
    """In a process of its own."""
    code = "import sys, affmap; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=False).returncode == 0


def test_the_readme_quotes_the_claims() -> None:
    """Golden: the table that `make exp1` wrote, word for word."""
    claims = (ROOT / "runs/reference/exp1/tables/claims.md").read_text("utf-8")
    assert claims in (ROOT / "README.md").read_text("utf-8")


def test_the_readme_quotes_the_claims_of_the_other_experiments() -> None:
    """Golden: the rows of the table that `make paper` wrote, word for word, but for those of Experiment I."""
    header, line, *rows = (ROOT / "runs/reference/paper/tables/claims.md").read_text("utf-8").splitlines()
    others = [row for row in rows if not row.startswith("| I-")]
    assert len(others) == 14
    assert "\n".join([header, line, *others]) in (ROOT / "README.md").read_text("utf-8")


def test_the_readme_says_what_the_comparison_of_look_ups_found() -> None:
    """Every comparison with exact look-ups that did not end as "same" is named."""
    table = pd.read_csv(ROOT / "runs/reference/lookups/tables/lookup_spacing.csv")
    assert set(table["a"]) == {0}
    others = table[table["verdict"] != "same"]
    assert len(others) == 1
    (other,) = others.itertuples()
    said = f"but for the {other.metric.replace('_', ' ')} at {other.b:g} u, which is {other.verdict}"
    assert said in (ROOT / "README.md").read_text("utf-8").replace("\n", " ")


@pytest.mark.parametrize(
    ("said", "work", "contender", "low", "high"),
    [
        ("a twelfth of the time of plain PyTorch", "training by hand", "plain PyTorch", 11.5, 12.5),
        ("a ninth of that of `torch.func.vmap`", "training by hand", "plain PyTorch, vmap over 25", 8.5, 9.5),
        ("a ninth of the time that our planner needs", "planning, 100", "affmap, one at a time", 8.5, 9.5),
        ("an eighth to a thirteenth", "planning, 100", "stable-worldmodel, one at a time", 7.5, 8.5),
        ("an eighth to a thirteenth", "planning, 100", "torchrl, one at a time", 12.5, 13.5),
        ("one of them is 8 % faster", "planning, 1 agent", "stable-worldmodel", 0.915, 0.925),
        ("fifty times as fast as the vision model in plain PyTorch", "look-up", "plain PyTorch", 45, 55),
        ("2.6 times as long as LunarLander", "simulation, one", "LunarLander-v3", 1 / 2.65, 1 / 2.55),
    ],
)
def test_the_readme_s_ratios_are_those_measured(said: str, work: str, contender: str, low: float, high: float) -> None:
    """The words against the table that `make bench` wrote."""
    table = pd.read_csv(ROOT / "runs/reference/bench/results.csv")
    (ratio,) = table[table["work"].str.startswith(work) & (table["contender"] == contender)]["ratio"]
    assert low <= ratio <= high
    assert said in (ROOT / "README.md").read_text("utf-8").replace("\n ", "")


def test_the_readme_s_other_numbers_on_speed_are_those_measured() -> None:
    """Exact look-ups beside plain PyTorch, the share of a control step, processes beside threads: from the tables."""
    readme = (ROOT / "README.md").read_text("utf-8").replace("\n ", "")
    results, step, growth = (
        pd.read_csv(ROOT / f"runs/reference/bench/{name}.csv") for name in ("results", "control_step", "growth")
    )
    ratio = results[results["work"].str.startswith("look-up")].set_index("contender")["ratio"]
    assert round(ratio["plain PyTorch"] / ratio["exact, views known"]) == 4
    assert "remember the views that they have seen, four times" in readme
    assert f"takes {1 - step.set_index('part')['share']['planning']:.0%}".replace("%", " %") in readme
    team = growth[growth["varied"] == "threads and processes"].set_index(["processes", "threads"])["milliseconds"]
    assert f"train {team[1, 2] / team[2, 1]:.1f} times as much" in readme


def factor(name: str, key: str) -> pd.DataFrame:
    """The mean distances of a comparison of one factor, by context size and value."""
    table = pd.read_csv(ROOT / f"runs/reference/factors/{name}/tables/{key}.csv")
    return table[table["metric"] == "mean_distance"].set_index("context_size")


def test_what_is_said_about_single_factors_is_in_their_tables() -> None:
    """README and `causes.md` against the tables."""
    said = " ".join((ROOT / "README.md").read_text("utf-8").split())
    causes = " ".join((ROOT / "affmap/report/causes.md").read_text("utf-8").split())
    through = factor("gb_gradients", "lookup_differentiable").loc[8]
    assert f"{through['mean_b']:.2f} u instead of {through['mean_a']:.2f} u" in said
    assert f"is {through['mean_b']:.2f} u instead of {through['mean_a']:.2f} u" in causes
    slow = factor("gb_learning_rate", "planner_learning_rate")["mean_b"]
    assert f"rises from {slow[0]:.2f} u to {slow[8]:.2f} u" in causes and slow[8] > slow[0]
    evolutionary = pd.read_csv(ROOT / "runs/reference/exp1/tables/runs.csv").query(
        "planner == 'cem' and context_size == 0"
    )
    assert slow[0] > evolutionary["mean_distance"].mean()  # which costs I-6
    white = factor("gb_exploration", "data_max_hold")["mean_b"]
    assert f"rises from {white[0]:.2f} u to {white[8]:.2f} u" in causes and white[8] > white[0]
    unmoved = pd.concat([factor("gb_world", "control_layout"), factor("gb_contact", "vehicle_contact_damping")])
    for _, values in unmoved.groupby("b"):
        assert values.loc[8, "mean_b"] <= values.loc[0, "mean_b"] + 0.005


def test_the_readme_lists_every_module() -> None:
    """One line a file."""
    readme = (ROOT / "README.md").read_text("utf-8")
    files = [path for path in (ROOT / "affmap").rglob("*.py") if path.name != "__init__.py"]
    files += (ROOT / "conf").rglob("*.yaml")
    assert [path.name for path in files if not re.search(rf"[ /]{re.escape(path.name)}[ ,\n]", readme)] == []
