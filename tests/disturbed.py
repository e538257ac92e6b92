"""Commands that are killed at each change of the file system, and commands that run side by side.

Stages hold a few bytes, and a report (`Small`) draws nothing, so that a command takes a fraction of a second. All runs
are forked from one process that has imported everything (`alone`).
"""

import os
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from sweeps import CONTEXT

CHANGES = {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate", "os.link", "os.symlink"}
"""Audit events of changes of the file system, besides files that are opened for writing."""

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

Contents = dict[str, bytes]
Command = Callable[[], None]

EXPERIMENT = ["experiment=exp1", "planner=cem", "model.context_size=0", "members=1", "baselines=[]"]


def alone(function: Callable[..., Any], *arguments: Any) -> Any:
    """The result of a function of this module, in a process of its own with a single thread."""
    receiver, sender = CONTEXT.Pipe(duplex=False)
    process = CONTEXT.Process(target=_send, args=(sender, function, arguments))
    process.start()
    sender.close()
    error, result = receiver.recv()
    process.join()
    assert not error, error
    return result


def _send(sender: Any, function: Callable[..., Any], arguments: Sequence[Any]) -> None:
    try:
        sender.send(("", function(*arguments)))
    except BaseException:
        sender.send((traceback.format_exc(), None))


def fork(body: Command, folder: Path, at: int | None = None) -> tuple[int, int]:
    """Start `body` in a fork that is killed at its change number `at` of files in `folder`; returns process and pipe.

    A file that was to be written then is empty.
    """
    reader, writer = os.pipe()
    if process := os.fork():
        os.close(writer)
        return process, reader
    os.setsid()
    status, changes = 9, 0

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal changes
        path = arguments[0] if arguments and isinstance(arguments[0], str) else None
        writes = event == "open" and arguments[2] & WRITING
        if not path or not (writes or event in CHANGES) or (os.path.isabs(path) and not path.startswith(str(folder))):
            return
        changes += 1
        if changes == at:
            if writes and arguments[2] & os.O_TRUNC:
                os.truncate(path, 0) if os.path.exists(path) else os.close(os.open(path, os.O_WRONLY | os.O_CREAT))
            os.kill(os.getpid(), signal.SIGKILL)

    try:
        output = os.open(folder.with_suffix(".txt"), os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(output, 1)
        os.dup2(output, 2)
        sys.addaudithook(watch)
        body()
        status = 0
    except SystemExit as leaving:
        status = int(leaving.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os.write(writer, str(changes).encode())
        os._exit(status)


def finish(started: tuple[int, int]) -> tuple[int, int]:
    """Exit status of a fork, negative for a signal, and the number of changes that it made."""
    process, reader = started
    with os.fdopen(reader) as pipe:
        changes = pipe.read()
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), int(changes or 0)


def succeed(body: Command, folder: Path) -> int:
    """Run `body` in a fork; returns the number of its changes."""
    status, changes = finish(fork(body, folder))
    assert status == 0, said(folder)
    return changes


def said(folder: Path) -> str:
    """Take what the forks have said so far."""
    path = folder.with_suffix(".txt")
    text = path.read_text("utf-8")
    path.unlink()
    return text


def contents(folder: Path) -> Contents:
    """Name -> content of every file, but for logs, and the locks of commands that were killed."""
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix not in (".lock", ".log"))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def kill_everywhere(
    body: Command,
    folder: Path,
    check: Callable[[], None] = lambda: None,
    step: int = 1,
) -> int:
    """Kill `body` at each change (each `step`-th) and run it again: always the files of an undisturbed run.

    Args:
        body: changes files in `folder`.
        folder: as it should be before each kill.
        check: of the folder after each kill.
        step: between kills.

    Returns:
        The number of kills.
    """
    before = folder.with_name(f"{folder.name}.before")
    shutil.copytree(folder, before, symlinks=True)
    last = succeed(body, folder)
    expected = contents(folder)
    kills = range(1, last + 1, step)
    for number in kills:
        shutil.rmtree(folder)
        shutil.copytree(before, folder, symlinks=True)
        assert finish(fork(body, folder, number))[0] == -signal.SIGKILL, said(folder)
        check()
        succeed(body, folder)
        actual = contents(folder)
        different = [name for name in actual.keys() | expected.keys() if actual.get(name) != expected.get(name)]
        assert not different, f"after kill {number} of {last}: {different}"
    return len(kills)


@dataclass(frozen=True)
class Small:
    """A report of a few files; see `build.Report`."""

    output: Path
    stages: Sequence[Any]
    edition: str = "new"
    notice: str | None = None

    @property
    def record(self) -> dict[str, Any]:
        stages = [{"digest": each.digest, "configuration": each.configuration} for each in self.stages]
        return {"edition": self.edition, "stages": stages, "jobs": []}

    @property
    def page(self) -> Path:
        return self.output / "report.pdf"

    def draw(self, folder: Path) -> None:
        from affmap.report.build import write_text

        for name in ("tables/runs.csv", "tables/claims.csv", f"figures/{self.edition}.png", "figures/a.svg"):
            write_text(folder / name, f"{name}: {self.edition}\n")
        for name in ("report.md", "report.pdf", "report.html"):
            write_text(folder / name, f"{name}: {self.edition}\n")


def places(folder: Path) -> list[str]:
    return [f"store={folder / 'store'}", f"reference={folder / 'reference/store'}", f"output={folder / 'exp1'}"]


def write_stages(overrides: Sequence[str]) -> None:
    """Write all stages of a sweep, a few bytes each."""
    from affmap.cli.app import read_sweep
    from affmap.pipeline.job import all_stages, open_store
    from affmap.store.attempt import Attempt

    def build(attempt: Attempt, digest: str) -> None:
        for name in ("weights.safetensors", "validation.csv", "other.npz"):
            (attempt.folder / name).write_text(f"{name} of {digest}")

    sweep = read_sweep(overrides)
    for stage in all_stages(sweep):
        open_store(sweep.first).ensure(stage, partial(build, digest=stage.digest))


def command(name: str, *arguments: str, edition: str = "new") -> Command:
    """A command whose reports are small ones; its command lines are composed once, for all forks."""
    from affmap.cli import paper, publish, report, run, status
    from affmap.cli.app import read_jobs
    from affmap.cli.report import Report
    from affmap.config.overrides import replace_experiment
    from affmap.config.sweep import complete
    from affmap.experiments import ROOMS
    from affmap.experiments.paper import report as papers
    from affmap.pipeline.job import all_stages
    from affmap.report import build  # noqa: F401

    def make(jobs: Any) -> Report:
        if hasattr(jobs, "trials"):
            return make_search_report(jobs)
        return Small(jobs.first.output, all_stages(jobs), edition)

    def make_paper(output: Path, chapters: Sequence[Any], *_: Any) -> Report:
        checked(output, chapters, "", None)  # its chapters' reports
        return Small(output, [], edition)

    def body() -> None:
        report.make_report = publish.make_report = make
        papers.PaperReport = make_paper
        report.tables.show = lambda folder: None  # a small report's tables hold no numbers
        report.read_jobs = publish.read_jobs = lambda overrides: known.get(tuple(overrides)) or read_jobs(overrides)
        paper.read_sweep = lambda overrides: known.get(tuple(overrides)) or read_jobs(overrides)
        sys.argv = [name, *arguments]
        modules[name].main()

    overrides = [argument for argument in arguments if "=" in argument]
    lines = [overrides, *(replace_experiment(complete(overrides), room, ("output",)) for room in ROOMS)]
    known = {tuple(line): read_jobs(line) for line in (lines if name == "affmap-paper" else lines[:1])}
    make_search_report, checked = report._make_search_report, papers.PaperReport
    modules: Mapping[str, Any] = {
        "affmap": run,
        "affmap-report": report,
        "affmap-publish": publish,
        "affmap-paper": paper,
        "affmap-status": status,
    }
    return body


def kill_reports(folder: Path) -> int:
    """Kill `affmap-report`, of a new report and in place of one of another edition that has other files."""
    overrides = [*EXPERIMENT, *places(folder)]
    write_stages(overrides)
    kills = kill_everywhere(command("affmap-report", *overrides), folder)
    shutil.rmtree(folder.with_name(f"{folder.name}.before"))
    kills += kill_everywhere(command("affmap-report", *overrides, edition="newer"), folder)
    assert not (folder / "exp1/figures/new.png").exists() and (folder / "exp1/figures/newer.png").exists()
    return kills


def kill_publishing(folder: Path) -> int:
    """Kill `affmap-publish`: nothing is published yet; an earlier report is, and is never lost."""
    from affmap.results import manifest

    def kept() -> None:
        copies = [target for target in (published, published.with_name(".exp1.old")) if target.exists()]
        assert [target for target in copies if not manifest.problems(target, others=False)], "it is lost"
        assert all(any(place.exists() for place in (train, train.with_name(f".{train.name}.old"))) for train in trains)

    overrides = [*EXPERIMENT, *places(folder)]
    published = folder / "reference/exp1"
    write_stages(overrides)
    succeed(command("affmap-report", *overrides), folder)
    kills = kill_everywhere(command("affmap-publish", *overrides), folder)
    shutil.rmtree(folder.with_name(f"{folder.name}.before"))
    trains = [*folder.glob("reference/store/train/*")]
    succeed(command("affmap-report", *overrides, edition="newer"), folder)
    kills += kill_everywhere(command("affmap-publish", *overrides, edition="newer"), folder, kept)
    succeed(command("affmap-publish", "--check", f"reference={folder / 'reference/store'}"), folder)
    return kills


def at_once(folder: Path) -> int:
    """Three reports at once, then three more and three publishes: the files of one."""
    overrides = [*EXPERIMENT, *places(folder)]
    write_stages(overrides)
    report, publish = command("affmap-report", *overrides), command("affmap-publish", *overrides)
    alone = folder.with_name("alone")
    shutil.copytree(folder, alone)
    succeed(report, folder)
    succeed(publish, folder)
    expected = contents(folder)
    shutil.rmtree(folder)
    alone.rename(folder)
    for bodies in ([report] * 3, [report, publish] * 3):
        started = [fork(body, folder) for body in bodies]
        assert [finish(each)[0] for each in started] == [0] * len(bodies), said(folder)
    assert contents(folder) == expected
    assert not [path for path in folder.rglob(".*") if path.name != ".drawn_by"], "nothing is left behind"
    return 1


def flip(path: Path) -> bytes:
    """Flip a bit in the middle of a file; returns what it was."""
    content = path.read_bytes()
    place = len(content) // 2
    path.write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
    return content


def flip_everywhere(folder: Path) -> int:
    """Flip a bit in every file of a report, of its published copy and of its published models, one at a time.

    The file is named by a check and by the commands that read it, and the same commands make it anew.
    """
    overrides = [*EXPERIMENT, *places(folder)]
    write_stages(overrides)
    report, publish = command("affmap-report", *overrides), command("affmap-publish", *overrides)
    check = command("affmap-report", "--check", *overrides)
    check_published = command("affmap-publish", "--check", f"reference={folder / 'reference/store'}")
    succeed(report, folder)
    succeed(publish, folder)
    expected = contents(folder)
    own = [path for path in sorted(folder.glob("exp1/**/*")) if path.is_file() and path.name != ".drawn_by"]
    kept = [path for path in sorted(folder.glob("reference/**/*")) if path.is_file()]
    for path in own + kept:
        flip(path)
        refused = [(check, 1), (publish, 2)] if path in own else [(check_published, 1)]
        for body, status in refused:
            folder.with_suffix(".txt").unlink(missing_ok=True)
            assert finish(fork(body, folder))[0] == status
            assert str(path) in (message := said(folder)) and "Traceback" not in message, message
            assert "anew" in message
        succeed(report if path in own else publish, folder)
        assert contents(folder) == expected, path
    return len(own + kept)


def kill_paper(folder: Path) -> int:
    """Kill `affmap-paper --publish` in a folder `runs`."""
    from affmap import experiments

    few = ["planner=cem", "model.context_size=0", "members=1", "baselines=[]", "growth=null"]
    os.chdir(folder.parent)
    experiments.ROOMS = ("exp1",)  # the others are more of the same
    for name in experiments.ROOMS:
        write_stages([*few, f"experiment={name}"])
        succeed(command("affmap-report", *few, f"experiment={name}"), folder)
    return kill_everywhere(command("affmap-paper", "--publish", *few), folder)


SEARCH = ["search=cem", "hydra.sweeper.num_trials=2", "hydra.sweeper.batch_size=1"]


def small_search(folder: Path) -> Command:
    """A search of a small application."""
    import hydra
    from hydra.core.plugins import Plugins
    from omegaconf import DictConfig, OmegaConf

    Plugins.instance()  # imports the sweeper anew
    from hydra_plugins.hyperopt_sweeper import hyperopt_sweeper

    def body() -> None:
        hyperopt_sweeper.time = SimpleNamespace(perf_counter=lambda: 0.0)
        quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none", "hydra.output_subdir=null"]
        sys.argv = ["app.py", "-m", "hydra/sweeper=hyperopt", "hydra.sweeper.num_trials=2", *quiet]
        sys.argv += [f"hydra.sweep.dir={folder / 'sweep'}", "x=interval(0,1)"]
        hydra.main(version_base="1.3", config_path=str(folder), config_name="config")(task)()

    def task(config: DictConfig) -> float:
        return (config.x - 0.3) ** 2

    OmegaConf.save(OmegaConf.create({"x": 0.0}), folder / "config.yaml")
    return body


def search(folder: Path) -> Command:
    """A search of affmap whose trials take no time and are numbers."""
    from affmap.pipeline import execution
    from hydra_plugins.hyperopt_sweeper import hyperopt_sweeper

    def body() -> None:
        execution.score = lambda config: float(config.planner.num_iterations)
        hyperopt_sweeper.time = SimpleNamespace(perf_counter=lambda: 0.0)
        run()

    run = command("affmap", *SEARCH, *places(folder), "hydra/launcher=basic")
    return body


def run_search(folder: Path) -> None:
    """Run `affmap search=cem`."""
    succeed(search(folder), folder)


def kill_search(folder: Path) -> int:
    """Kill a search of a small application."""
    return kill_everywhere(small_search(folder), folder)


def kill_search_report(folder: Path) -> int:
    """Kill `affmap-report search=cem`, which draws a real figure."""
    run_search(folder)
    return kill_everywhere(command("affmap-report", *SEARCH, *places(folder)), folder, step=13)


ATTACKS: dict[str, Callable[[Path], int]] = {
    "SIGKILL at each change of the file system by affmap-report": kill_reports,
    "SIGKILL at each change of the file system by affmap-publish": kill_publishing,
    "SIGKILL at each change of the file system by a search": kill_search,
    "SIGKILL at changes of the file system by affmap-report of a search": kill_search_report,
    "SIGKILL at each change of the file system by affmap-paper --publish": kill_paper,
    "three reports at once, then three reports and three publishes": at_once,
    "a flipped bit in each file of a report and of what is published of it": flip_everywhere,
}
"""Attack -> function that tries it in a folder, and returns how often."""


def attack(root: Path) -> dict[str, tuple[str, int]]:
    """Attack -> what went wrong, if anything, and how often it was tried."""
    outcomes = {}
    for name, function in ATTACKS.items():
        folder = root / function.__name__ / "runs"
        folder.mkdir(parents=True)
        try:
            outcomes[name] = ("", function(folder))
        except BaseException:
            outcomes[name] = (traceback.format_exc(), 0)
    return outcomes
