"""What is in the page, and the page in a browser. References: stage files, views and look-ups of the vehicle itself.

Without a Chromium of the system the browser's tests are skipped.
"""

import base64
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from playwright.sync_api import Browser, Locator, Page

from affmap.env.layout import Layout
from affmap.env.scene import LAYERS
from affmap.experiments import open_room
from affmap.model.lookup import AffordanceMap
from affmap.report import build
from affmap.report import page as pages
from affmap.report.experiment import ExperimentReport
from affmap.report.explorer import maps as explorers
from affmap.report.packing import LARGEST, MISSING, Packed, pack, pack_bits
from affmap.report.player import runs as players
from affmap.results.examples import choose_examples
from affmap.results.setting import ReportSettings, Setting
from affmap.results.statistics import Verdict
from affmap.results.tables import Results
from affmap.view import view

CONF = Path(__file__).parents[2] / "conf"
FOLDER = Path(pages.__file__).parent
READING = "willReadFrequently"  # advice to the tests that read pictures again
SETTINGS = ReportSettings.model_validate(yaml.safe_load((CONF / "report/default.yaml").read_text("utf-8"))).model_copy(
    update={"claims": "exp1"}
)


@pytest.fixture(scope="module")
def results(write_stages: Callable[..., list[Setting]], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Results]:
    root = tmp_path_factory.mktemp("stages")
    names = ("exp1", "exp3", "exp5")
    return {name: Results(tuple(write_stages(root, (0, 8), members=2, epochs=2, experiment=name))) for name in names}


def unpacked(packed: Packed) -> np.ndarray:
    """Numbers as the page reads them."""
    whole = np.frombuffer(base64.b64decode(packed["data"]), "<i2").reshape(packed["shape"])
    return np.where(whole == MISSING, np.nan, whole * packed["step"])


@given(st.lists(st.floats(allow_subnormal=False, min_value=-1e300, max_value=1e300)), st.sampled_from([1e-4, 1e-2]))
@example([40.0, -2.0], 1e-3)
def test_numbers_are_packed_to_half_a_step(values: list[float], finest: float) -> None:
    packed = pack(np.array(values), finest)
    step = max(finest, max(map(abs, values), default=0.0) / LARGEST)
    assert packed["step"] == step
    assert np.abs(unpacked(packed) - values).max(initial=0.0) <= step / 2 * (1 + 1e-9)


def test_what_is_no_number_stays_none() -> None:
    found = unpacked(pack(np.array([[1.0, np.nan], [-np.inf, -1.0]]), 0.5))
    assert np.array_equal(found, [[1.0, np.nan], [np.nan, -1.0]], equal_nan=True)


def test_truth_values_are_packed_eight_a_byte() -> None:
    """By hand: 10000000 01000000."""
    values = np.zeros((2, 5), bool)
    values[0, 0] = values[1, 4] = True
    assert pack_bits(values) == {"shape": [2, 5], "data": base64.b64encode(bytes([128, 64])).decode()}


def test_codes_along_a_run_are_those_that_the_look_up_gives(results: dict[str, Results]) -> None:
    """The agent's own bilinear look-up in the same map."""
    found = results["exp1"]
    job = next(job for job in found.settings if job.context_size == 8)
    world = found.run_layouts(job)[0]
    maps = found.maps()[8]
    lookup = AffordanceMap(torch.from_numpy(maps.codes), [world.map])
    places = np.random.default_rng(0).uniform(0, world.size, (2, 50, 2)).astype(np.float32)
    expected = lookup(torch.from_numpy(places))
    for member in (0, 1):
        codes = players.codes_along(found, job, member, places[member], world)
        assert codes == pytest.approx(expected[member].numpy(), abs=1e-4)


@pytest.mark.parametrize("name", ["exp1", "exp3", "exp5"])
def test_every_setting_has_a_run_and_the_figure_s_are_among_them(results: dict[str, Results], name: str) -> None:
    block = players.player(results[name], SETTINGS)
    choices = [run["choice"] for run in block["data"]["runs"]]
    found = results[name]
    assert len(choices) <= players.MAX_RUNS and len(choices) == len(set(map(tuple, choices)))
    settings = {
        (job.layout.replace("_", " "), SETTINGS.names[job.planner], str(job.context_size)) for job in found.settings
    }
    assert {tuple(choice[:3]) for choice in choices} == settings
    for layout in found.layouts:
        for shown in choose_examples(found, {"planner": "cem", "control_layout": layout}):
            start = [layout.replace("_", " "), "EB", str(shown.setting.context_size)]
            assert [*start, f"run {shown.run} of member {shown.member}"] in choices


def test_where_no_map_was_painted_there_are_no_codes_and_it_is_said(results: dict[str, Results]) -> None:
    """In Experiment V every run has a world of its own."""
    block = players.player(results["exp5"], SETTINGS)
    runs = block["data"]["runs"]
    assert {run["code"] for run in runs} == {None}
    assert {run["without"] for run in runs} == {"no affordance map of this world", "this model has none"}
    assert "There are no context codes" in block["caption"]
    assert len({run["world"] for run in runs}) == len({tuple(run["choice"][::3]) for run in runs}), (
        "one a layout and run"
    )


def test_the_map_is_coloured_and_placed_as_in_the_figure(results: dict[str, Results]) -> None:
    """The first and the last node of every other row and column, and the middle of a pixel around each node."""
    block = explorers.explorer(results["exp3"], SETTINGS)
    assert block is not None
    shown = block["data"]["maps"]
    assert [found["choice"] for found in shown] == [["original", "8"], ["three looks", "8"]]
    codes = results["exp3"].maps("three_looks")[8].codes[0]
    assert unpacked(shown[1]["codes"]) == pytest.approx(codes[::2, ::2], abs=1e-4)
    assert shown[1]["origin"] == [0.0, 0.0] and shown[1]["spacing"] == [0.04, 0.04]
    assert shown[1]["edges"] == pytest.approx(np.array([[-0.01, -0.01], [3.01, 2.01]]))


def test_without_codes_there_is_nothing_to_explore(results: dict[str, Results]) -> None:
    few = Results(tuple(job for job in results["exp1"].settings if job.context_size == 0))
    assert explorers.explorer(few, SETTINGS) is None
    assert "no model has a context" in players.player(few, SETTINGS)["caption"]


@pytest.fixture(scope="module")
def report(results: dict[str, Results], tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("report")
    told = {"name": "exp1", "title": "exp1", "command": "make exp1"}
    build.write(ExperimentReport(output, results["exp1"], SETTINGS, open_room("exp1", "exp1"), **told, notice=None))
    return output / "report.html"


@pytest.fixture
def page(browser: Browser, report: Path) -> Iterator[Page]:
    """The page of a report, opened from the file system; it must ask for nothing and complain of nothing."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if READING not in message.text else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: None if request.url.startswith("data:") else said.append(request.url))
    page.goto(report.as_uri())
    yield page
    assert said == [report.as_uri()]
    page.close()


def moment(player: Locator) -> dict[str, Any]:
    """Where the player says that the vehicle is, and at which step."""
    shown: dict[str, str] = player.locator(".arena").evaluate("canvas => ({...canvas.dataset})")
    return {"step": int(shown["step"]), "position": (float(shown["x"]), float(shown["y"]))}


def colors(canvas: Locator, places: list[tuple[float, float]]) -> list[str]:
    """Colours of an arena's picture at positions (u)."""
    paint = """(canvas, places) => places.map(([x, y]) => {
        const scale = canvas.width / 3;
        const pixel = canvas.getContext("2d").getImageData(Math.round(x * scale), Math.round((2 - y) * scale), 1, 1);
        return "#" + [...pixel.data.slice(0, 3)].map((part) => part.toString(16).padStart(2, "0")).join("");
    })"""
    found: list[str] = canvas.evaluate(paint, places)
    return found


def choose(player: Locator, name: str, value: str) -> None:
    player.get_by_label(name).select_option(value)


def test_the_slider_moves_the_vehicle(page: Page, results: dict[str, Results]) -> None:
    """Positions, distances, views and codes against the stage's files; and the vehicle's colour where it is."""
    player = page.locator(".player")
    found = results["exp1"]
    for planner, size, run in (("EB", 8, 1), ("GB", 0, 3)):
        choose(player, "Planner", planner)
        choose(player, "Context size", str(size))
        choose(player, "Run", f"run {run} of member 0")
        job = found.setting(size, {"EB": "cem", "GB": "gradient"}[planner])
        assert job is not None
        paths = found.trajectories(job)
        path, goal = paths.position[run], paths.goal[run]
        for step in (0, 17, 30):
            player.locator(".slider").fill(str(step))
            shown = moment(player)
            assert shown["step"] == step and shown["position"] == pytest.approx(path[step], abs=5.1e-4)
            assert player.locator(".distance").text_content() == f"{np.linalg.norm(path[step] - goal):.2f} u"
            error = f"{paths.prediction_error[run, step - 1]:.2f} nats".replace("-", "−") if step else "–"
            assert player.locator(".error").text_content() == error
            other = path[30 if step < 30 else 0]
            here, there = colors(player.locator(".arena"), [tuple(path[step].tolist()), tuple(other.tolist())])
            assert here == LAYERS["vehicle"].color != there
            _assert_view(player, found.run_layouts(job)[0], path[step])
            codes = players.codes_along(found, job, 0, path, found.run_layouts(job)[0])
            told = player.locator(".bars output").all_text_contents()
            assert [float(code.replace("−", "-")) for code in told] == (
                [] if codes is None else pytest.approx(codes[step], abs=0.0052)
            )
    assert player.locator(".without").text_content() == "None: this model has none."


def test_a_moment_has_the_marks_of_its_scene(page: Page, results: dict[str, Results]) -> None:
    """Shapes, colours and order against `Trajectories.scene`, to the digits that are packed; last in fog."""
    found = results["exp1"]
    job = found.settings[0]
    paths = found.trajectories(job)
    data = players.player(found, SETTINGS)["data"]
    number = next(place for place, run in enumerate(data["runs"]) if run["choice"][-1] == "run 2 of member 0")
    paths.in_fog[2, :] = np.arange(paths.in_fog.shape[1]) == 16
    for step in (0, 9, 17):
        data["runs"][number]["in_fog"] = pack_bits(paths.in_fog[2])
        shown = page.evaluate(
            "([data, run, step]) => moment(data, open(data.runs[run], data), step)", [data, number, step]
        )
        scene = paths.scene(2, step, found.run_layouts(job)[2], found.vehicle_radius(job))._replace(view=True)
        marks = scene.marks()
        assert [mark["layer"] for mark in shown] == [mark.layer._asdict() for mark in marks]
        for one, mark in zip(shown, marks, strict=True):
            assert np.array(one["points"]) == pytest.approx(mark.points, abs=1e-3)
            assert one.get("radii") == (None if mark.radii is None else pytest.approx(mark.radii, abs=1e-3))


def test_doors_are_gone_once_a_key_was_visited(
    page: Page, results: dict[str, Results], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run past a key: circles of the moments before and after, against `Trajectories.scene`."""
    found = results["exp1"]
    job = found.settings[0]
    paths, radius = found.trajectories(job), found.vehicle_radius(job)
    values = {"radius": 0.1, "channel": "solid"}
    door = {"center": (1.5, 1.0), "effect": "door", **values}
    keys = [{"center": (*path[9].tolist(),), "effect": "key", **values} for path in paths.position]
    layouts = [Layout.load("layout", "original", circles=[door, key]) for key in keys]
    monkeypatch.setattr(type(found), "run_layouts", lambda *job: layouts)
    data = players.player(found, SETTINGS)["data"]
    number = next(place for place, run in enumerate(data["runs"]) if run["choice"][-1] == "run 2 of member 0")
    for step, circles in ((0, 2), (9, 1), (17, 1)):
        shown = page.evaluate(
            "([data, run, step]) => moment(data, open(data.runs[run], data), step)", [data, number, step]
        )
        marks = paths.scene(2, step, layouts[2], radius)._replace(view=True).marks()
        assert [mark["layer"] for mark in shown] == [mark.layer._asdict() for mark in marks]
        assert len(data["worlds"][data["runs"][number]["world"]]["circles"]) == 2
        assert len([mark for mark in shown if mark["layer"]["color"] in ("#a0522d", "#f0c808")]) == circles


def _assert_view(player: Locator, world: Layout, position: np.ndarray) -> None:
    """The pictures of the view have the pixels that the vehicle sees, the lowest row last."""
    read = """canvas => [...canvas.getContext("2d").getImageData(0, 0, 11, 11).data].filter((_, i) => i % 4 === 3)"""
    shown = [canvas.evaluate(read) for canvas in player.locator(".views canvas").all()]
    assert np.array_equal(np.array(shown).reshape(-1, 11, 11)[:, ::-1] > 0, view(world.map, position))


def test_every_verdict_has_a_shade_in_both_layouts() -> None:
    """A class of its words in the style of the HTML, an entry in the PDF's table of fills."""
    style, layout = ((FOLDER / f"layout.{kind}").read_text("utf-8") for kind in ("css", "typ"))
    for verdict in Verdict:
        assert re.search(rf"\.{verdict.replace(' ', '-')}\b[^{{}}]*{{ background", style), verdict
        assert re.search(rf'fills = .*"{verdict}": ', layout), verdict


def test_play_goes_on_until_it_is_paused(page: Page) -> None:
    """By button and by keys; at the end it stops, and begins anew."""
    player = page.locator(".player")
    button, arena = player.locator(".play"), player.locator(".arena")
    button.click()
    page.wait_for_timeout(300)
    assert moment(player)["step"] > 0 and button.text_content() == "Pause"
    arena.press(" ")
    step = moment(player)["step"]
    page.wait_for_timeout(100)
    assert moment(player)["step"] == step < 40 and button.text_content() == "Play"
    arena.press("ArrowRight")
    arena.press("ArrowRight")
    arena.press("ArrowLeft")
    assert moment(player)["step"] == step + 1
    player.locator(".slider").press("ArrowRight")
    assert moment(player)["step"] == step + 2
    player.locator(".slider").fill("38")
    arena.press(" ")
    page.wait_for_timeout(400)
    assert moment(player)["step"] == 40 and button.text_content() == "Play"
    button.click()
    page.wait_for_timeout(100)
    assert moment(player)["step"] < 20


def test_another_setting_is_shown_at_the_same_step(page: Page) -> None:
    player = page.locator(".player")
    player.locator(".slider").fill("9")
    before = moment(player)
    choose(player, "Planner", "GB")
    assert moment(player)["step"] == 9
    assert player.get_by_label("Run").input_value() == "run 0 of member 0"
    assert player.get_by_label("Layout").is_hidden(), "there is one"
    choose(player, "Run", "run 3 of member 0")
    assert moment(player)["position"] != before["position"]


def test_tables_are_sorted_by_numbers(page: Page) -> None:
    """Claims by their effects: ascending, descending, as written; what has no number comes last."""
    table = page.locator("table", has_text="Verdict")
    written = table.locator("tbody tr td:nth-child(3)").all_text_contents()
    head = table.locator("th", has_text="Effect")

    def shown() -> list[float]:
        texts = table.locator("tbody tr td:nth-child(3)").all_text_contents()
        return [float(re.split("[ \\[]", text)[0].replace("−", "-")) if text != "–" else np.inf for text in texts]

    known = sorted(value for value in shown() if value < np.inf)
    missing = [np.inf] * (len(written) - len(known))
    assert len(known) > 6 and known[0] < 0 < known[-1] and missing and shown() != [*known, *missing]
    head.get_by_role("button").click()
    assert shown() == [*known, *missing] and head.get_attribute("aria-sort") == "ascending"
    head.get_by_role("button").press("Enter")
    assert shown() == [*known[::-1], *missing] and head.get_attribute("aria-sort") == "descending"
    head.get_by_role("button").press(" ")
    assert table.locator("tbody tr td:nth-child(3)").all_text_contents() == written
    assert head.get_attribute("aria-sort") is None


def test_tables_are_sorted_by_words(page: Page) -> None:
    table = page.locator("table", has_text="Digest")
    stages = table.locator("tbody tr td:nth-child(1)")
    written = stages.all_text_contents()
    table.get_by_role("button", name="Stage", exact=True).click()
    assert stages.all_text_contents() == sorted(written) != written
    digests = table.locator("tbody tr td:nth-child(2)")
    table.get_by_role("button", name="Digest").click()
    found = digests.all_text_contents()
    assert sorted(found) == sorted(digests.all_text_contents()) and len(set(found)) == len(found)
    assert table.locator("th[aria-sort]").count() == 1


def test_the_map_tells_the_code_under_the_pointer(page: Page, results: dict[str, Results]) -> None:
    """The code of the nearest node that is kept, in the stage's array; by pointer and by keys."""
    explorer = page.locator(".explorer")
    arena = explorer.locator(".arena")
    maps = results["exp1"].maps()[8]
    box = arena.bounding_box()
    assert box is not None

    def told() -> list[float]:
        return [float(text.replace("−", "-")) for text in explorer.locator(".bars output").all_text_contents()]

    for x, y in ((0.31, 0.33), (1.53, 1.71), (2.99, 0.01)):
        arena.hover(position={"x": x / 3 * box["width"], "y": (1 - y / 2) * box["height"]})
        column, row = round(x / 0.04), round(y / 0.04)
        assert explorer.locator(".place").text_content() == f"at x {0.04 * column:.2f} u, y {0.04 * row:.2f} u"
        assert told() == pytest.approx(maps.codes[0, 2 * row, 2 * column], abs=0.0052)
    arena.press("ArrowUp")
    arena.press("ArrowRight")
    assert told() == pytest.approx(maps.codes[0, 2 * (row + 1), 2 * column], abs=0.0052), "at the border it stays"


def test_a_phone_shows_everything_without_scrolling_sideways(page: Page) -> None:
    page.set_viewport_size({"width": 400, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    for name in (".player .side", ".explorer .side", ".slider", ".play"):
        box = page.locator(name).first.bounding_box()
        assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= 400


def test_no_other_script_runs(browser: Browser, report: Path, tmp_path: Path) -> None:
    """Were text of others ever taken for a part of the page, the browser would refuse to run or to fetch it."""
    hostile = '<script>document.title = "taken"</script><img src="https://localhost/x" onerror="document.title = 1">'
    path = tmp_path / "report.html"
    path.write_text(report.read_text("utf-8").replace("<nav>", f"{hostile}<nav>"), "utf-8")
    page = browser.new_page()
    refused: list[str] = []
    page.on("console", lambda message: refused.append(message.text))
    page.goto(path.as_uri())
    assert page.title() == "exp1" and len(refused) >= 2
    assert all("Content Security Policy" in message for message in refused)
    assert page.locator("table button").count() > 0, "its own script runs"
    page.close()
