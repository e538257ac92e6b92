"""Somebody else's files: reading them executes nothing, and one that is not what it should be is told in a sentence.

Each file would make a folder, the canary, if anything in it were executed; that the trap works is tested first.
"""

import io
import json
import os
import pickle
import shlex
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from commands import COMMANDS
from matplotlib.figure import Figure

from affmap.config import compose, notes, sweep
from affmap.config.root import Config
from affmap.data import batches as module
from affmap.data.collect import Exploration, collect
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.model.stack import ModelSettings, Stack
from affmap.model.weights import copy, restore, save
from affmap.report import page
from affmap.report.content import Content
from affmap.report.markdown import bullets, escape
from affmap.results import manifest, provenance
from affmap.results.setting import CONTEXT_SIZE, PLANNER, STAGES, ReportSettings, Setting
from affmap.results.tables import Results
from affmap.settings import ConfigError
from affmap.training.fit import fit, keep
from affmap.training.settings import TrainingSettings


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, canary: Path) -> None:
        self._canary = str(canary)

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (self._canary,)


@pytest.fixture
def canary(tmp_path: Path, tried: Callable[[str, int, str], None]) -> Iterator[Path]:
    """A place where nothing is, and must be nothing when the test ends."""
    tried("archives, weights, checkpoints, YAML and JSON made to run code when opened", 1, "nothing is executed")
    path = tmp_path / "canary"
    yield path
    assert not path.exists(), "something was executed"


def told(read: Callable[[], Any], *names: str) -> None:
    """Reading ends in one sentence with the file and the remedy."""
    with pytest.raises(ConfigError) as caught:
        read()
    message = str(caught.value)
    assert "\n" not in message and message.isprintable() and len(message) < 600
    assert not [part for part in (*names, "cannot be read", "remove its folder and run again.") if part not in message]


def stack() -> Stack:
    return Stack(ModelSettings.load("model", "default", context_size=1), 1, (0, 1))


def job(folder: Path) -> Setting:
    return Setting(
        {"model.context_size": 1, "planner": "cem", "control_layout": "original"}, dict.fromkeys(STAGES, (folder,))
    )


def test_the_trap_works(tmp_path: Path) -> None:
    """Without care every one of these would be executed."""
    for number, load in enumerate((pickle.loads, lambda data: torch.load(io.BytesIO(data), weights_only=False))):
        with pytest.raises(Exception) if number else io.BytesIO():  # noqa: PT011  (a bare pickle is no checkpoint)
            load(pickle.dumps(Bomb(tmp_path / f"canary{number}")))
        assert (tmp_path / f"canary{number}").is_dir()


READERS: dict[str, Callable[[Path], Any]] = {
    "dataset.npz": lambda folder: module.read(folder / "dataset.npz"),
    "coverage.npz": lambda folder: Results((job(folder),)).exploration(job(folder)),
    "maps.npz": lambda folder: Results((job(folder),)).maps(),
    "trajectories.npz": lambda folder: Results((job(folder),)).trajectories(job(folder)),
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("kind", ["objects", "text", "huge", "pickle", "torch", "cut", "empty", "other", "missing"])
def test_arrays(tmp_path: Path, canary: Path, name: str, kind: str) -> None:
    """Objects, text and a size of petabytes in every array, a pickle and a checkpoint in its place, and damage."""
    path = tmp_path / name
    names = ["position", "view", "action", "counts", "free", "coverage", "codes", "initial_codes", "goal", "member"]
    if kind == "objects":
        np.savez(path, **{key: np.array([Bomb(canary)], object) for key in names})
    elif kind == "text":
        np.savez(path, **dict.fromkeys(names, np.array(["text"])))
    elif kind == "huge":
        header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000,)}"
        with zipfile.ZipFile(path, "w") as archive:
            for key in names:
                archive.writestr(f"{key}.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    elif kind == "pickle":
        path.write_bytes(pickle.dumps(Bomb(canary)))
    elif kind == "torch":
        torch.save({"position": Bomb(canary)}, path)
    elif kind != "missing":
        np.savez(path, **({} if kind == "empty" else {"other": np.zeros(1000)}))
        if kind == "cut":
            path.write_bytes(path.read_bytes()[:500])
    told(lambda: READERS[name](tmp_path), str(path))


@pytest.mark.parametrize("kind", ["pickle", "torch", "huge", "cut", "empty", "another stack"])
def test_weights(tmp_path: Path, canary: Path, kind: str) -> None:
    """What is called safetensors and is not, or holds other weights."""
    path = tmp_path / "weights.safetensors"
    save(copy(stack()), path)
    if kind == "pickle":
        path.write_bytes(pickle.dumps(Bomb(canary)))
    elif kind == "torch":
        torch.save({"transition.hidden_weight": Bomb(canary)}, path)
    elif kind == "huge":
        entry = {"dtype": "F32", "shape": [10**15], "data_offsets": [0, 4 * 10**15]}
        header = json.dumps({"transition.hidden_weight": entry}).encode()
        path.write_bytes(len(header).to_bytes(8, "little") + header)
    elif kind == "another stack":
        save(copy(stack().select([0])), path)
    else:
        path.write_bytes(path.read_bytes()[: 100 if kind == "cut" else 0])
    told(lambda: restore(stack(), path), str(path))


@pytest.mark.parametrize("kind", ["bomb", "hyperparameters", "huge", "other types", "another stack"])
def test_a_checkpoint_to_resume_from(tmp_path: Path, canary: Path, kind: str) -> None:
    """A bomb alone, a bomb among what a checkpoint holds, petabytes, and the names of another module's weights; each is
    named by its digest, as ours are."""
    exploration = Exploration.load("data", "default", num_sequences=3, num_validation=1, num_steps=10)
    np.savez(
        tmp_path / "dataset.npz",
        allow_pickle=False,
        **collect([Layout.load("layout", "original")], Vehicle.load("vehicle", "default"), exploration),
    )
    settings = TrainingSettings.load("training", "default", num_epochs=1)
    data = module.DataModule(tmp_path / "dataset.npz", exploration, settings.batch_size, settings.chunk_length)
    whole = {"state_dict": stack().state_dict(), "epoch": 0, "global_step": 0}
    content = {
        "bomb": Bomb(canary),
        "hyperparameters": whole | {"x": Bomb(canary)},
        "huge": torch.zeros(200),
        "other types": {"state_dict": [7]},
        "another stack": whole,
    }[kind]

    def write(path: Path) -> None:
        torch.save(content, path, _use_new_zipfile_serialization=kind != "huge")
        if kind == "huge":  # 10**15 instead of 200 numbers
            path.write_bytes(path.read_bytes().replace(b"K\xc8", b"\x8a\x07" + (10**15).to_bytes(7, "little")))

    keep(tmp_path, write)
    (path,) = tmp_path.glob("*.ckpt")
    told(lambda: fit(stack(), data, settings, tmp_path, tmp_path), str(path))


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("layout/mine.yaml", ["world=mine"]),
        ("experiment/mine.yaml", ["experiment=mine"]),
        ("planner/mine.yaml", ["planner=mine"]),
    ],
)
@pytest.mark.parametrize("tag", ["!!python/object/apply:os.mkdir", "!!python/object/new:os.mkdir", "!!python/name:os."])
def test_configuration_files_with_python_in_them(
    own_conf: Path, canary: Path, file: str, line: list[str], tag: str
) -> None:
    """By our own reader of layouts and by Hydra's."""
    (own_conf / file).write_text(f"# @package _global_\nname: mine\ntitle: {tag} ['{canary}']\n")
    with pytest.raises(ConfigError, match=r"could not determine a constructor for the tag"):
        sweep.jobs(sweep.complete(line))
    with pytest.raises(yaml.constructor.ConstructorError):
        yaml.safe_load(f"{tag} ['{canary}']")


BOMB = "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{new}: &{new} [{','.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
"""Less than 400 bytes that mean 9^9 values, 400 million."""

KINDS = {
    "layout": ["world=mine"],
    "layout of training": ["training_layouts=[mine]"],
    "experiment": ["experiment=mine"],
    "planner": ["planner=mine"],
    "scale": ["scale=mine"],
    "hydra/launcher": ["hydra/launcher=mine"],
    "a file that is not chosen": [],
}


def test_files_that_explode(own_conf: Path, tried: Callable[[str, int, str], None]) -> None:
    """Aliases of aliases in files that affmap reads and in those that Hydra reads; written out, they take hours."""
    for kind, line in KINDS.items():
        group = kind.partition(" ")[0] if line else "search"
        path = own_conf / group / "mine.yaml"
        path.write_text(f"# @package _global_\n{BOMB}")
        with pytest.raises(ConfigError, match=rf"^conf/{group}/mine\.yaml has aliases that stand for more than 10000 "):
            sweep.jobs(sweep.complete(line))
        path.unlink()
    tried("400 bytes of YAML aliases of aliases in a file of conf", len(KINDS), "a sentence with the file")


@pytest.mark.parametrize("key", ["model", "planner", "training", "report", "vehicle"])
def test_nothing_of_a_configuration_is_instantiated(own_conf: Path, canary: Path, key: str) -> None:
    """`_target_` in a group and in an experiment is an unknown key; Hydra calls it for its own plugins only."""
    for line in ([f"+{key}._target_=os.mkdir", f"+{key}.path={canary}"], ["experiment=mine"]):
        (own_conf / "experiment" / "mine.yaml").write_text(
            f"# @package _global_\nname: mine\n{key}:\n  _target_: os.mkdir\n  path: {canary}\n"
        )
        with pytest.raises(ConfigError, match="_target_"):
            sweep.jobs(line)


TRAP = """
import os, pathlib
os.mkdir(pathlib.Path(__file__).with_name("canary"))
"""


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of a module that makes the canary when it is imported."""
    (tmp_path / "affmap_trap.py").write_text(TRAP)
    monkeypatch.syspath_prepend(tmp_path)
    yield "affmap_trap"
    sys.modules.pop("affmap_trap", None)


def test_the_trap_of_the_module_works(tmp_path: Path, trap: str) -> None:
    """On the user's own command line Hydra imports it."""
    with suppress(ConfigError):
        compose.compose([f"hydra.searchpath=[pkg://{trap}]"])
    assert (tmp_path / "canary").is_dir()


IGNORED = [
    "hydra.searchpath=[pkg://affmap_trap]",
    "++hydra.searchpath=[pkg://affmap_trap]",
    "hydra={searchpath: [pkg://affmap_trap]}",
    "hydra/launcher=slurm",
    "hydra.launcher.n_jobs=${oc.env:HOME}",
    "hydra.run.dir=/",
    "~hydra.sweep",
    "planner@hydra.sweeper=cem",
    "planner@_global_.hydra.sweeper=cem",
]
REFUSED = {
    "must not": [
        "title=${oc.env:HOME}",
        "'title=\"${oc.env:HOME}\"'",
        "title=$\\{oc.env\\:HOME\\}",
        "planner=${oc.env:HOME}",
        "training_layouts=['${oc.env:HOME}']",
        "sweep={seed: '${oc.env:HOME}'}",
        "title='a','${oc.env:HOME}'",
        "title='${now:%S}'",
        "hydra.sweep.dir=${oc.env:HOME}",
        "hydra.sweeper.num_trials=${oc.env:HOME}",
    ],
    "jobs": ["seed=range(1000000000)", "seed=range(0,1,1e-300)", "seed=range(1000) data.seed=range(1000)"],
    "combinations of files": ["title=" + ",".join(f"'a {number}'" for number in range(1001))],
    "corrupted": ["title=" + "[" * 30_000],
    "cannot be read": ["title=" + "[" * 1000, "seed=shuffle(range(9))"],
    "refers to": [" ".join(f"+x{depth}={f'${{x{depth + 1}}}' * 10}" for depth in range(9)) + " +x9=1"],
}


def test_a_note_of_a_sweep_reads_nothing_else_and_ends(
    tmp_path: Path, canary: Path, trap: str, tried: Callable[[str, int, str], None]
) -> None:
    """Command lines in a stranger's folder: Hydra's own keys are ignored; what reads more, or never ends, is told."""
    for line in IGNORED:
        notes.write_note(tmp_path, ["seed=1", line])
        assert notes.read_note(tmp_path) == ["seed=1"]
    for told, lines in REFUSED.items():
        for line in lines:
            notes.write_note(tmp_path, shlex.split(line) if line.startswith(("'", "seed", "+")) else [line])
            with pytest.raises(ConfigError, match=told) as caught:
                sweep.Sweep.read(notes.read_note(tmp_path))
            assert os.environ["HOME"] not in str(caught.value).replace(str(tmp_path), "")
    number = len(IGNORED) + sum(map(len, REFUSED.values()))
    tried("a command line in a stranger's folder that reads more than its own keys or never ends", number, "not obeyed")


def test_the_status_of_a_stranger_s_folder_imports_nothing(
    tmp_path: Path, canary: Path, trap: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Plain `affmap-status`, which looks at all that is in `runs`."""
    notes.write_note(tmp_path / "runs/evil", [f"hydra.searchpath=[pkg://{trap}]"])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["affmap-status"])
    COMMANDS["affmap-status"]()
    assert trap not in sys.modules and "A single setting" in capsys.readouterr().out


def test_what_is_stored_with_a_stage_is_not_composed(tmp_path: Path, canary: Path) -> None:
    """A stage's record with targets, tags and interpolations in its configuration: plain values."""
    config = {
        "_target_": "os.mkdir",
        "path": str(canary),
        "x": "${oc.env:HOME}",
        "y": "!!python/object/apply:os.mkdir",
    }
    record = {"stage": "data", "digest": "0", "config": config}
    (tmp_path / "provenance.json").write_text(json.dumps(record))
    results = Results((job(tmp_path),))
    assert results.provenance[tmp_path] == record
    assert provenance.leaves(record["config"]) == config


@pytest.mark.parametrize("text", ["", "[]", "{", "null", '{"stage": "data"}', "\udcff", "[" * 100_000])
def test_records_that_are_none(tmp_path: Path, text: str) -> None:
    """JSON that is damaged, or of something else."""
    path = tmp_path / "provenance.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    told(lambda: Results((job(tmp_path),)).provenance, str(path))
    with pytest.raises(ConfigError, match=f"^{path} is corrupted, .*; restore it, or make the report anew .*$"):
        manifest.stage_digests(tmp_path)


@pytest.mark.parametrize("text", ["", "\0", '"', "a,b\n1,2,3\n4,5,6,7,8\n", "=cmd|'/C calc'!A0"])
def test_tables_that_are_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "runs.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"runs\.csv .*remove its folder and run again\.$"):
        Results((job(tmp_path),)).runs  # noqa: B018


HOSTILE = [
    "<script>alert(1)</script>",
    "</title></style><img src=x onerror=alert(1)>",
    "{{ 7 * 7 }}{% include '/etc/passwd' %}",
    '#panic("typst")',
    '#read("/etc/passwd") #image("/nothing.png") #eval("1 + 1")',
    '"); #panic("quoted") //',
    "\\ $ * _ ` @label <label> [a] ]",
]


class Page(HTMLParser):
    """The elements and the text of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text = ""
        self.scripts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        assert not [name for name, _ in attrs if name.startswith("on")]

    def handle_data(self, data: str) -> None:
        if self.cdata_elem == "script":
            self.scripts.append(data)
        else:
            self.text += data


def test_text_of_others_is_text_in_reports(tmp_path: Path) -> None:
    """HTML, templates and Typst in title, notice, and all that a stage's record says of itself: shown as it stands.

    In Typst `#panic`, a file that is not there and an unclosed bracket would end the compilation.
    """
    (tmp_path / "figures").mkdir()
    for ending in ("png", "pdf"):
        Figure().savefig(tmp_path / "figures" / f"one.{ending}")
    for text in HOSTILE:
        record = {
            **{"git": [text], "versions": [{text: text}], "machine": [{"system": text}]},
            "stages": [{"stage": text, "digest": text, "started": text, "seconds": 1.0, "differs": {text: text}}],
        }
        results: Any = SimpleNamespace(x=CONTEXT_SIZE, color=PLANNER)
        settings = ReportSettings.load("report", "default")
        content = Content(text, text, results, (), settings, ["one"], {"one": text}, {**record, "report": text})
        parts = [f"# {content.title()}", content.notice(), content.player(), f"## {escape(text)}", escape(text)]
        parts += [bullets([escape(text)]), content.figure("one"), content.origins(), content.stages()]
        widget = {"data": {"text": text}, "caption": text, "legend": [("disc", "red", text)]}
        page.write(tmp_path, "\n\n".join(parts), text, {"player": widget})
        written = Page((tmp_path / "report.html").read_text("utf-8"))
        assert not {"iframe", "object", "embed"} & set(written.tags) and written.tags.count("img") == 1
        data, own = written.scripts
        assert json.loads(data) == {"text": text} and own == page.script()
        assert written.text.count(text) >= 10
        assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")


def test_hostile_text_can_be_no_title(tmp_path: Path) -> None:
    """What would end a line or turn its direction is refused with the configuration."""
    values = compose.values(compose.compose([]))
    assert Config.checked(values | {"title": HOSTILE[0]}, "here").title == HOSTILE[0]
    for text in ("a\nb", "a\x1b[31mb", "a\u202eb"):
        with pytest.raises(ConfigError, match="line of text"):
            Config.checked(values | {"notice": text}, "here")
