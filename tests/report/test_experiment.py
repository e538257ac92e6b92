"""References: the bytes of a second write, the numbers of the tables, Python's parser of HTML."""

import base64
import io
import json
import re
import shutil
import warnings
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
import yaml

from affmap.env.layout import Layout
from affmap.experiments import claims_about, open_room
from affmap.experiments.paper.report import Chapter, PaperReport
from affmap.report import build, page, sentences
from affmap.report.drawing import files
from affmap.report.experiment import ExperimentReport, Room
from affmap.results import manifest, provenance, statistics
from affmap.results.claims import Claim, Criterion, Score
from affmap.results.numbers import NOTHING, counted, listed, number, points, span
from affmap.results.scores import score
from affmap.results.setting import ReportSettings, Setting
from affmap.results.statistics import Outcome
from affmap.results.tables import Results
from affmap.settings import ConfigError
from affmap.store.stage import Stage

CONF = Path(__file__).parents[2] / "conf"
SVG = "data:image/svg+xml;base64,"
NOTICE = "SMOKE RUN: 2 members, 2 epochs; not a result"
MISSING = "2 of 4 settings are not complete (C = 16, 32)."
COMMAND = "make exp1 SCALE=smoke"
ALWAYS = {"results", "trajectories", "maps", "world", "exploration", "outcomes", "steps"}
DRAWN = {
    "exp1": ALWAYS,
    "exp2": ALWAYS,
    "exp3": ALWAYS | {"growth"},
    "exp4": ALWAYS | {"failures"},
    "exp5": ALWAYS | {"failures"},
}
WriteStages = Callable[..., list[Setting]]


def settings(experiment: str) -> ReportSettings:
    """The settings that `conf/` gives to an experiment."""
    default, own = (
        yaml.safe_load((CONF / path).read_text("utf-8"))
        for path in ("report/default.yaml", f"experiment/{experiment}.yaml")
    )
    names = default["names"] | own["report"].get("names", {})
    return ReportSettings.model_validate(default | own["report"] | {"names": names})


@pytest.fixture(scope="module")
def results(
    write_stages: WriteStages, write_growth: Callable[..., Setting], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Results]:
    """Small results of all experiments, which share stages as the real ones do."""
    root = tmp_path_factory.mktemp("stages")
    found = {name: write_stages(root, (0, 8), members=2, epochs=2, experiment=name) for name in DRAWN}
    growth = write_growth(root, members=2, epochs=(1, 2))
    return {name: Results(tuple(jobs), growth if name == "exp3" else None) for name, jobs in found.items()}


def write(output: Path, results: Results, experiment: str, notice: str | None = NOTICE) -> Path:
    return build.write(report(output, results, experiment, settings(experiment), notice))


def report(
    output: Path, results: Results, experiment: str, settings: ReportSettings, notice: str | None
) -> ExperimentReport:
    told = {"name": experiment, "title": experiment, "command": COMMAND}
    return ExperimentReport(output, results, settings, open_room(experiment, settings.claims), **told, notice=notice)


@pytest.fixture(scope="module")
def reports(results: dict[str, Results], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("reports")
    for name, found in results.items():
        assert write(root / name, found, name) == root / name / "report.pdf"
    return {name: root / name for name in results}


def paper(output: Path, results: dict[str, Results], reports: dict[str, Path]) -> PaperReport:
    """The paper's report; Experiment V is not complete."""
    chapters = [
        Chapter(
            f"Experiment {name}",
            found,
            settings(name),
            open_room(name, name),
            reports[name],
            MISSING if name == "exp5" else "",
        )
        for name, found in results.items()
    ]
    return PaperReport(output, chapters, "make paper", None)


@pytest.fixture(scope="module")
def whole(results: dict[str, Results], reports: dict[str, Path]) -> Path:
    output = reports["exp1"].with_name("paper")
    assert build.write(paper(output, results, reports)) == output / "report.pdf"
    return output


class Page(HTMLParser):
    """What a page is made of."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.images: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(path.read_text("utf-8"))
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.links += [values[key] or "" for key in ("href", "src") if key in values]
        if tag == "img":
            self.images.append(values["src"] or "")
        if tag not in ("img", "meta", "br", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("name", DRAWN)
def test_everything_that_was_promised_is_there(reports: dict[str, Path], name: str) -> None:
    tables = {
        f"tables/{table}"
        for table in ("runs.csv", "validation.csv", "steps.csv", "claims.csv", "medians.csv", "claims.md")
    }
    drawn = {f"figures/{figure}.{kind}" for figure in DRAWN[name] for kind in ("png", "pdf", "svg")}
    written = {path.relative_to(reports[name]).as_posix() for path in reports[name].rglob("*") if path.is_file()}
    assert written == tables | drawn | {
        "figures/captions.json",
        "report.md",
        "report.pdf",
        "report.html",
        "provenance.json",
        manifest.DRAWN_BY,
    }


@pytest.mark.parametrize("name", [*DRAWN, "paper"])
def test_the_page_needs_no_other_file(reports: dict[str, Path], whole: Path, name: str) -> None:
    """Python's parser: every figure is in it, every link leads to a part of it or to the paper, every tag is closed."""
    folder = whole if name == "paper" else reports[name]
    page = Page(folder / "report.html")
    images = [base64.b64decode(image.removeprefix(SVG), validate=True) for image in page.images]
    shown = re.findall(r"!\[\w+\]\((.+)\)", (folder / "report.md").read_text("utf-8"))
    assert images == [(folder / path).with_suffix(".svg").read_bytes() for path in shown]
    assert name == "paper" or {Path(path).stem for path in shown} == DRAWN[name]
    assert all(link.startswith((SVG, "#part-", "https://doi.org/")) for link in page.links)
    text = (folder / "report.html").read_text("utf-8").replace('<a href="https://doi.org/', "<a ")
    assert not page.open and not re.search("https?:|@import|url\\(", text)


def test_a_figure_too_large_as_svg_is_in_the_page_as_png(
    results: dict[str, Results], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "MAX_SVG", 50_000)
    write(tmp_path, Results(results["exp1"].settings[:1]), "exp1")
    images = Page(tmp_path / "report.html").images
    kinds = {path.stem: path.with_suffix(".svg").is_file() for path in tmp_path.glob("figures/*.png")}
    assert any(kinds.values()) and not all(kinds.values())
    assert sum(image.startswith(SVG) for image in images) == sum(kinds.values())
    assert sum(image.startswith("data:image/png;base64,") for image in images) == len(kinds) - sum(kinds.values())


@pytest.mark.parametrize("name", DRAWN)
def test_the_page_says_what_the_tables_say(reports: dict[str, Path], name: str) -> None:
    text = " ".join(Page(reports[name] / "report.html").text.split())
    table = pd.read_csv(reports[name] / "tables" / "claims.csv")
    assert set(table["claim"]) == {claim.name for claim in claims_about(name)}
    for statement in table["statement"]:
        assert statement in text
    medians = pd.read_csv(reports[name] / "tables" / "medians.csv")
    assert len(medians) > 0
    for center in medians["center"]:
        assert f"{center:.2f}".replace("-", "\N{MINUS SIGN}") in text
    assert NOTICE in text and COMMAND in text and "0123abc" in text


def test_the_page_and_the_pdf_have_one_content(results: dict[str, Results], tmp_path: Path) -> None:
    """Both are set from `report.md`; every word of it is in the HTML, in the same order."""
    write(tmp_path, results["exp4"], "exp4", notice=None)
    text = "".join(Page(tmp_path / "report.html").text.split())
    count = re.search(rb"/Type/Pages/Count (\d+)", (tmp_path / "report.pdf").read_bytes())
    assert count is not None and int(count.group(1)) >= 4
    parts = page.parse((tmp_path / "report.md").read_text("utf-8"))
    assert len(parts) > 30
    place = 0
    for part in parts:
        if part["kind"] != "table" and part.get("level") != 1:
            words = "".join(page.plain(part["parts"]).split())
            place = text.index(words, place if part["kind"] != "heading" else text.index(words, place))


def test_writing_twice_gives_the_same_bytes(
    results: dict[str, Results], reports: dict[str, Path], whole: Path, tmp_path: Path
) -> None:
    for name in DRAWN.keys() - {"exp5"}:
        shutil.copytree(reports[name], tmp_path / name)
    again = {name: tmp_path / name for name in DRAWN}
    write(again["exp5"], results["exp5"], "exp5")
    build.write(paper(tmp_path / "paper", results, again))
    for first, second in ((reports["exp5"], again["exp5"]), (whole, tmp_path / "paper")):
        for path in filter(Path.is_file, first.rglob("*")):
            assert path.read_bytes() == (second / path.relative_to(first)).read_bytes(), path.name


def test_a_complete_report_is_left_alone(results: dict[str, Results], tmp_path: Path) -> None:
    """As long as stages, arguments and code are the same, and so is every file; other names change it."""
    few = Results(results["exp1"].settings[:1])
    write(tmp_path, few, "exp1")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    write(tmp_path, few, "exp1")
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before
    renamed = settings("exp1").model_copy(update={"names": {"cem": "CEM"}})
    build.write(report(tmp_path, few, "exp1", renamed, NOTICE))
    assert json.loads((tmp_path / "provenance.json").read_text("utf-8"))["settings"]["names"] == {"cem": "CEM"}


def test_a_damaged_report_is_told_and_made_anew(results: dict[str, Results], tmp_path: Path) -> None:
    """A table changed, a figure gone; a file of the reader's own is none of the report's."""
    few = Results(results["exp1"].settings[:1])
    write(tmp_path, few, "exp1")
    table, figure = tmp_path / "tables/medians.csv", tmp_path / "figures/world.png"
    content = table.read_bytes()
    (tmp_path / "notes.txt").write_text("mine")
    assert manifest.problems(tmp_path) == []
    table.write_bytes(content.replace(b"1", b"2", 1))
    figure.unlink()
    assert manifest.problems(tmp_path) == [f"{figure} is missing.", f"{table} is not as it was written."]
    write(tmp_path, few, "exp1")
    assert table.read_bytes() == content and figure.is_file() and manifest.problems(tmp_path) == []


def test_other_code_draws_again_and_makes_no_report_wrong(
    results: dict[str, Results], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A published report is not bound to the code that drew it: nothing in its manifest tells of code."""
    few = Results(results["exp1"].settings[:1])
    write(tmp_path, few, "exp1")
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.png")}
    record = (tmp_path / "provenance.json").read_bytes()
    monkeypatch.setattr(manifest, "code", lambda: "0123456789abcdef")
    assert manifest.problems(tmp_path) == []
    write(tmp_path, few, "exp1")
    assert all(path.stat().st_mtime_ns > before for path, before in written.items())
    assert (tmp_path / "provenance.json").read_bytes() == record


def test_a_report_gives_way_to_one_of_newer_rules_and_to_no_other(tmp_path: Path) -> None:
    """By hand: the same configuration made by version 2 of its rules; another configuration."""
    old, new, other = Stage("train", {"seed": 0}), Stage("train", {"seed": 0}, {"data": 2}), Stage("train", {"seed": 1})
    for there in (old, new):
        entry = {"digest": there.digest} | ({"configuration": old.digest} if there.rules else {})
        manifest.save(tmp_path, {"stages": [entry]}, {})
        for stage in (old, new):
            manifest.check_output(tmp_path, [stage, other])
        with pytest.raises(ConfigError, match="holds the report of other results"):
            manifest.check_output(tmp_path, [other])
    assert new.configuration == old.digest == old.configuration != new.digest


def test_a_copy_of_a_report_is_whole_without_what_it_lacks(results: dict[str, Results], tmp_path: Path) -> None:
    """Its provenance lists what is there."""
    few = Results(results["exp1"].settings[:1])
    write(tmp_path / "exp1", few, "exp1")
    (tmp_path / "exp1/jobs").mkdir()
    manifest.copy(tmp_path / "exp1", tmp_path / "kept", ["*.pdf", "*.html"])
    assert manifest.problems(tmp_path / "kept") == []
    files = {str(path.relative_to(tmp_path / "kept")) for path in (tmp_path / "kept").rglob("*") if path.is_file()}
    assert {"report.pdf", "provenance.json", "figures/world.png"} <= files
    assert not {"report.html", "figures/world.pdf"} & files and not (tmp_path / "kept/jobs").exists()


def test_an_experiment_of_ones_own_has_no_claims(results: dict[str, Results], tmp_path: Path) -> None:
    """One setting without a context, and nothing of the paper to compare it with: no claims, no map."""
    plain = ReportSettings.model_validate(yaml.safe_load((CONF / "report/default.yaml").read_text("utf-8")))
    few = Results(results["exp1"].settings[:1])
    build.write(report(tmp_path, few, "mine", plain, None))
    assert set(pd.read_csv(tmp_path / "tables/runs.csv")["experiment"]) == {"mine"}
    text = Page(tmp_path / "report.html").text
    assert "claim" not in text and "Median mean distance" in text
    assert not list(tmp_path.glob("tables/claims.*")) and not (tmp_path / "figures" / "maps.png").exists()


def spoil(stages: Path, value: float) -> None:
    """Put one value in place of everything that the models of some stages have computed, on maps of two rows."""
    columns = ["validation_nll", "training_nll", "mean", "median", "prediction_error"]
    for path in stages.rglob("*.csv"):
        table = pd.read_csv(path)
        table.assign(**{column: value for column in columns if column in table}).to_csv(path, index=False)
    for path in stages.rglob("*.npz"):
        with np.load(path) as file:
            arrays = dict(file)
        if "codes" in arrays or "std" in arrays:
            arrays["y"] = arrays["y"][::100]
        for name in ("codes", "initial_codes", "snapshot_codes", "std"):
            if name in arrays:
                arrays[name] = np.full_like(arrays[name][..., ::100, :, :], value)
        for name in ("planned_position", "planned_std", "prediction_error"):
            if name in arrays:
                arrays[name] = np.full_like(arrays[name], value)
        np.savez(path, **arrays)


@pytest.mark.parametrize(("experiment", "value"), [("exp1", None), ("exp4", np.nan), ("exp1", np.inf)])
@pytest.mark.filterwarnings("ignore:.*(invalid value|overflow):RuntimeWarning")
def test_one_member_and_models_that_have_diverged_are_reported(
    write_stages: WriteStages, tmp_path: Path, experiment: str, value: float | None
) -> None:
    """One member, epoch and step, and losses that are no number or infinite: the report says what is missing."""
    jobs = write_stages(tmp_path / "stages", (0, 8), ("cem",), members=1, epochs=1, steps=1, experiment=experiment)
    if value is not None:
        spoil(tmp_path / "stages", value)
    write(tmp_path / "report", Results(tuple(jobs)), experiment)
    text = (tmp_path / "report/report.md").read_text("utf-8")
    assert "over 1 member;" in text
    assert ("not a finite number: 1 of 1 at C = 0 and 1 of 1 at C = 8." in text) == (value is not None)
    written = {path.stem for path in tmp_path.glob("report/figures/*.png")}
    assert written == DRAWN[experiment]


def test_text_of_the_configuration_is_text(write_stages: WriteStages, tmp_path: Path) -> None:
    """Broken mathematics, markup of Markdown, HTML, Typst and jinja, other scripts, and emoji without a glyph."""
    text = r"$\frac{x$ $ 5% A&B <i>|*c* `d` #e ~f~ [g](h) \n {{ title }} 🚀 שלום 模型"
    names = {"cem": text[:20], "gradient": text[20:40], "original": text}
    chosen = settings("exp1").model_copy(update={"names": names})
    jobs = write_stages(tmp_path / "stages", (8,), ("cem", "gradient"), members=1, epochs=1, steps=1)
    told = {"name": "mine", "title": text, "command": f"affmap {text}", "notice": text}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        build.write(ExperimentReport(tmp_path / "out", Results(tuple(jobs)), chosen, Room(), **told))
    parts = page.parse((tmp_path / "out/report.md").read_text("utf-8"))
    assert page.plain(parts[0]["parts"]) == text and page.plain(parts[1]["parts"]) == text
    shown = " ".join(Page(tmp_path / "out/report.html").text.split())
    assert shown.count(f"Command: affmap {text}") == 1 and f"({text[20:40]}): " in shown and f"“{text}”" in shown


def test_settings_that_colours_cannot_tell_apart_are_refused(results: dict[str, Results], tmp_path: Path) -> None:
    jobs = [*results["exp2"].settings, *(job for job in results["exp1"].settings if job.planner == "gradient")]
    with pytest.raises(ConfigError, match="several values of"):
        write(tmp_path, Results(tuple(jobs)), "exp1")
    assert not list(tmp_path.iterdir())


def test_the_notice_is_red_on_every_figure(reports: dict[str, Path]) -> None:
    for name, drawn in DRAWN.items():
        for figure in drawn:
            assert _red_pixels((reports[name] / "figures" / f"{figure}.png").read_bytes(), 60) > 500, (name, figure)


def test_the_notice_is_red_at_the_head_of_the_document(tmp_path: Path) -> None:
    pages = {
        notice: page.pdf(tmp_path, f"# Title\n\n**{notice}**\n", notice, format="png", ppi=72)
        for notice in ("", NOTICE)
    }
    assert _red_pixels(pages[""], 150) == 0 and _red_pixels(pages[NOTICE], 150) > 100


def test_provenance_lists_each_stage_once_and_only_what_differs(reports: dict[str, Path]) -> None:
    origin = json.loads((reports["exp1"] / "provenance.json").read_text("utf-8"))
    assert len(origin["stages"]) == 1 + 2 + 2 + 2 + 4
    assert origin["seconds"] == pytest.approx(11 * 12.5)
    assert origin["versions"] == [{"affmap": "0.1.0", "torch": "2.13.0", "numpy": "2.4.6"}]
    trained = [stage["differs"] for stage in origin["stages"] if stage["stage"] == "train"]
    assert trained == [{}, {"model.context_size": 8}]
    flown = json.loads((reports["exp2"] / "provenance.json").read_text("utf-8"))["stages"]
    names = {stage["differs"].get("control_layout.name") for stage in flown if stage["stage"] == "control"}
    assert names == {None, "two_obstacles", "twelve_obstacles"}


def test_captions_and_counts_state_the_verdicts_of_the_data(write_stages: WriteStages, tmp_path: Path) -> None:
    """By construction all claims hold; turned around, the first one does not."""
    results = Results(tuple(write_stages(tmp_path, (0, 1, 8), members=6)))
    names = ", ".join(f"I-{number}" for number in range(1, 9))
    scores = score(results, claims_about("exp1"))
    assert f"8 hold ({names})" in sentences.verdict_count(scores)
    results.last_epoch["validation_nll"] *= -1
    scores = score(results, claims_about("exp1"))
    assert "1 does not hold (I-1)" in sentences.verdict_count(scores)


def test_worlds_without_a_way_are_counted(results: dict[str, Results]) -> None:
    """By construction: the last of the four runs of each of two members, at two context sizes, in hard worlds."""
    (sentence,) = sentences.uncrossable(results["exp5"], settings("exp5"))
    assert sentence.startswith("In 4 (hard) of 32 runs")
    assert sentences.uncrossable(results["exp4"], settings("exp4")) == []


def test_random_worlds_are_described(results: dict[str, Results], monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: fog is taken out of the last two of eight worlds; layouts of a single world have no sentence."""
    assert sentences.mixtures(results["exp4"], settings("exp4")) == []
    assert sentences.mixtures(results["exp5"], settings("exp5"))[0] == (
        "Of the 8 random worlds “easy” 8 have all 4 properties."
    )
    worlds, runs = Results.run_layouts, results["exp5"].runs.query("layout == 'procedural_hard' and context_size == 8")

    def without_fog(self: Results, setting: Setting) -> list[Layout]:
        whole = worlds(self, setting)
        clear = [[circle for circle in world.circles if circle.effect != "fog"] for world in whole[-2:]]
        return whole[:-2] + [w.model_copy(update={"circles": tuple(c)}) for w, c in zip(whole[-2:], clear, strict=True)]

    monkeypatch.setattr(Results, "run_layouts", without_fog)
    share = runs["success"].iloc[:6].mean()
    assert sentences.mixtures(results["exp5"], settings("exp5"))[1] == (
        f"Of the 8 random worlds “hard” 6 have all 4 properties and 2 have no fog (in the others {share:.2f} of the "
        "runs at C = 8 succeed)."
    )


def test_random_worlds_are_described_where_the_first_planner_has_not_flown(results: dict[str, Results]) -> None:
    """As in a report of a part: hard worlds were flown by another planner only."""
    others = [
        replace(each, values={**each.values, "planner": "gradient"}) if each.layout == "procedural_hard" else each
        for each in results["exp5"].settings
    ]
    assert len(sentences.mixtures(Results(tuple(others)), settings("exp5"))) == 2


def test_remarks_are_made_once(results: dict[str, Results]) -> None:
    """Two claims of Experiment V share one, another has its own; Experiment I has none."""
    shared, own = sentences.remarks(score(results["exp5"], claims_about("exp5")))
    assert shared.startswith("On V-3 and V-4: that fog and force fields act")
    assert own.startswith("On V-5: the claim was added after")
    assert sentences.remarks(score(results["exp1"], claims_about("exp1"))) == []


def test_the_paper_has_every_claim_and_what_is_missing(whole: Path) -> None:
    page = Page(whole / "report.html")
    names = [claim.name for experiment in DRAWN for claim in claims_about(experiment)]
    table = pd.read_csv(whole / "tables" / "claims.csv")
    assert list(dict.fromkeys(table["claim"])) == names
    assert set(table.loc[table["missing"].notna(), "experiment"]) == {"exp5"}
    for name in names:
        assert re.search(rf"^{name}\D", page.text, re.MULTILINE)
    assert f"Of {len(names)} claims, " in page.text
    assert table["p_holm"].isna().all() and "Holm's correction for" not in page.text, "too few members for a p value"
    assert page.text.count(MISSING) == 2, "on the first page and in the section"
    assert page.text.count("so far: not all settings") == len(claims_about("exp5"))
    assert MISSING in page.text.split("statement")[0], "above the first table"


def test_the_paper_begins_with_its_authors_origin_and_reference(whole: Path) -> None:
    """Beside `CITATION.cff` and the stages, read here; on the first page, before any claim is named."""
    citation = yaml.safe_load((Path(__file__).parents[2] / "CITATION.cff").read_text("utf-8"))
    paper, record = citation["preferred-citation"], json.loads((whole / "provenance.json").read_text("utf-8"))
    first = Page(whole / "report.html").text.split("I-1")[0]
    for words in (citation["authors"][0]["name"], paper["title"], paper["authors"][-1]["family-names"]):
        assert words in first
    days = [stage["started"][:10] for each in record["experiments"].values() for stage in each["stages"]]
    assert f"results of {max(days)}" in first
    assert f"](https://doi.org/{paper['doi']})" in (whole / "report.md").read_text("utf-8")


def test_claims_are_stated_with_remarks_where_these_come_first(results: dict[str, Results]) -> None:
    scores = score(results["exp5"], claims_about("exp5"))
    own = {each.claim.name: each.claim.statement.rstrip(".") for each in scores}
    shared, _ = sentences.remarks(scores, stated=True)
    assert shared.startswith(f"On V-3 (“{own['V-3']}”) and V-4 (“{own['V-4']}”): that fog")


def test_a_claim_that_a_correction_undoes_is_named() -> None:
    """By hand: the smallest of three p values, 0.02, becomes 0.06."""

    def scored(name: str, p: float) -> Score:
        outcome = Outcome("a test", 25, statistics.verdict(p, 1 - p), p=p, p_opposite=1 - p)
        return Score(Claim(name, "It is so.", lambda _: ()), (Criterion("", "an effect", "u", outcome),))

    tests = [scored("A", 0.03), scored("B", 0.02), scored("C", 0.6)]
    assert sentences.correction(tests) == (
        "With Holm's correction for the 3 claims with a p value, A and B would not be decided."
    )
    assert sentences.correction([tests[0]]).endswith("the 1 claim with a p value, the same claims hold.")
    assert sentences.correction([]) == ""


def test_what_two_experiments_share_is_counted_once(results: dict[str, Results]) -> None:
    """By hand: Experiment II adds no data and no training; its two new worlds have the other three stages each."""
    first, second = provenance.costs([results["exp1"], results["exp2"]])
    stages = ("data", "train", "predict", "map", "control")
    assert [tuple(cost)[:2] for cost in first] == [*zip(stages, (1, 2, 2, 2, 4), strict=True)]
    assert [tuple(cost)[:2] for cost in second] == [*zip(stages, (0, 0, 4, 4, 4), strict=True)]
    assert [cost.seconds for cost in second] == [0.0, 0.0, 50.0, 50.0, 50.0]


def test_the_paper_refuses_figures_of_other_results(
    results: dict[str, Results], reports: dict[str, Path], tmp_path: Path
) -> None:
    wrong = Chapter("Experiment I", results["exp2"], settings("exp2"), open_room("mine", None), reports["exp1"], "")
    with pytest.raises(ValueError, match="holds no report of these results"):
        PaperReport(tmp_path, [wrong], "make paper", None)


def test_nouns_agree_with_their_numbers() -> None:
    """By hand."""
    assert [counted(number, "step") for number in (0, 1, 2)] == ["0 steps", "1 step", "2 steps"]


def test_points_are_titles_and_texts() -> None:
    """By hand."""
    assert points("- **A.** one\n  two\n- **B b.** three\n") == [("A.", "one two"), ("B b.", "three")]


def test_numbers_and_words_are_enumerated() -> None:
    """By hand."""
    assert (span([3, 1, 2]), span([4, 4])) == ("1 to 3", "4")
    assert [number(value) for value in (-1.234, 999_999.0, 1e6, -6.0986e10)] == [
        "\N{MINUS SIGN}1.23",
        "999999.00",
        "1.0e6",
        "\N{MINUS SIGN}6.1e10",
    ]
    assert [listed(words) for words in ([], ["a"], ["a", "b", "c"])] == [NOTHING, "a", "a, b and c"]


def test_a_deviation_is_told_where_it_was_run(results: dict[str, Results]) -> None:
    """Values of what was run are filled in; a point about something else is left out."""
    template = "- **A.** ${control_layout.name}\n- **B.** ${effect.force_up}\n- **C.** ${gradient.decay}\n"
    assert provenance.fill(template, [results["exp2"]]) == [("A.", "original")]
    assert provenance.fill(template, [results["exp5"], results["exp2"]]) == [
        ("A.", "procedural_easy"),
        ("B.", "pulls up"),
    ]


def _red_pixels(png: bytes, rows: int) -> int:
    top = matplotlib.image.imread(io.BytesIO(png))[:rows, :, :3]
    return int(((top[..., 0] > 0.9) & (top[..., 1:] < 0.4).all(axis=-1)).sum())
