"""Random worlds: every rule against distances computed one by one, for the files in `conf/layout` and for others."""

import math
import time
from collections import Counter
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from affmap.env.body import Vehicle
from affmap.env.geometry import crossable
from affmap.env.layout import Layout
from affmap.env.procedural import Procedural, Property
from affmap.random import generator
from affmap.settings import ConfigError, read

FILES = ["procedural_easy", "procedural_hard", "procedural_crowded_easy", "procedural_crowded_hard"]
EFFECTS = ["obstacle", "fog", "force_up", "force_down"]
SEEDS = 200
quick = settings(max_examples=100, deadline=None, derandomize=True)


def easy(**changes: Any) -> Procedural:
    return Procedural.load("layout", "procedural_easy", **changes)


@pytest.fixture(scope="session")
def worlds() -> dict[str, list[Layout]]:
    return {
        name: [Procedural.load("layout", name).draw(generator(seed, "worlds")) for seed in range(SEEDS)]
        for name in FILES
    }


def broken_rules(layout: Layout, rules: Procedural, tolerance: float = 1e-9) -> list[str]:
    """Plain loops over circles, pairs and corners; distances in closed form."""
    (width, height), gap, violations = layout.size, rules.gap, []
    for index, circle in enumerate(layout.circles):
        (x, y), radius = circle.center, circle.radius
        if not rules.radius[0] - tolerance <= radius <= rules.radius[1] + tolerance:
            violations.append(f"radius of {index}")
        if min(x, y, width - x, height - y) - radius < gap - tolerance:
            violations.append(f"border distance of {index}")
        for left in (0, width - rules.corner_side):
            for bottom in (0, height - rules.corner_side):
                to_square_x = max(left - x, 0, x - left - rules.corner_side)
                to_square_y = max(bottom - y, 0, y - bottom - rules.corner_side)
                if math.hypot(to_square_x, to_square_y) < radius - tolerance:
                    violations.append(f"{index} in a corner")
    spaced_kinds = {(kind.effect, kind.channel) for kind in rules.properties if kind.spaced}
    spaced = [circle for circle in layout.circles if (circle.effect, circle.channel) in spaced_kinds]
    for one, other in combinations(spaced, 2):
        if math.dist(one.center, other.center) - one.radius - other.radius < gap - tolerance:
            violations.append(f"gap between {one.center} and {other.center}")
    kinds = Counter((circle.effect, circle.channel) for circle in layout.circles)
    numbers = [len(layout.circles)]
    if rules.count_of == "property":
        numbers = [kinds[kind.effect, kind.channel] for kind in rules.properties]
    if not all(rules.count[0] <= number <= rules.count[1] for number in numbers):
        violations.append(f"numbers {numbers}")
    if not set(kinds) <= {(kind.effect, kind.channel) for kind in rules.properties}:
        violations.append("a circle of no property")
    return violations


@pytest.mark.parametrize("name", FILES)
def test_the_files_hold_the_paper_s_rules(name: str) -> None:
    """Section 4.5 by hand: numbers, radii, distances, corners, channels of their own; `hard`: force fields overlap.

    Numbers are of all circles, of each property's where worlds are crowded; terrains act at the vehicle's centre.
    """
    rules = Procedural.load("layout", name)
    assert rules.name == name and rules.count_of == ("property" if "crowded" in name else "world")
    assert rules.acts == "center"
    assert (rules.size, rules.count, rules.radius) == ((3.0, 2.0), (6, 10), (0.1, 0.5))
    assert (rules.gap, rules.corner_side, rules.start_margin, rules.start_side) == (0.15, 0.4, 0.1, 0.2)
    assert rules.channels == ("solid", "fog", "force_up", "force_down") and rules.border_channel == "solid"
    assert [kind.effect for kind in rules.properties] == EFFECTS
    assert [kind.channel for kind in rules.properties] == list(rules.channels)
    assert [kind.spaced for kind in rules.properties] == [True, True] + ["easy" in name] * 2


@pytest.mark.parametrize("name", FILES)
def test_every_world_of_the_files_obeys_every_rule(worlds: dict[str, list[Layout]], name: str) -> None:
    """Brute force; and a vehicle can start in the corners."""
    rules = Procedural.load("layout", name)
    radius = Vehicle.load("vehicle", "default").radius
    for world in worlds[name]:
        assert broken_rules(world, rules) == []
        world.check_corners(radius)
        for key in ("name", "size", "channels", "border_channel", "start_margin", "start_side", "acts"):
            assert getattr(world, key) == getattr(rules, key)


def test_the_check_above_finds_every_kind_of_breach() -> None:
    """Worlds made by hand, one for each rule, that break that rule only."""
    rules = easy(count=[1, 2], count_of="world")

    def violations_of(*circles: tuple[float, float, float, str]) -> list[str]:
        parts = [
            {"center": [x, y], "radius": r, "effect": e, "channel": "fog" if e == "fog" else "solid"}
            for x, y, r, e in circles
        ]
        shared = {key: value for key, value in read("layout", "procedural_easy").items() if key in Layout.model_fields}
        return broken_rules(Layout(**shared, circles=parts), rules)

    assert violations_of((1.5, 1.0, 0.3, "obstacle"), (2.2, 1.0, 0.2, "fog")) == []
    assert violations_of((1.5, 1.0, 0.51, "obstacle")) == ["radius of 0"]
    assert violations_of((1.5, 1.0, 0.09, "obstacle")) == ["radius of 0"]
    assert violations_of((1.5, 0.34, 0.2, "obstacle")) == ["border distance of 0"]
    assert violations_of((2.66, 1.0, 0.2, "obstacle")) == ["border distance of 0"]
    assert violations_of((2.5, 0.5, 0.142, "fog")) == ["0 in a corner"]
    assert violations_of((0.59, 1.7, 0.1, "fog")) == [] and violations_of((0.49, 1.7, 0.1, "fog")) == ["0 in a corner"]
    assert violations_of((1.5, 1.0, 0.3, "fog"), (2.14, 1.0, 0.2, "obstacle")) == [
        "gap between (1.5, 1.0) and (2.14, 1.0)"
    ]
    assert violations_of((1.2, 1.0, 0.1, "fog"), (1.6, 1.0, 0.1, "fog"), (2.0, 1.0, 0.1, "fog")) == ["numbers [3]"]
    assert violations_of((1.5, 1.0, 0.1, "none")) == ["a circle of no property"]


@pytest.mark.parametrize("name", ["procedural_hard", "procedural_crowded_hard"])
def test_only_force_fields_overlap_and_they_do_in_most_hard_worlds(worlds: dict[str, list[Layout]], name: str) -> None:
    """Brute force over pairs."""
    overlapping: Counter[str] = Counter()
    for world in worlds[name]:
        pairs = {
            frozenset((one.effect, other.effect))
            for one, other in combinations(world.circles, 2)
            if math.dist(one.center, other.center) < one.radius + other.radius
        }
        assert all(pair & {"force_up", "force_down"} for pair in pairs)
        overlapping.update(["any"] * bool(pairs))
        overlapping.update(["field on field"] * any(pair <= {"force_up", "force_down"} for pair in pairs))
        overlapping.update(["field on other"] * any(pair & {"obstacle", "fog"} for pair in pairs))
    if name == "procedural_crowded_hard":
        assert list(overlapping.values()) == [SEEDS] * 3
    else:
        assert min(overlapping.values()) > SEEDS / 2


@pytest.mark.parametrize("name", ["procedural_hard", "procedural_crowded_hard"])
def test_unspaced_circles_are_as_the_paper_draws_them(worlds: dict[str, list[Layout]], name: str) -> None:
    """Closed form: means and shares of uniform numbers and radii, within 4 standard errors.

    Places are uniform over what borders and corners leave, which is symmetric: their mean is the arena's centre.
    """
    fields = [circle for world in worlds[name] for circle in world.circles if circle.effect.startswith("force")]
    radii = np.array([circle.radius for circle in fields])
    assert abs(radii.mean() - 0.3) < 4 * 0.4 / math.sqrt(12 * len(radii))
    assert abs((radii > 0.4).mean() - 0.25) < 4 * math.sqrt(0.25 * 0.75 / len(radii))
    centers = np.array([circle.center for circle in fields])
    assert (np.abs(centers.mean(0) - [1.5, 1.0]) < 4 * centers.std(0) / math.sqrt(len(centers))).all()
    if name == "procedural_crowded_hard":
        numbers = Counter(
            sum(circle.effect == effect for circle in world.circles)
            for world in worlds[name]
            for effect in ("force_up", "force_down")
        )
        assert sorted(numbers) == [6, 7, 8, 9, 10]
        for number in numbers.values():  # binomial(2 x seeds, 1/5)
            assert abs(number - 2 * SEEDS / 5) < 4 * math.sqrt(2 * SEEDS * 0.2 * 0.8)


def mean_area(rules: Procedural, margin: float) -> float:
    """Mean area of all circles of a world as drawn, u2: number and radius are uniform between their limits.

    The mean square of a number that is uniform in [a, b] is (a2 + ab + b2) / 3; each circle has `margin` (u) around it.
    """
    low, high = (radius + margin for radius in rules.radius)
    groups = len(rules.properties) if rules.count_of == "property" else 1
    return groups * sum(rules.count) / 2 * math.pi * (low**2 + low * high + high**2) / 3


def test_six_to_ten_of_each_kind_do_not_fit_and_six_to_ten_in_all_do() -> None:
    """Closed form from the files' numbers; and circles as drawn by plain sampling, within 4 standard errors.

    Of each of four kinds they have 10.4 u2 on average without any gap, the arena has 6 u2; in all, with half of the
    gap around each of them, 3.9 u2.
    """
    rules = {name: Procedural.load("layout", name) for name in FILES}
    arena = math.prod(rules["procedural_easy"].size)
    assert arena == pytest.approx(6.0)
    for name in ("procedural_crowded_easy", "procedural_crowded_hard"):
        needed = mean_area(rules[name], 0.0)
        assert needed == pytest.approx(10.39, abs=0.005) and needed > arena
    for name in ("procedural_easy", "procedural_hard"):
        needed = mean_area(rules[name], rules[name].gap / 2)
        assert needed == pytest.approx(3.87, abs=0.005) and needed < arena
    rng = np.random.default_rng(0)
    for name in FILES:
        count, radius, kinds = rules[name].count, rules[name].radius, len(rules[name].properties)
        groups = kinds if rules[name].count_of == "property" else 1
        numbers = rng.integers(*count, (4000, groups), endpoint=True).sum(1)
        areas = np.array([math.pi * (rng.uniform(*radius, number) ** 2).sum() for number in numbers])
        assert abs(areas.mean() - mean_area(rules[name], 0.0)) < 4 * areas.std() / math.sqrt(4000)


def test_worlds_say_where_their_terrains_act_as_their_rules_do() -> None:
    """Equal circles from equal generators; the files' rule, the other one, and none, which is the rim."""
    content = {key: value for key, value in read("layout", "procedural_hard").items() if key != "acts"}
    drawn = {
        acts: Procedural.checked(content | keys, "here").draw(generator(1, "worlds"))
        for acts, keys in {"center": {"acts": "center"}, "rim": {"acts": "rim"}, "": {}}.items()
    }
    assert [layout.acts for layout in drawn.values()] == ["center", "rim", "rim"]
    assert drawn["center"].circles == drawn["rim"].circles and drawn["rim"] == drawn[""]
    assert drawn["center"] == Procedural.load("layout", "procedural_hard").draw(generator(1, "worlds"))


def test_places_are_uniform_over_what_borders_and_corners_leave() -> None:
    """Against plain rejection: how many of 500 circles are how near to a corner square, within 4 standard errors."""
    kind = {"effect": "fog", "channel": "fog", "spaced": False}
    sizes: dict[str, Any] = {"size": [2.0, 2.0], "gap": 0.05, "corner_side": 0.6, "radius": [0.3, 0.3]}
    rules = easy(**sizes, count=[1, 1], count_of="world", properties=[kind])
    centers = np.array([rules.draw(generator(seed, "places")).circles[0].center for seed in range(500)])

    def to_corner(places: np.ndarray) -> np.ndarray:
        return np.hypot(*np.maximum(np.minimum(places, 2 - places) - 0.6, 0).T)

    places = np.random.default_rng(0).uniform(0.35, 1.65, (50000, 2))
    places = places[to_corner(places) >= 0.3]
    for near in (0.31, 0.35, 0.4):
        wanted = (to_corner(places) < near).mean()
        assert abs((to_corner(centers) < near).mean() - wanted) < 4 * math.sqrt(wanted * (1 - wanted) / 500)


def test_worlds_are_as_varied_as_the_module_says(worlds: dict[str, list[Layout]]) -> None:
    """Measured once over 100 worlds, less a margin; and no property has smaller circles than another."""
    radii = {name: np.array([one.radius for world in worlds[name] for one in world.circles]) for name in FILES}
    totals = {name: {len(world.circles) for world in worlds[name]} for name in FILES}
    assert {24, 25, 26} <= totals["procedural_crowded_easy"] and max(totals["procedural_crowded_easy"]) < 32
    assert len(totals["procedural_crowded_hard"]) > 7
    assert totals["procedural_easy"] == totals["procedural_hard"] == {6, 7, 8, 9, 10}
    crowded = radii["procedural_crowded_easy"]
    assert crowded.mean() > 0.12 and crowded.std() > 0.014 and (crowded < 0.1001).mean() < 0.05
    assert radii["procedural_easy"].mean() > 0.24 and radii["procedural_easy"].std() > 0.08
    for name in FILES[:3:2]:
        for effect in EFFECTS:
            mine = np.array([one.radius for world in worlds[name] for one in world.circles if one.effect == effect])
            assert abs(mine.mean() - radii[name].mean()) < 4 * mine.std() / math.sqrt(len(mine))


def test_a_world_with_room_keeps_what_was_drawn() -> None:
    """Closed form: two circles in a large arena are hardly ever in each other's way, so radii are uniform."""
    rules = easy(size=[30.0, 20.0], count=[2, 2], count_of="world")
    radii = np.array([one.radius for seed in range(200) for one in rules.draw(generator(seed, "room")).circles])
    assert abs(radii.mean() - 0.3) < 4 * 0.4 / math.sqrt(12 * 400) and radii.max() > 0.49 and radii.min() < 0.11


@pytest.mark.parametrize("name", ["procedural_easy", "procedural_crowded_easy"])
def test_easy_worlds_can_be_crossed_between_opposite_corners(worlds: dict[str, list[Layout]], name: str) -> None:
    """By hand: nothing overlaps and 0.15 u is wider than the vehicle, so there is always a way."""
    vehicle = Vehicle.load("vehicle", "default")
    for index, world in enumerate(worlds[name][:100]):
        start, goal = (world.corner(corner).mean(0) for corner in (index % 4, 3 - index % 4))
        assert crossable(world, vehicle, start, goal)


@pytest.mark.parametrize("name", FILES)
def test_the_same_generator_state_draws_the_same_world(worlds: dict[str, list[Layout]], name: str) -> None:
    """Against the worlds drawn before, in another order; and all of those differ."""
    rules = Procedural.load("layout", name)
    for seed in (3, 1):
        assert rules.draw(generator(seed, "worlds")) == worlds[name][seed]
    rng = generator(3, "worlds")
    assert rules.draw(rng) != rules.draw(rng)
    assert len({world.circles for world in worlds[name]}) == SEEDS


kinds = st.builds(Property, effect=st.sampled_from([*EFFECTS, "none"]), channel=st.just("b"), spaced=st.booleans())


@st.composite
def feasible(draw: st.DrawFn) -> Procedural:
    """Rules whose circles, at their smallest and with half the gap around each, fill a quarter of the arena or less."""
    size = (draw(st.floats(1, 4)), draw(st.floats(1, 4)))
    gap, corner = draw(st.just(0.0) | st.floats(1e-9, 0.15)) * min(size), draw(st.floats(0.05, 0.3)) * min(size)
    room = min(min(size) / 2 - gap, math.hypot(*(side / 2 - corner for side in size)))
    largest = draw(st.floats(0.1, 0.9)) * room
    smallest = draw(st.floats(0.1, 1.0)) * largest
    properties = draw(st.lists(kinds, min_size=1, max_size=4, unique_by=lambda kind: kind.effect))
    count_of = draw(st.sampled_from(["property", "world"]))
    groups = len(properties) if count_of == "property" else 1
    free = (size[0] - gap) * (size[1] - gap) - 4 * corner**2
    most = int(free / 4 / (math.pi * (smallest + gap / 2) ** 2)) // groups
    assume(most > 0)
    fewest = draw(st.integers(1, min(most, 12 // groups)))
    values = {"size": size, "gap": gap, "corner_side": corner, "start_margin": corner / 3, "start_side": corner / 2}
    return easy(
        **values,
        channels=("a", "b"),
        border_channel="a",
        count=(fewest, fewest + draw(st.integers(0, 4))),
        count_of=count_of,
        radius=(smallest, largest),
        properties=properties,
    )


@quick
@given(feasible(), st.integers(0, 2**32 - 1))
def test_worlds_of_other_rules_obey_them(rules: Procedural, seed: int) -> None:
    """Brute force, as above."""
    assert broken_rules(rules.draw(np.random.default_rng(seed)), rules) == []


def test_a_single_circle_that_just_fits_is_placed() -> None:
    """By hand: the largest radius allowed leaves one height for the centre."""
    rules = easy(radius=[0.849, 0.849], count=[1, 1], count_of="world", corner_side=0.31)
    for seed in range(20):
        assert broken_rules(rules.draw(np.random.default_rng(seed)), rules) == []


@pytest.mark.parametrize("changes", [{"radius": [0.4, 0.5]}, {"gap": 0.5, "radius": [0.1, 0.1]}])
def test_impossible_rules_end_with_a_sentence(changes: dict[str, Any]) -> None:
    """50 circles whose area alone exceeds the arena's; within seconds."""
    rules = easy(count=[50, 50], count_of="world", **changes)
    begin = time.process_time()
    with pytest.raises(ValueError, match="no layout was found") as caught:
        rules.draw(np.random.default_rng(0))
    assert time.process_time() - begin < 10
    wanted = ["layout 'procedural_easy'", "count = [50, 50]", f"radius = {list(rules.radius)}", f"gap = {rules.gap}"]
    assert [part for part in [*wanted, "smaller"] if part not in str(caught.value)] == []


def obstacle(**changes: Any) -> dict[str, Any]:
    return {"effect": "obstacle", "channel": "solid", "spaced": True, **changes}


DOORS = [obstacle(effect=effect, spaced=False) for effect in ("door", "key", "obstacle")]


def test_each_world_with_doors_has_a_key_that_can_be_visited() -> None:
    """Circles that may overlap anything, of very different sizes: some key would be inside another circle."""
    rules = easy(properties=DOORS, count_of="property", count=[3, 3], radius=[0.05, 0.5])
    for seed in range(20):
        circles = rules.draw(generator(seed, "doors")).circles
        solid = [circle for circle in circles if circle.effect != "key"]
        for key in (circle for circle in circles if circle.effect == "key"):
            assert all(math.dist(key.center, each.center) > each.radius - key.radius for each in solid)


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"count": [7, 6]}, ["count = [7, 6]", "smaller value first"]),
        ({"count": [0, 6]}, ["count[0] = 0", "greater than 0"]),
        ({"count": [6]}, ["count[1] is missing"]),
        ({"count_of": "arena"}, ["count_of = 'arena'", "'property' or 'world'"]),
        ({"acts": "edge"}, ["acts = 'edge'", "'center' or 'rim'"]),
        ({"radius": [0.5, 0.1]}, ["radius = [0.5, 0.1]", "smaller value first"]),
        ({"radius": [0.0, 0.1]}, ["radius[0] = 0.0", "greater than 0"]),
        ({"radius": [0.1, math.nan]}, ["radius[1] = nan", "finite number"]),
        ({"radius": [0.1, 0.86]}, ["radius = [0.1, 0.86]", "size [3.0, 2.0]", "gap = 0.15", "fits has radius 0.85"]),
        (
            {"corner_side": 1.0, "gap": 0.0, "radius": [0.1, 0.6]},
            ["radius = [0.1, 0.6]", "corner_side = 1.0", "fits has radius 0.5"],
        ),
        ({"gap": -0.1}, ["gap = -0.1", "greater than or equal to 0"]),
        ({"gap": 1.2}, ["gap = 1.2", "fits has radius -0.2"]),
        ({"corner_side": 0.29}, ["corner_side = 0.29", "at least start_margin + start_side = 0.3"]),
        ({"corner_side": 1.1}, ["corner_side = 1.1", "size [3.0, 2.0]", "at most 1."]),
        ({"properties": [obstacle(channel="sea")]}, ["properties[0].channel = 'sea'", "['solid', 'fog', 'force_up'"]),
        ({"properties": [obstacle(), obstacle(effect="wall")]}, ["properties[1].effect = 'wall'", "'fog'"]),
        ({"properties": [obstacle(colour="red")]}, ["properties[0].colour = 'red'", "not a known key"]),
        ({"properties": []}, ["properties = []", "at least 1 item"]),
        ({"channels": ["solid"] * 2}, ["channels = ['solid', 'solid']", "give each its own name"]),
        ({"border_channel": "sea"}, ["border_channel = 'sea'", "one of channels ['solid'"]),
        ({"size": [3.0, 0.0]}, ["size[1] = 0.0", "greater than 0"]),
        (
            {"count": [1, 300], "count_of": "property"},
            ["count = [1, 300] of each of 4 properties", "up to 1200 circles", "at most 1000"],
        ),
        ({"circles": []}, ["circles = []", "not a known key"]),
        ({"properties": [obstacle(effect="door")], "count_of": "property"}, ["properties ['door'] with", "no key"]),
        ({"properties": DOORS, "count_of": "world"}, ["count_of = 'world' allow worlds with a door and no key"]),
    ],
)
def test_bad_input_is_named_with_call_key_value_and_remedy(changes: dict[str, Any], parts: list[str]) -> None:
    """Golden parts of the message."""
    with pytest.raises(ConfigError) as caught:
        easy(**changes)
    message = str(caught.value)
    assert message.startswith("Procedural.load: ")
    assert [part for part in parts if part not in message] == [], message


def test_corner_squares_that_just_cover_the_start_squares_are_allowed() -> None:
    """0.1 + 0.2 exceeds 0.3 in floating point."""
    assert easy(corner_side=0.3).draw(np.random.default_rng(0)).corner(0).max() <= 0.3 + 1e-9


@pytest.mark.parametrize("key", sorted(set(Procedural.model_fields) - {"acts", "views_in_fog"}))
def test_a_missing_key_is_named(key: str) -> None:
    content = {name: value for name, value in read("layout", "procedural_easy").items() if name != key}
    with pytest.raises(ConfigError, match=f"^conf/layout/x.yaml: {key} is missing; add the key.$"):
        Procedural.checked(content, "conf/layout/x.yaml")
