"""Whatever happens to reports, publishing and searches, the same command ends as undisturbed, or says what to do.

Real commands on small stages and reports, in forks (`disturbed.py`).
"""

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import disturbed
import pytest
from commands import in_process
from disturbed import EXPERIMENT, Small, alone, flip, places

import affmap
from affmap.cli import publish
from affmap.control import pretrained
from affmap.report import build
from affmap.results import manifest
from affmap.settings import ConfigError
from affmap.store.files import replace_folder, sha256
from affmap.store.provenance import PROVENANCE

REFERENCE = Path(__file__).parents[1] / "runs/reference"
Tried = Callable[[str, int, str], None]


@pytest.fixture(scope="module")
def attacks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, int]]:
    """Attack -> what went wrong, if anything, and how often it was tried; all in one process, which imports once."""
    return alone(disturbed.attack, tmp_path_factory.mktemp("attacks"))


@pytest.mark.parametrize("attack", disturbed.ATTACKS)
def test_attacks_cost_nothing(attack: str, attacks: dict[str, tuple[str, int]], tried: Tried) -> None:
    """Undisturbed commands, byte by byte, by the same command; see `disturbed.py` for each attack."""
    problem, times = attacks[attack]
    assert not problem, problem
    told = "the file is named, with a remedy that works; " if "bit" in attack else ""
    tried(attack, times, f"{told}the bytes of an undisturbed run")


@pytest.fixture
def published(tmp_path: Path) -> Path:
    """A copy of the reference run."""
    shutil.copytree(REFERENCE, tmp_path / "reference")
    return tmp_path / "reference"


def check(published: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    return in_process(monkeypatch, "affmap-publish", ["--check", f"reference={published / 'store'}"])


def test_every_damaged_file_of_the_published_run_is_told(
    published: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tried: Tried
) -> None:
    """A bit in each file; a table that no manifest lists, and a model beside the others; a report without manifest."""
    assert check(published, monkeypatch) == 0
    capsys.readouterr()
    files = [path for path in published.rglob("*") if path.is_file()]
    records = [path for path in files if path.name == PROVENANCE]
    for some in (records, [path for path in files if path.name != PROVENANCE]):  # a record tells of the others
        contents = {path: flip(path) for path in some}
        assert check(published, monkeypatch) == 1
        message = capsys.readouterr().err
        stages = {path.parent for path in some if path.is_relative_to(published / "store")}  # told by their first file
        names = [str(path) for path in some if path.parent not in stages] + [f"{folder}/" for folder in stages]
        assert not [name for name in names if name not in message]
        for path, content in contents.items():
            path.write_bytes(content)
    tried("a flipped bit in each file of the published run", len(files), "make check names the file")
    shutil.copy(published / "exp1/tables/runs.csv", published / "exp1/tables/better.csv")
    shutil.copytree(published / "exp1/tables", published / "exp11/tables")
    assert check(published, monkeypatch) == 1
    message = capsys.readouterr().err
    assert f"{published / 'exp1/tables/better.csv'} does not belong there." in message
    assert f"{published / 'exp11/tables/runs.csv'} is in no manifest." in message


def test_every_missing_folder_that_a_published_report_names_is_told(
    published: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One model, all models, one experiment, all of them; a report that nothing names is git's affair.

    Then everything: an empty folder, and none, are not as they were published.
    """
    models, papers = sorted((published / "store/train").iterdir()), sorted(published.glob("exp*"))
    assert len(models) == 50 and len(papers) == 13
    away = published.with_name("away")
    away.mkdir()
    for folders in (models[:1], models, papers[1:2], papers):
        for folder in folders:
            folder.rename(away / folder.name)
        assert check(published, monkeypatch) == 1
        message = capsys.readouterr().err
        assert not [folder for folder in folders if f"{folder} is missing, which {published}/" not in message]
        assert len({*re.findall(r"(\S+) is missing", message)}) == len(folders)
        for folder in folders:
            (away / folder.name).rename(folder)
    shutil.rmtree(published / "replication")  # named by nothing: its models are not kept either
    assert check(published, monkeypatch) == 0
    for path in published.iterdir():
        shutil.rmtree(path)
    for _ in range(2):
        assert check(published, monkeypatch) == 1
        assert f"{published} holds nothing that was published." in capsys.readouterr().err
        shutil.rmtree(published, ignore_errors=True)


def test_an_agent_never_flies_with_a_record_that_was_changed(published: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One bit: `beta` is 3 instead of 1."""
    monkeypatch.setattr(pretrained, "reference", lambda: published)
    assert affmap.load("exp1").settings.beta == 1
    path = published / "exp1" / PROVENANCE
    text = path.read_text("utf-8")
    path.write_text(text.replace('"beta": 1.0', '"beta": 3.0', 1), "utf-8")
    with pytest.raises(ConfigError, match=f"^{path} is corrupted, .*; restore it, or make the report anew"):
        affmap.load("exp1")


def report(folder: Path) -> Small:
    small = Small(folder / "exp1", [])
    build.write(small)
    return small


@pytest.mark.parametrize("text", ["", "{", '{"files": {}}', "[]", None])
def test_a_report_with_a_torn_record_is_made_anew(tmp_path: Path, text: str | None) -> None:
    """As earlier versions left it after a kill or on a full disk; logs beside it stay."""
    output = report(tmp_path).output
    whole = (output / PROVENANCE).read_bytes()
    (output / "jobs").mkdir()
    (output / "jobs/affmap.log").write_text("log")
    (output / PROVENANCE).write_text(text) if text is not None else (output / PROVENANCE).unlink()
    manifest.check_output(output, [])
    with pytest.raises(ConfigError, match="holds no report of these results" if text is None else "is corrupted"):
        build.check(Small(output, []))
    report(tmp_path)
    assert (output / PROVENANCE).read_bytes() == whole and manifest.problems(output) == []
    assert (output / "jobs/affmap.log").read_text() == "log"


def test_a_verdict_that_was_edited_is_not_published(tmp_path: Path) -> None:
    """`sed` in the table of claims: refused, and nothing is there; the report made anew is published."""
    small = report(tmp_path)
    table = small.output / "tables/claims.csv"
    table.write_text(table.read_text().replace("new", "holds"))
    with pytest.raises(ConfigError, match=rf"^{table} is not as it was written\.\nRun affmap-report again"):
        manifest.copy(small.output, tmp_path / "kept", publish.WITHOUT)
    assert not (tmp_path / "kept").exists()
    build.write(small)
    manifest.copy(small.output, tmp_path / "kept", publish.WITHOUT)
    assert manifest.problems(tmp_path / "kept", others=False) == []


def test_only_files_that_the_report_lists_are_published(tmp_path: Path) -> None:
    """A file of somebody else's and a link to a secret beside the figures are left; a listed file that is a link now,
    and a name that leads out of the folder, are refused."""
    output = report(tmp_path).output
    secret = tmp_path / "secret.txt"
    secret.write_text("secret")
    (output / "figures/link.png").symlink_to(secret)
    (output / "linked").symlink_to(tmp_path)
    (output / "tables/more.csv").write_text("more")
    manifest.copy(output, tmp_path / "kept", publish.WITHOUT)
    names = {
        path.relative_to(tmp_path / "kept").as_posix() for path in (tmp_path / "kept").rglob("*") if path.is_file()
    }
    assert names == {
        "provenance.json",
        "report.md",
        "report.pdf",
        "figures/new.png",
        "tables/claims.csv",
        "tables/runs.csv",
    }
    record = manifest.read(output)
    manifest.save(output, record, {**record["files"], "../secret.txt": sha256(secret)})
    with pytest.raises(ConfigError, match=r"\.\./secret\.txt is missing"):
        manifest.copy(output, tmp_path / "kept", publish.WITHOUT)
    manifest.save(output, record, {**record["files"], str(secret): sha256(secret)})
    with pytest.raises(ConfigError, match="is corrupted"):
        manifest.copy(output, tmp_path / "kept", publish.WITHOUT)
    manifest.save(output, record, record["files"])
    (output / "report.md").rename(tmp_path / "report.md")
    (output / "report.md").symlink_to(tmp_path / "report.md")
    with pytest.raises(ConfigError, match=r"report\.md is missing"):
        manifest.copy(output, tmp_path / "kept", publish.WITHOUT)
    build.write(Small(output, []))
    assert not (output / "report.md").is_symlink() and (output / "tables/more.csv").read_text() == "more"


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        ("tune", "has {}/tune/cem/"),
        ("factors", "has {}/factors/acts/"),
        ("store", "has {}/store/train/"),
        ("bench", "is the report '"),
        ("exp2", "is the report 'Experiment II"),
        ("exp1/tables", "lies in the report {}/exp1;"),
        ("exp1/mine", "lies in the report {}/exp1;"),
        ("exp1/report.md", "lies in the report {}/exp1;"),
        ("notes", "has {}/notes/mine.md, which is not of this report"),
        ("notes.txt", "has {}/notes.txt, which is not of this report"),
        ("bare", "has no provenance.json"),
    ],
)
def test_a_report_is_published_in_the_place_of_nothing_else(
    reference: Path, tmp_path: Path, place: str, reason: str
) -> None:
    """Folders of several reports, other reports, folders in them, files of somebody else: all stay as they are."""
    output = report(tmp_path).output
    before = disturbed.contents(reference)
    with pytest.raises(ConfigError) as caught:
        manifest.copy(output, reference / place, publish.WITHOUT)
    message = str(caught.value)
    assert message.startswith(f"the report would be published as {reference / place}, which {reason.format(reference)}")
    assert message.endswith("; give output= another name, or move what is there.")
    assert disturbed.contents(reference) == before


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the reference run that no test changes, with files of somebody else."""
    folder = tmp_path_factory.mktemp("published") / "reference"
    shutil.copytree(REFERENCE, folder)
    for name in ("notes/provenance.json", "notes/mine.md", "notes.txt", "bare/report.md"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("mine")
    return folder


@pytest.mark.parametrize("text", [None, "", "{"])
def test_an_earlier_copy_of_a_report_is_replaced(tmp_path: Path, text: str | None) -> None:
    """An intact one, of another edition with other files; one whose record is torn."""
    edition = "new" if text is not None else "old"
    build.write(Small(tmp_path / "exp1", [], edition))
    manifest.copy(tmp_path / "exp1", tmp_path / "kept", publish.WITHOUT)
    if text is not None:
        (tmp_path / "kept" / PROVENANCE).write_text(text)
    output = report(tmp_path).output
    manifest.copy(output, tmp_path / "kept", publish.WITHOUT)
    assert manifest.problems(tmp_path / "kept", others=False) == []
    assert manifest.read(tmp_path / "kept")["edition"] == "new"


def test_a_file_that_changes_while_it_is_copied_is_not_published(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = report(tmp_path).output
    copied = shutil.copy

    def copy(source: Path, target: Path) -> None:
        copied(source, target)
        target.write_text("changed")

    monkeypatch.setattr("affmap.store.files.shutil.copy", copy)
    with pytest.raises(ConfigError, match="was changed while it was copied; run the same command again"):
        manifest.copy(output, tmp_path / "kept", publish.WITHOUT)
    assert not (tmp_path / "kept").exists()


def test_a_folder_between_two_renames_is_taken_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: a kill has left the old folder under its other name, and no target; first the next call fails, too."""

    def fail(_: Path) -> None:
        raise OSError("nothing can be written")

    for name, text in ((".kept.old", "old"), ("new", "new")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(text)
    with monkeypatch.context() as patch:
        patch.setattr("affmap.store.files.sync", fail)
        with pytest.raises(OSError, match="nothing can be written"):
            replace_folder(tmp_path / "new", tmp_path / "kept")
    assert (tmp_path / "kept/file").read_text() == "old"
    replace_folder(tmp_path / "new", tmp_path / "kept")
    assert (tmp_path / "kept/file").read_text() == "new" and [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_the_best_trial_is_that_of_the_checked_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`results.csv` is for readers: an edit changes no report. A bit in `trials.jsonl` is told by each command."""
    folder = tmp_path / "runs"
    folder.mkdir()
    alone(disturbed.run_search, folder)
    arguments = [*disturbed.SEARCH, *places(folder)]
    jobs = folder / "exp1/jobs"
    table = (jobs / "results.csv").read_text()
    (jobs / "results.csv").write_text(re.sub(r"(?m)^1,ok,[\d.]+", "1,ok,-99", table))
    assert in_process(monkeypatch, "affmap-report", arguments) == 0
    assert "-99" not in (text := capsys.readouterr().out) and "−99" not in text
    assert (folder / "exp1/tables/trials.csv").read_text() == table
    assert in_process(monkeypatch, "affmap-report", ["--check", *arguments]) == 0
    content = flip(jobs / "trials.jsonl")
    for entry, flags in (("affmap", []), ("affmap-report", []), ("affmap-report", ["--check"]), ("affmap-status", [])):
        assert in_process(monkeypatch, entry, [*flags, *arguments]) == 2
        assert f"{jobs / 'trials.jsonl'} is corrupted: it was cut off or edited; restore it," in capsys.readouterr().err
    (jobs / "trials.jsonl").write_bytes(content)
    flip(jobs / "sweep.json")
    assert in_process(monkeypatch, "affmap-status", [str(folder / "exp1")]) == 2
    assert f"{jobs / 'sweep.json'} is corrupted; give the overrides" in capsys.readouterr().err
    assert in_process(monkeypatch, "affmap-status", arguments) == 0


def test_a_full_disk_under_a_report_is_named_with_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A real one of 100 KiB, and a report of 16 KiB files; the earlier report stays, and with room again it is made."""
    folder = tmp_path / "small"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=100k", "tmpfs", str(folder)], check=False).returncode:
        pytest.skip("a file system of a given size can be mounted by the administrator only")
    try:
        earlier = report(folder)
        record = (earlier.output / PROVENANCE).read_bytes()
        large = Small(earlier.output, [], "large " * 3000)
        monkeypatch.setattr("affmap.cli.report.make_report", lambda _: large)
        monkeypatch.setattr("affmap.cli.tables.show", lambda _: None)  # it has none
        arguments = [*EXPERIMENT, *places(folder)]
        monkeypatch.setattr(Small, "draw", draw_large)
        assert in_process(monkeypatch, "affmap-report", arguments) == 1
        message = capsys.readouterr().err
        drawn = folder / ".exp1.drawn"
        assert re.fullmatch(rf"The disk of {drawn}/\w.* is full; make room and run the same command again\.\n", message)
        assert (earlier.output / PROVENANCE).read_bytes() == record and manifest.problems(earlier.output) == []
        assert not drawn.exists()
        subprocess.run(["mount", "-o", "remount,size=5m", str(folder)], check=True)
        assert in_process(monkeypatch, "affmap-report", arguments) == 0
        assert manifest.problems(earlier.output) == [] and manifest.read(earlier.output)["edition"] == large.edition
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def draw_large(self: Small, folder: Path) -> None:
    for name in ("tables/a.csv", "report.md", "report.pdf"):
        build.write_text(folder / name, self.edition * 2)


def test_make_check_verifies_what_is_published() -> None:
    """That the published run is whole is asserted above, of a copy."""
    makefile = (REFERENCE.parents[1] / "Makefile").read_text("utf-8")
    assert "affmap-publish --check" in makefile.split("\ncheck:")[1].split("\n\n")[0]
