"""All experiments of `conf` at the tiniest scale: those of the paper to the report of the whole, and comparisons."""

import subprocess
import sys
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest

from affmap.config.sweep import Sweep
from affmap.experiments import ROOMS, claims_about
from affmap.settings import folder

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
COMPARISONS = {"lookups": "lookup.spacing=0,0.1,0.25"} | {
    path.relative_to(folder() / "experiment").with_suffix("").as_posix(): COARSE
    for path in sorted(folder().glob("experiment/*/*.yaml"))
    if not path.stem.endswith("_growth")
}
"""Name -> the maps that agents look into."""

PAPER_SIZES, SIZES = "0,1", {"exp7": "1"}
"""Context sizes of the paper's experiments, and those of experiments about other keys."""

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
    lines = [[f"experiment={name}", f"model.context_size={SIZES.get(name, PAPER_SIZES)}"] for name in ROOMS]
    script = f"{SCRIPT}\ncall(paper.main, 'model.context_size={PAPER_SIZES}')"
    return made(lines, script, [*TINY, COARSE], tmp_path_factory.mktemp("paper"))


def made(lines: Sequence[list[str]], script: str, arguments: Sequence[str], place: Path) -> Path:
    """Run a script, which runs and reports some command lines, in a folder, and return the folder."""
    command = [sys.executable, "-W", "ignore", "-c", f"lines = {lines}\n{script}", *arguments]
    result = subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=600)
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
    runs = pd.read_csv(output / "tables" / "runs.csv")
    settings = {"exp1": 4, "exp2": 6, "exp3": 4, "exp4": 2, "exp5": 4, "exp7": 5 * 4}[experiment]
    assert len(runs) == settings * 2 * 4
    claims = pd.read_csv(output / "tables" / "claims.csv")["claim"].drop_duplicates().tolist()
    numbers = {"exp1": ("I", 8), "exp2": ("II", 3), "exp3": ("III", 3), "exp4": ("IV", 4), "exp5": ("V", 5)}
    number, count = (numbers | {"exp7": ("VII", 5)})[experiment]
    assert claims == [f"{number}-{index}" for index in range(1, count + 1)]


def test_the_whole_paper_is_one_report(place: Path) -> None:
    """All 23 claims in one table; made from what the experiments left."""
    output = place / "runs" / "paper-smoke"
    assert (output / "report.pdf").read_bytes().startswith(b"%PDF")
    assert pd.read_csv(output / "tables" / "claims.csv")["claim"].nunique() == 8 + 3 + 3 + 4 + 5
    assert "SMOKE RUN" in (output / "report.html").read_text("utf-8")


def test_nothing_is_computed_twice(place: Path) -> None:
    """By hand: I trains two models, II none, III two and its longer one, IV two, V two, VII none."""
    kept = {
        name: [path for path in (place / "runs/store" / name).iterdir() if path.suffix == ""]
        for name in ("data", "train")
    }
    assert len(kept["data"]) == 4 and len(kept["train"]) == 2 + 0 + 3 + 2 + 2


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
