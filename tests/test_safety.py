"""Somebody else's files: reading them executes nothing, and one that is not what it should be is told in a sentence.

Each file would make a folder, the canary, if anything in it were executed; that the trap works is tested first.
"""

import io
import json
import os
import pickle
import shutil
import zipfile
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from matplotlib.figure import Figure

from affmap.config import compose, sweep
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
from affmap.settings import ConfigError, read
from affmap.training.fit import fit, keep
from affmap.training.settings import TrainingSettings


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, canary: Path) -> None:
        self._canary = str(canary)

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (self._canary,)


@pytest.fixture
def canary(tmp_path: Path) -> Iterator[Path]:
    """A place where nothing is, and must be nothing when the test ends."""
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


@pytest.fixture
def own_conf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the configuration folder, for all that reads it."""
    conf = tmp_path / "conf"
    shutil.copytree(Path(__file__).parents[1] / "conf", conf)
    monkeypatch.setattr("affmap.settings.base.folder", lambda: conf)
    monkeypatch.setattr("affmap.config.compose.folder", lambda: conf)
    read.cache_clear()
    yield conf
    read.cache_clear()


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


@pytest.mark.parametrize("key", ["model", "planner", "training", "report", "vehicle"])
def test_nothing_of_a_configuration_is_instantiated(own_conf: Path, canary: Path, key: str) -> None:
    """`_target_` in a group and in an experiment is an unknown key; Hydra calls it for its own plugins only."""
    for line in ([f"+{key}._target_=os.mkdir", f"+{key}.path={canary}"], ["experiment=mine"]):
        (own_conf / "experiment" / "mine.yaml").write_text(
            f"# @package _global_\nname: mine\n{key}:\n  _target_: os.mkdir\n  path: {canary}\n"
        )
        with pytest.raises(ConfigError, match="_target_"):
            sweep.jobs(line)


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
    told(lambda: manifest.stage_digests(tmp_path), str(path))


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
