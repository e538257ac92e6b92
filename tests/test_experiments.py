"""All experiments of `conf` at the tiniest scale: those of the paper to the report of the whole, and comparisons."""

import subprocess
import sys
from collections.abc import Sequence
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path

import pandas as pd
import pytest

from affmap.config.sweep import Sweep
from affmap.experiments import ROOMS, claims_about, is_of_paper
from affmap.settings import folder, read

TINY = [
    "scale=smoke",
    "data.num_sequences=4",
    "data.num_validation=1",
    "data.num_steps=20",
    "control.num_steps=4",
    "report.map_spacing=0.1",
    "hydra.launcher.n_jobs=1",
]
COARSE = "lookup.spacing=0.25"
SIZES, SIZE = "model.context_size=0,1", "model.context_size=8"  # a block for each channel
PAPER = [name for name in ROOMS if is_of_paper(name)]
HAS_RL = find_spec("stable_baselines3") is not None
RIVALS = "none,distilled,cloning,td3_bc" + (",ppo,sac,ppo_million" if HAS_RL else "")
CLAIMS = {
    "exp1": ("I", range(1, 9), 2 * 2),
    "exp2": ("II", range(1, 4), 3 * 2),
    "exp3": ("III", range(1, 4), 2 * 2),
    "exp4": ("IV", range(1, 5), 1 * 2),
    "exp5": ("V", range(1, 6), 2 * 2),
    "exp6": ("VI", range(1, 10), 5 * 4),
    "exp6_radii": ("VI", range(10, 20), 5 * 3),
    "exp7": ("VII", range(1, 6), 5 * 4),
    "exp7_doors": ("VII", range(6, 9), 3),
    "exp8": ("VIII", range(10, 19), 5 * 2),
    "exp8_fog": ("VIII", range(19, 28), 5),
    "exp8_goals": ("VIII", range(46, 52), 5),
    "exp8_worlds": ("VIII", range(35, 46), 4 * 2),
    "exp9": ("IX", range(1, 9), 3 * 2),
    "exp9_map": ("IX", range(9, 15), 5 * 4),
    "exp10": ("X", range(5, 16), len(RIVALS.split(",")) * 3),
    "exp10_factors": ("X", range(1, 5), 48),
}
"""Experiment -> its number, the numbers of its claims, and the number of its settings here."""

COMPARISONS = {"lookups": "lookup.spacing=0,0.1,0.25"} | {
    path.relative_to(folder() / "experiment").with_suffix("").as_posix(): COARSE
    for path in sorted(folder().glob("experiment/*/*.yaml"))
    if not path.stem.endswith("_growth")
}
"""Name -> the maps that agents look into."""

SCRIPT = """
import sys
from affmap.cli import paper, report, run
def call(entry, *arguments):
    sys.argv = [entry.__module__, *arguments, *sys.argv_given]
    entry()
sys.argv_given = sys.argv[1:]
for line in lines:
    call(run.main, *line)
    call(report.main, *line)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands leave behind, all in one process, because most of their time is imports."""
    lines = [[f"experiment={name}", SIZES if name in PAPER else SIZE] for name in ROOMS]
    lines[ROOMS.index("exp10")] += [f"rival={RIVALS}"]
    script = f"{SCRIPT}\ncall(paper.main, {SIZES!r})"
    if HAS_RL:  # which the report of all experiments beyond the paper needs
        script += f"\ncall(paper.main, '--beyond', {SIZE!r})"
    return made(lines, script, [*TINY, COARSE], tmp_path_factory.mktemp("paper"))


def made(lines: Sequence[list[str]], script: str, arguments: Sequence[str], place: Path) -> Path:
    """Run a script, which runs and reports some command lines, in a folder, and return the folder."""
    command = [sys.executable, "-W", "ignore", "-c", f"lines = {lines}\n{script}", *arguments]
    result = subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=1500)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    assert "Traceback" not in result.stdout + result.stderr
    return place


@pytest.mark.parametrize("experiment", ROOMS)
def test_an_experiment_ends_with_its_report(place: Path, experiment: str) -> None:
    """PDF, page, tables and figures; a row for each run of each setting; every claim, in order."""
    output = place / "runs" / f"{experiment}-smoke"
    assert (output / "report.pdf").read_bytes().startswith(b"%PDF")
    HTMLParser().feed((output / "report.html").read_text("utf-8"))
    assert len(list((output / "figures").glob("*.png"))) >= 5
    assert (output / "figures" / "blocks.png").is_file() == (experiment == "exp6")
    runs = pd.read_csv(output / "tables" / "runs.csv")
    number, numbers, settings = CLAIMS[experiment]
    assert len(runs) == settings * 2 * read("experiment", experiment).get("control", {}).get("runs_per_member", 4)
    claims = pd.read_csv(output / "tables" / "claims.csv")["claim"].drop_duplicates().tolist()
    assert claims == [f"{number}-{index}" for index in numbers]


@pytest.mark.parametrize("volume", ["paper", "beyond"])
def test_all_of_the_paper_and_all_beyond_it_are_one_report_each(place: Path, volume: str) -> None:
    """All 23 claims of the paper in one table, and all others in another; made from what the experiments left."""
    if volume == "beyond" and not HAS_RL:
        pytest.skip("Stable-Baselines3 is not installed")
    output = place / "runs" / f"{volume}-smoke"
    assert (output / "report.pdf").read_bytes().startswith(b"%PDF")
    expected = sum(len(numbers) for name, (_, numbers, _) in CLAIMS.items() if (name in PAPER) == (volume == "paper"))
    assert pd.read_csv(output / "tables" / "claims.csv")["claim"].nunique() == expected
    assert "SMOKE RUN" in (output / "report.html").read_text("utf-8")


def test_nothing_is_computed_twice(place: Path) -> None:
    """By hand: I trains two models, II none, III two and its longer one, IV two, V two for both, VI five
    with V's data and five, two of them with these data, VII one, its doors one, VIII ten and five with goals
    with I's and IV's data and four with V's, IX three in each of two worlds, its maps and X
    one with I's data, which rivals share."""
    kept = {
        name: [path for path in (place / "runs/store" / name).iterdir() if path.suffix == ""]
        for name in ("data", "train")
    }
    assert len(kept["data"]) == 6 + 2
    assert len(kept["train"]) == 2 + 0 + 3 + 2 + 2 + 5 + 5 + 1 + 1 + 10 + 5 + 4 + 6 + 1


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `make lookups`, `make factors` and `make replication` leave behind."""
    lines = [[f"experiment={name}", maps] for name, maps in COMPARISONS.items()]
    return made(lines, SCRIPT, TINY, tmp_path_factory.mktemp("comparisons"))


@pytest.mark.parametrize("name", COMPARISONS)
def test_a_comparison_ends_with_its_table(compared: Path, name: str) -> None:
    """Each value but the first is compared with it, in every metric; all others have a report."""
    sweep = Sweep.read([f"experiment={name}", COMPARISONS[name]])
    place = compared / "runs" / f"{name}-smoke"
    factor = sweep.first.report.compare
    if factor is None:
        claims = pd.read_csv(place / "tables" / "claims.csv")["claim"].nunique()
        assert (place / "report.pdf").read_bytes().startswith(b"%PDF")
        assert claims == len(claims_about(sweep.first.report.claims)) > 2
        return
    table = pd.read_csv(place / "tables" / f"{factor.replace('.', '_')}.csv")
    # On the command line the group of a part is named with a slash.
    values = {value for each in sweep.values for key, value in each.items() if key.replace("/", ".") == factor}
    assert table["a"].nunique() == 1 and table["b"].nunique() == len(values) - 1
    assert {"prediction_error", "mean_distance", "reached"} <= set(table["metric"])
    assert (place / "figures" / f"{factor.replace('.', '_')}.png").is_file()
