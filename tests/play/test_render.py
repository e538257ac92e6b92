"""Films: read back, against the flights that they show."""

import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pygame
import pytest

import affmap
from affmap.env.effects import EFFECTS
from affmap.env.layout import Layout
from affmap.env.procedural import first_layout
from affmap.env.scene import LAYERS, Scene
from affmap.play import render as film


def render(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["affmap-render", *arguments])
    try:
        film.main()
    except SystemExit as leaving:
        return int(leaving.code or 0)
    return 0


def test_a_frame_shows_the_vehicle_where_it_was() -> None:
    """Two context sizes side by side, from the same start, to the same goal: golden colours at recorded places."""
    frames = list(film.film("exp1", [0, 8], member=1, run=2, num_steps=8, with_map=False))
    assert len(frames) == 8
    left = {0: 0, 8: 3 * film.SCALE + film.GAP}
    for size in (0, 8):
        agent = affmap.load("exp1", context_size=size, members=[1])
        agent.settings = agent.settings.model_copy(update={"num_steps": 8})
        flight = affmap.fly(agent, "original").trajectories
        for step in (0, 7):
            for point, part in ((flight["position"][2, step], "vehicle"), (flight["goal"][2], "goal")):
                row, column = round((2 - point[1]) * film.SCALE) + film.HEAD, round(point[0] * film.SCALE)
                assert tuple(frames[step][row, left[size] + column]) == tuple(pygame.Color(LAYERS[part].color))[:3]


def test_by_default_a_film_shows_the_models_that_there_are() -> None:
    """Experiment I has codes of 0 to 8 units, and Experiment VI only of 8."""
    for source, number in (("exp1", 2), ("exp6", 1)):
        (frame,) = film.film(source, num_steps=1, with_map=False)
        assert frame.shape[1] == number * 3 * film.SCALE + (number - 1) * film.GAP


def test_transition_models_fly_side_by_side() -> None:
    """Each as `load` gives it, from the same start."""
    (frame,) = film.film("exp6", transitions=["mlp", "split"], layout="pairs_and_triples", member=201, num_steps=1)
    left, right = frame[film.HEAD :, : 3 * film.SCALE], frame[film.HEAD :, 3 * film.SCALE + film.GAP :]
    assert left.shape == right.shape and not np.array_equal(left, right)


def test_a_guided_agent_shows_its_way() -> None:
    """Beside the same agent without a guide: only the guided one has pixels of a way."""
    color = pygame.Color(LAYERS["way"].color)
    shown = {}
    for guide in ("none", "time_to_go"):
        (frame,) = film.film("exp5", [8], layout="trap", guide=guide, num_steps=1, with_map=False)
        shown[guide] = int((frame == [*color][:3]).all(-1).sum())
    assert shown["none"] == 0 and shown["time_to_go"] > 50


def test_doors_open_in_a_film(monkeypatch: pytest.MonkeyPatch) -> None:
    """World, map, ways and times to go of each moment are those before or after the visit of the key on the way."""
    scenes: list[Scene] = []

    def watched(given: Iterable[Scene], title: str, goal: np.ndarray) -> Iterator[np.ndarray]:
        scenes.extend(given)
        return iter([])

    circles = [((0.5, 0.4), 0.12, "key"), *(((1.5, y), 0.12, "door") for y in np.linspace(0, 2, 21))]
    values = [
        {"center": center, "radius": radius, "effect": effect, "channel": effect} for center, radius, effect in circles
    ]
    layout = Layout.load("layout", "training_doors", circles=values)
    monkeypatch.setattr(film, "first_layout", lambda *names: layout)
    monkeypatch.setattr(film, "_pictures", watched)
    list(film.film("exp7_doors", [8], guide="time_to_go", num_steps=20))
    is_open = layout.are_open(np.stack([scene.position for scene in scenes]))
    assert not is_open[0] and is_open[-1]
    for scene, opened in zip(scenes, is_open, strict=True):
        assert scene.layout == (layout.opened if opened else layout) and scene.ground is not None
        last = scenes[-1] if opened else scenes[0]
        assert last.ground is not None and np.array_equal(scene.ground, last.ground)
        assert scene.times is last.times and scene.way is not None
    before, after = scenes[0], scenes[-1]
    agent = affmap.load("exp7_doors", context_size=8)
    made = affmap.TimeToGo.imagine(
        affmap.load("exp7_doors", members=[agent.seeds[0]]).elsewhere([layout.map]), before.goal
    )
    assert made.opened is not None
    for scene, one in ((before, made), (after, made.opened)):
        np.testing.assert_allclose(np.concatenate(scene.times), np.concatenate(one.lines()))
        np.testing.assert_allclose(scene.way, one.paths(scene.position)[0])


def test_of_rules_for_worlds_the_member_s_first_is_flown() -> None:
    """Experiment V's: the world that `world` gives."""
    (frame,) = film.film("exp5", [8], member=3, num_steps=1, with_map=False)
    layout = first_layout("procedural_easy", 3)
    circle = max(layout.circles, key=lambda each: (each.effect == "obstacle", each.radius))
    x, y = circle.center
    row, column = round((2 - y) * film.SCALE) + film.HEAD, round(x * film.SCALE)
    color = pygame.Color("white").lerp(EFFECTS[circle.effect].color, 0.85)
    assert frame[row, column].tolist() == pytest.approx([*color][:3], abs=2)


def test_a_gif_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames and their time: every second of ten steps of a thirtieth of a second."""
    path = tmp_path / "new" / "flight.gif"
    arguments = ["exp4", "--steps", "10", "--every", "2", "--context-size", "8", "--output", str(path)]
    assert render(monkeypatch, *arguments) == 0
    frames = imageio.imread(path)
    assert frames.shape == (5, 2 * film.SCALE + film.HEAD, 3 * film.SCALE, 3)
    assert imageio.immeta(path)["duration"] == pytest.approx(1000 / 15, abs=10)
    assert not np.array_equal(frames[0], frames[-1])


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio's, about pipes to ffmpeg
def test_a_video_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "flight.mp4"
    assert (
        render(monkeypatch, "--steps", "5", "--context-size", "0", "--plain", "--every", "1", "--output", str(path))
        == 0
    )
    assert len(imageio.imread(path)) == 5


def test_help_comes_without_other_words() -> None:
    """As a user gets it, in a process of its own."""
    script = Path(sys.executable).with_name("affmap-render")
    shown = subprocess.run([script, "--help"], capture_output=True, text=True, check=True)
    assert shown.stdout.startswith("affmap-render: film ") and shown.stderr == ""


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--output", "flight.avi"], "should end in .gif or .mp4"),
        (["--steps", "0"], "--steps 0 should be 1 or more"),
        (["--context-size", "4"], "none of 4"),
        (["--transition", "gru"], "none is 'gru'"),
        (["--world", "mars"], "conf/layout/mars.yaml does not exist"),
        (["exp11"], "exp11 does not exist"),
        (["exp1", "--world", "fog"], "'fog' has channels"),
    ],
)
def test_a_mistake_is_told(
    arguments: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert render(monkeypatch, *arguments) == 2
    assert told in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_a_video_without_its_package_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(film, "find_spec", lambda _: None)
    assert render(monkeypatch, "--output", "flight.mp4") == 2
    assert 'pip install "imageio[ffmpeg]>=2.35"; .gif needs none.' in capsys.readouterr().err
