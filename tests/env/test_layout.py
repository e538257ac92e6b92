"""Layouts: the files in `conf/layout`, every kind of bad input, and geometry against plain loops."""

import json
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from affmap.env.body import Vehicle
from affmap.env.layout import Circle, Layout
from affmap.env.procedural import Procedural, first_layout
from affmap.settings import ConfigError, folder, read
from affmap.view import view

FILES = [path.stem for path in sorted((folder() / "layout").glob("*.yaml")) if "circles" in read("layout", path.stem)]
quick = settings(max_examples=60, deadline=None, derandomize=True)


def circle(**changes: Any) -> dict[str, Any]:
    return {"center": [1.5, 1.0], "radius": 0.2, "effect": "obstacle", "channel": "solid", **changes}


KEY = circle(effect="key", center=[1.59, 1.0], radius=0.1)
"""Just inside the circle."""


def original(**changes: Any) -> Layout:
    return Layout.load("layout", "original", **changes)


@pytest.mark.parametrize("name", FILES)
def test_every_file_loads_and_a_vehicle_can_start_in_its_corners(name: str) -> None:
    """Against the file's plain content."""
    layout, content = Layout.load("layout", name), read("layout", name)
    assert layout.name == content["name"] == name
    assert [list(circle.center) for circle in layout.circles] == [circle["center"] for circle in content["circles"]]
    layout.check_corners(Vehicle.load("vehicle", "default").radius)
    for number, (x, y, radius, channel) in enumerate(layout.map.circles):
        wanted = content["circles"][number]
        assert ([x, y], radius) == (wanted["center"], wanted["radius"])
        assert content["channels"][channel] == wanted["channel"]
    assert list(layout.map.size) == content["size"] and layout.map.num_channels == len(content["channels"])
    assert content["channels"][layout.map.border_channel] == content["border_channel"]


def test_the_original_is_the_paper_s_size_with_six_obstacles() -> None:
    """Section 4.1: 3 x 2 units; Figure 3: six obstacles."""
    layout = original()
    assert layout.size == (3.0, 2.0) and [one.effect for one in layout.circles] == ["obstacle"] * 6


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"circles": [circle(center=[3.1, 1.0])]}, ["circles[0].center = [3.1, 1.0]", "x must be in [0, 3.0]"]),
        ({"circles": [circle(center=[1.0, -0.1])]}, ["circles[0].center = [1.0, -0.1]", "y in [0, 2.0]"]),
        ({"circles": [circle(center=[math.nan, 1.0])]}, ["circles[0].center[0] = nan", "finite number"]),
        ({"circles": [circle(center=[1.0])]}, ["circles[0].center[1] is missing", "add the key"]),
        ({"circles": [circle(), circle(radius=-0.2)]}, ["circles[1].radius = -0.2", "greater than 0"]),
        ({"circles": [circle(radius=0)]}, ["circles[0].radius = 0", "greater than 0"]),
        ({"circles": [circle(radius=math.nan)]}, ["circles[0].radius = nan", "finite number"]),
        ({"circles": [circle(radius=math.inf)]}, ["circles[0].radius = inf", "finite number"]),
        (
            {"circles": [circle(effect="wall")]},
            ["circles[0].effect = 'wall'", "one of 'none', 'force_up', 'force_down'"],
        ),
        ({"circles": [circle(colour="red")]}, ["circles[0].colour = 'red'", "not a known key", "remove it"]),
        ({"circles": [circle(channel="soft")]}, ["circles[0].channel = 'soft'", "one of channels ['solid']"]),
        ({"circle": []}, ["circle = []", "not a known key", "did you mean circles?"]),
        ({"channels": ["solid", "solid"]}, ["channels = ['solid', 'solid']", "give each its own name"]),
        ({"channels": []}, ["channels = []", "should have at least 1 item"]),
        ({"border_channel": "sea"}, ["border_channel = 'sea'", "one of channels ['solid']"]),
        ({"size": [3.0, 0.0]}, ["size[1] = 0.0", "greater than 0"]),
        ({"size": [math.inf, 2.0]}, ["size[0] = inf", "finite number"]),
        ({"size": [1001.0, 2.0]}, ["size[0] = 1001.0", "less than or equal to 1000"]),
        ({"circles": [circle()] * 20_000}, ["circles = [", "at most 1000 items"]),  # Box2D ended the process
        ({"circles": [circle(radius=1e12)]}, ["circles[0].radius = 1000000000000.0", "less than or equal to 1000"]),
        ({"start_side": 0.0}, ["start_side = 0.0", "greater than 0"]),
        ({"start_side": 0.91}, ["start_side = 0.91", "start_margin = 0.1", "at most 1.0"]),
        ({"start_margin": -0.1}, ["start_margin = -0.1", "greater than 0"]),
        ({"acts": "edge"}, ["acts = 'edge'", "'center' or 'rim'"]),
        ({"acts": None}, ["acts = None", "'center' or 'rim'"]),
        ({"circles": [circle(), circle(effect="door")]}, ["circles[1] is a door, and there is no key", "'obstacle'"]),
        ({"circles": [circle(), KEY]}, ["circles[1] is a key inside circles[0]", "move it out"]),
        ({"circles": [KEY, circle(effect="door")]}, ["circles[0] is a key inside circles[1]", "move it out"]),
    ],
)
def test_bad_input_is_named_with_call_key_value_and_remedy(changes: dict[str, Any], parts: list[str]) -> None:
    """Golden parts of the message."""
    with pytest.raises(ConfigError) as caught:
        original(**changes)
    message = str(caught.value)
    assert message.startswith("Layout.load: ")
    assert [part for part in parts if part not in message] == [], message


@pytest.mark.parametrize("key", sorted(set(Layout.model_fields) - {"acts", "views_in_fog"}))
def test_a_missing_key_is_named(key: str) -> None:
    content = {name: value for name, value in read("layout", "original").items() if name != key}
    with pytest.raises(ConfigError, match=f"^conf/layout/x.yaml: {key} is missing; add the key.$"):
        Layout.checked(content, "conf/layout/x.yaml")


@pytest.mark.parametrize("key", sorted(set(Circle.model_fields) - {"painted"}))
def test_a_missing_key_of_a_circle_is_named(key: str) -> None:
    content = {name: value for name, value in circle().items() if name != key}
    with pytest.raises(ConfigError, match=rf"circles\[0\]\.{key} is missing; add the key"):
        original(circles=[content])


@pytest.mark.parametrize(
    ("center", "square"),
    [
        ([0.2, 0.5], "x 0.1 to 0.3, y 0.1 to 0.3"),
        ([2.8, 0.2], "x 2.7 to 2.9, y 0.1 to 0.3"),
        ([0.2, 1.8], "x 0.1 to 0.3, y 1.7 to 1.9"),
        ([2.55, 1.55], "x 2.7 to 2.9, y 1.7 to 1.9"),
    ],
)
def test_a_blocked_start_corner_is_named(center: list[float], square: str) -> None:
    """Golden parts: layout, circle, its values, which corner, and what would be right."""
    layout = original(circles=[circle(), circle(center=center)])
    with pytest.raises(ConfigError, match="blocks the start corner") as caught:
        layout.check_corners(0.06)
    wanted = ["layout 'original'", "circles[1]", str(center), "radius 0.2", square, "at least 0.06 away"]
    assert [part for part in wanted if part not in str(caught.value)] == []


def test_a_margin_smaller_than_the_vehicle_is_named() -> None:
    with pytest.raises(ConfigError, match=r"start_margin = 0\.05 .* radius 0\.06; make it at least that"):
        original(start_margin=0.05).check_corners(0.06)


@pytest.mark.parametrize(
    ("effect", "acts", "expected"),
    [
        *((effect, "center", 0.0) for effect in ("fog", "force_up", "force_down", "none")),
        *((effect, "rim", 0.06) for effect in ("fog", "force_up", "force_down", "none")),
        ("obstacle", "center", 0.06),
        ("obstacle", "rim", 0.06),
    ],
)
def test_how_far_circles_reach(effect: str, acts: str, expected: float) -> None:
    """By hand: terrains to the centre or to the rim of a disc of 0.06 u, obstacles always to the rim."""
    layout = original(circles=[circle(effect=effect)], acts=acts)
    assert layout.reach(layout.circles[0], 0.06) == expected


@pytest.mark.parametrize("name", ["original", "two_obstacles", "twelve_obstacles", "three_looks"])
def test_a_file_without_the_rule_is_written_as_before_there_was_one(name: str) -> None:
    """The file's own keys and no other, so that its digest stays; the rule that stood for everything says the same."""
    content = read("layout", name)
    assert "acts" not in content
    layout = Layout.load("layout", name)
    assert layout.acts == "rim" and layout == Layout.load("layout", name, acts="rim")
    for written in (layout.model_dump(mode="json"), layout.plain, json.loads(layout.model_dump_json())):
        assert written == content
    circles = [circle | {"painted": None} for circle in content["circles"]]
    assert layout.complete() == content | {"acts": "rim", "views_in_fog": True, "circles": circles}
    assert Layout.load("layout", name, acts="center").plain == content | {"acts": "center"}


@pytest.mark.parametrize("name", ["fog", "four_properties", *(each for each in FILES if each.startswith("training"))])
def test_the_worlds_of_experiments_4_and_5_act_at_the_centre(name: str) -> None:
    """As the files say, in words; and what is written says so."""
    layout = Layout.load("layout", name)
    assert layout.acts == layout.plain["acts"] == read("layout", name)["acts"] == "center"


@pytest.mark.parametrize("effect", ["fog", "force_up", "force_down", "none", "key"])
def test_only_obstacles_block_a_corner_or_a_place(effect: str) -> None:
    layout = original(circles=[circle(effect=effect, center=[0.2, 0.2])])
    layout.check_corners(0.06)
    assert layout.is_free(np.array([0.2, 0.2]), 0.06)


fractions = st.floats(0, 1)


@st.composite
def layouts(draw: st.DrawFn) -> Layout:
    size = (draw(st.floats(0.5, 4)), draw(st.floats(0.5, 4)))
    margin = draw(st.floats(0.05, 0.2)) * min(size)
    circles = [
        circle(
            center=[draw(fractions) * size[0], draw(fractions) * size[1]],
            radius=draw(st.floats(0.01, 1)),
            effect=draw(st.sampled_from(["obstacle", "obstacle", "fog", "none", "force_up"])),
        )
        for _ in range(draw(st.integers(0, 5)))
    ]
    side = draw(st.floats(0.05, 0.29)) * min(size)
    return original(size=size, circles=circles, start_margin=margin, start_side=side)


@quick
@given(layouts(), st.integers(0, 2**32 - 1), st.floats(0.01, 0.3))
def test_is_free_equals_distances_computed_one_by_one(layout: Layout, seed: int, radius: float) -> None:
    """Plain loops over 200 places in and around the arena; those within rounding of touching are left out."""
    positions = np.random.default_rng(seed).uniform(-0.1, 1.1, (200, 2)) * layout.size
    actual = layout.is_free(positions, radius)
    assert actual.shape == (200,)
    for (x, y), free in zip(positions, actual, strict=True):
        gaps = [x - radius, y - radius, layout.size[0] - radius - x, layout.size[1] - radius - y]
        for one in layout.circles:
            if one.effect == "obstacle":
                gaps.append(math.hypot(x - one.center[0], y - one.center[1]) - one.radius - radius)
        if abs(min(gaps)) > 1e-9:
            assert free == (min(gaps) > 0)


def test_is_free_takes_any_shape_and_never_calls_nan_free() -> None:
    layout = original()
    positions = np.random.default_rng(0).uniform([0, 0], [3, 2], (3, 4, 2))
    actual = layout.is_free(positions, 0.06)
    assert actual.shape == (3, 4) and actual.any() and not actual.all()
    for index in np.ndindex(3, 4):
        assert actual[index] == layout.is_free(positions[index], 0.06)
    assert not layout.is_free(np.array([math.nan, 1.0]), 0.06)


@quick
@given(layouts())
def test_corner_squares_lie_in_their_corner_at_their_margin(layout: Layout) -> None:
    """Closed form; the opposite corner is the point reflection at the centre of the arena."""
    (width, height), margin, side = layout.size, layout.start_margin, layout.start_side
    for corner in range(4):
        low, high = layout.corner(corner)
        np.testing.assert_allclose(high - low, side)
        assert (low > 0).all() and high[0] < width and high[1] < height
        assert (low[0] > width / 2 - 1e-9) if corner in (1, 3) else (high[0] < width / 2 + 1e-9)
        assert (low[1] > height / 2 - 1e-9) if corner in (2, 3) else (high[1] < height / 2 + 1e-9)
        gaps = [low[0], width - high[0], low[1], height - high[1]]
        np.testing.assert_allclose(min(gaps[:2]), margin)
        np.testing.assert_allclose(min(gaps[2:]), margin)
        opposite = np.array(layout.size) - layout.corner(3 - corner)[::-1]
        np.testing.assert_allclose(np.stack([low, high]), opposite)


@quick
@given(layouts(), st.floats(0.01, 0.1))
def test_corners_are_refused_where_and_only_where_a_vehicle_could_not_stand(layout: Layout, radius: float) -> None:
    """Against `is_free` on a grid of each square; what the grid is too coarse to decide is left out."""
    assume(layout.start_margin >= radius + 1e-9)
    steps = np.linspace(0, 1, 41)
    fraction = np.stack(np.meshgrid(steps, steps), -1)
    squares = [layout.corner(corner) for corner in range(4)]
    places = np.stack([low + fraction * (high - low) for low, high in squares])
    coarse = layout.start_side / 40
    if not layout.is_free(places, radius).all():
        with pytest.raises(ConfigError, match="blocks the start corner"):
            layout.check_corners(radius)
    elif layout.start_margin >= radius + coarse and layout.is_free(places, radius + coarse).all():
        layout.check_corners(radius)


def shortest_way(name: str) -> float:
    """Length of the shortest way for the vehicle's disc between two opposite corners, relative to the direct line."""
    layout, pitch = Layout.load("layout", name), 0.04
    positions = np.stack(np.meshgrid(np.arange(76) * pitch, np.arange(51) * pitch, indexing="ij"), -1)
    free, number = layout.is_free(positions, 0.06), np.arange(76 * 51).reshape(76, 51)
    edges = []
    for dx, dy in [(1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (2, -1), (1, 2), (1, -2), (3, 1), (3, -1), (3, 2), (3, -2)]:
        here = number[: 76 - dx, max(0, -dy) : 51 - max(0, dy)].ravel()
        there = number[dx:, max(0, dy) : 51 - max(0, -dy)].ravel()
        both = free.ravel()[here] & free.ravel()[there]
        edges.append((here[both], there[both], np.full(both.sum(), pitch * math.hypot(dx, dy))))
    here, there, length = (np.concatenate(parts) for parts in zip(*edges, strict=True))
    graph = coo_matrix((length, (here, there)), shape=(number.size, number.size))
    way = dijkstra(graph, directed=False, indices=number[5, 5])[number[70, 45]]
    return float(way / (pitch * math.hypot(65, 40)))


def test_two_obstacles_block_more_and_twelve_less_than_six() -> None:
    """Experiment II, as the paper says; Dijkstra's shortest ways on a grid."""
    twelve, six, two = (shortest_way(name) for name in ("twelve_obstacles", "original", "two_obstacles"))
    assert 1 < twelve < six - 0.01 < two - 0.03


def test_an_obstacle_may_stand_just_a_radius_from_a_start_corner() -> None:
    """By hand, in binary fractions: the square ends at 0.25, the obstacle begins at 0.3125."""
    obstacle = {"center": [0.75, 0.1875], "radius": 0.4375, "effect": "obstacle", "channel": "solid"}
    layout = Layout.load("layout", "original", start_margin=0.125, start_side=0.125, circles=[obstacle])
    layout.check_corners(0.0625)
    with pytest.raises(ConfigError, match=r"circles\[0\] .* blocks the start corner"):
        layout.check_corners(0.0625 + 2**-20)


def test_rules_are_no_layout_and_a_layout_is_no_rules() -> None:
    """A sentence each, by the file, by the call and by plain values."""
    rules, layout = read("layout", "procedural_easy"), read("layout", "original")
    told = "'procedural_easy' holds rules for random layouts, not a layout: read it with affmap.Procedural, whose "
    for origin, use in (
        ("conf/layout/procedural_easy.yaml", lambda: Layout.load("layout", "procedural_easy")),
        ("Layout", lambda: Layout(**rules)),
        ("mine", lambda: Layout.checked(rules, "mine")),
    ):
        with pytest.raises(ConfigError) as caught:
            use()
        assert str(caught.value).startswith(f"{origin}: {told}") and "\n" not in str(caught.value)
    with pytest.raises(ConfigError, match=r"^mine: 'original' holds a layout, not rules .* affmap\.Layout\.$"):
        Procedural.checked(layout, "mine")


def test_a_file_has_the_name_of_its_layout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever it is read; a call may give another name."""
    (tmp_path / "conf/layout").mkdir(parents=True)
    for name in ("original", "procedural_easy"):
        (tmp_path / f"conf/layout/my_{name}.yaml").write_text(json.dumps(read("layout", name)))
    monkeypatch.chdir(tmp_path)
    told = r"^conf/layout/my_original\.yaml: name = 'original' must be that of the file, 'my_original'\.$"
    for use in (lambda: Layout.load("layout", "my_original"), lambda: first_layout("my_original", 0)):
        with pytest.raises(ConfigError, match=told):
            use()
    with pytest.raises(ConfigError, match="name = 'procedural_easy' must be that of the file"):
        Procedural.load("layout", "my_procedural_easy")
    assert Layout.load("layout", "my_original", name="mine").name == "mine"


def doors() -> Layout:
    """A door in the middle, and a key to the left of it."""
    door = circle(effect="door", center=[1.5, 1.0], channel="solid")
    return original(circles=[door, circle(effect="key", center=[0.5, 1.0], radius=0.2)])


def test_an_opened_layout_has_all_but_the_doors() -> None:
    """Also to the eye; without doors it is the layout itself, whether there are keys or not."""
    layout = doors()
    assert layout.opened == original(circles=[layout.circles[1]])
    assert layout.opened.opened is layout.opened and original().opened.opened == original()
    assert layout.map.opened == layout.opened.map and layout.map.keys == ((0.5, 1.0, 0.2),)
    assert layout.opened.map.opened is None and layout.opened.map.keys == ()
    assert tuple(layout.obstacles) == layout.circles[:1] and not layout.opened.obstacles
    assert pickle.loads(pickle.dumps(layout)) == layout != layout.opened
    with pytest.raises(ConfigError, match="blocks the start corner"):
        original(circles=[circle(effect="door", center=[0.2, 0.2]), KEY]).check_corners(0.06)


def test_a_key_need_not_have_a_door_nor_be_wholly_free() -> None:
    """An opened layout, read back from its own values; and a key of which a part is outside of the obstacle."""
    values = doors().opened.model_dump()
    assert Layout.checked(values, "here") == doors().opened
    assert original(circles=[circle(), KEY | {"center": [1.61, 1.0]}]).effects == ["obstacle", "key"]


def test_doors_are_open_from_the_first_visit_of_a_key() -> None:
    """By hand: before it, inside, and after it; views along a path are those of the world at each moment."""
    layout = doors()
    path = np.array([[1.2, 1.0], [0.71, 1.0], [0.69, 1.0], [1.2, 1.0]])
    assert layout.are_open(path).tolist() == [False, False, True, True]
    assert layout.are_open(np.stack([path, path[[0, 0, 0, 0]]])).tolist() == [[False, False, True, True], [False] * 4]
    assert not layout.opened.are_open(path).any()
    seen = layout.views(path)
    np.testing.assert_array_equal(seen[:2], view(layout.map, path[:2]))
    np.testing.assert_array_equal(seen[2:], view(layout.opened.map, path[2:]))
    assert (seen[0] != seen[3]).any()


def test_the_dark_belt_is_the_belt_in_whose_fog_nothing_is_seen() -> None:
    """The files differ in this key only; what is hidden are the circles of fog."""
    lit, dark = (Layout.load("layout", name) for name in ("fog_belt", "fog_belt_dark"))
    assert dark == lit.model_copy(update={"name": "fog_belt_dark", "views_in_fog": False})
    assert lit.map.hidden == ()
    assert dark.map.hidden == tuple((each.x, each.y, each.radius) for each in lit.circles if each.effect == "fog")


@pytest.mark.parametrize("name", ["fog_belt", "fog"])
@pytest.mark.parametrize("acts", ["center", "rim"])
def test_in_fog_equals_distances_computed_one_by_one(name: str, acts: str) -> None:
    """Plain loops over places and circles, for a vehicle of 0.06 u."""
    layout = Layout.load("layout", name, acts=acts)
    places = np.random.default_rng(0).uniform((0, 0), layout.size, (50, 4, 2))
    reach = 0.06 * (acts == "rim")
    expected = [
        any(math.dist(place, each.center) < each.radius + reach for each in layout.circles if each.effect == "fog")
        for place in places.reshape(-1, 2)
    ]
    assert layout.in_fog(places, 0.06).ravel().tolist() == expected and any(expected) and not all(expected)
