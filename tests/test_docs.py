"""The documentation: it builds, without network; what it says works; what it quotes is there."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote

import pytest
import yaml
from playwright.sync_api import Browser, expect

import affmap
from affmap.env.registration import environments

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
CONF = ROOT / "conf"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of the project where a reader may change it."""
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("affmap", "conf", "hydra_plugins", "docs", "notebooks"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    shutil.copytree(ROOT / "runs/reference", tmp_path / "runs/reference")
    for name in ("mkdocs.yml", "pyproject.toml", "CITATION.cff", "README.md"):
        shutil.copy(ROOT / name, tmp_path)
    loops = Path("affmap/compiled/__pycache__")
    (tmp_path / loops).mkdir()
    for path in (ROOT / loops).glob("*.nb[ci]"):  # compiled, which takes minutes; of other sources they are not used
        shutil.copy(path, tmp_path / loops)
    return tmp_path


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built where nothing outside can be reached, in a process of its own."""
    for package in ("material", "mkdocstrings_handlers.python", "ziamath"):
        pytest.importorskip(package, reason="the extra [docs]: make docs")
    folder = tmp_path_factory.mktemp("site")
    script = [sys.executable, "-W", "ignore", "-c", BUILD, "build", "--strict", "--site-dir", folder]
    result = subprocess.run(script, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stdout + result.stderr
    return folder


BUILD = """
import socket
def refuse(*_): raise OSError("no network here")
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
from mkdocs.__main__ import cli
cli()
"""


class Found(HTMLParser):
    """What a page links to, loads and shows."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.formulas = 0
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = dict(attributes)
        self.links += [values["href"] or ""] if tag == "a" and "href" in values else []
        self.loaded += [values[key] or "" for key in ("src", "href") if key in values and tag != "a"]
        self.images += [values] if tag == "img" else []
        self.formulas += tag == "math"


def place(path: Path, site: Path) -> str:
    return path.relative_to(site).with_suffix("").as_posix()


def test_the_site_builds_whole(site: Path) -> None:
    """Every page of the navigation; nothing is loaded from elsewhere; links and pictures are there and described."""
    pages = {path: Found(path) for path in site.rglob("*.html") if path.name != "404.html"}
    rooms = [path.parent.name for path in (ROOT / "affmap/experiments").glob("*/page.md")]
    rooms = [room for room in rooms if (ROOT / "runs/reference" / room / "report.md").is_file()]  # published ones
    navigation = re.findall(r": (\S+)\.md$", (ROOT / "mkdocs.yml").read_text("utf-8"), flags=re.M)
    navigation += [f"experiments/{room}" for room in rooms]
    navigation += [name.replace("affmap", "environments") for name in environments()]
    navigation += [
        f"commands/{name}" for name in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    ]
    places = sorted(place(path, site) for path in pages)
    assert sorted(navigation) == [name for name in places if not name.startswith("api/")]
    public = [name for name in affmap.__all__ if not isinstance(getattr(affmap, name), ModuleType | str)]
    assert {f"api/affmap.{name}" for name in public} <= {*places}
    for path, found in pages.items():
        inside = [link for link in found.loaded if not link.startswith("data:")]
        assert not [link for link in inside if "//" in link], f"{path} loads something from elsewhere"
        for link in [*inside, *found.links]:
            if "//" not in link and not link.startswith("#"):
                assert (path.parent / unquote(link.partition("#")[0])).exists(), f"{path} has a broken link {link}"
        assert all(image.get("alt") for image in found.images), f"{path} has a picture without a description"
        unfilled = re.findall(r"<p><(?:a|em)[^>]*>(?:\.\./|Figure: ).*</p>", path.read_text("utf-8"))
        assert not unfilled, f"{path} has a part that was not filled in"
    for path in site.rglob("*.css"):
        outside = re.findall(r"(?:@import|url\()\s*['\"]?(?:https?:)?//", path.read_text("utf-8"))
        assert not outside, f"{path} loads something from elsewhere"


def test_every_page_can_be_found(site: Path) -> None:
    """The search's index is a script, which a page from the disk can load, and has all pages."""
    variable, index = (site / "search/search_index.js").read_text("utf-8").split(" = ", 1)
    found = {document["location"].partition("#")[0] for document in json.loads(index)["docs"]}
    assert variable == "var __index"
    assert found == {f"{place(path, site)}.html" for path in site.rglob("*.html") if path.name != "404.html"}


def test_every_key_is_in_the_reference(site: Path) -> None:
    """Those of the files of `conf`, each with a type, a default and a meaning."""
    reference = (site / "settings.html").read_text("utf-8")
    found = re.findall(
        r'<h[34] class="key" id="\S+"><code>(\S+)</code>.+\n<p class="kind">.+; default .+</p>\n<p>.+', reference
    )
    for path in CONF.glob("*/*.yaml"):
        text = path.read_text("utf-8")
        if path.parent.name not in ("layout", "protocol", "hydra") and "@package _global_" not in text:
            prefix = f"{path.parent.name}."
            missing = [key for key in yaml.safe_load(text) if key != "kind" and prefix + key not in found]
            assert not missing, f"{path} has {missing}"
    assert len(found) == reference.count('class="key"')


ON_A_GIT_HOST = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *DOCS.rglob("*.md"),
    *(ROOT / "notebooks").glob("*.ipynb"),
]


@pytest.mark.parametrize("page", ON_A_GIT_HOST, ids=lambda page: page.stem)
def test_a_page_can_be_read_on_a_git_host(page: Path) -> None:
    """It has no line that only the site understands, and its links and pictures are there."""
    text = page.read_text("utf-8")
    if page.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    text = re.sub(r"^```\w*\n.*?^(?:```)$", "", text, flags=re.M | re.S)
    assert re.findall(r"^(?:\{\{|:::).*$|\]\[[\w.]*\]", text, flags=re.M) == []
    for target in re.findall(r"\]\(([^()\s#]+)", text):
        assert "//" in target or (page.parent / target).exists(), f"{page} has a broken link {target}"


def test_pages_of_names_tell_limits_in_words(site: Path) -> None:
    """A golden row, and no page with a type that only pydantic reads, but for that of `Neutral`, which is for it."""
    cells = "<code>momentum</code>", "number ≥ 0, &lt; 1", r"Weight of the old mean and variance\."
    row = r"\s*".join(f"<td[^>]*>{cell}</td>" for cell in cells)
    assert re.search(row, (site / "api/affmap.CEMPlanner.html").read_text("utf-8"))
    pages = {path.stem: re.sub("<[^>]+>", "", path.read_text("utf-8")) for path in (site / "api").glob("*.html")}
    assert [name for name, text in pages.items() if "Annotated[" in text] == ["affmap.settings.Neutral"]


PHONE = 400
"""Pixels, the width of a phone."""


WIDE = """[...document.querySelectorAll("html, .md-typeset__scrollwrap")]
    .filter(box => box.scrollWidth > box.clientWidth).map(box => box.innerText)"""


def test_the_site_fits_a_phone_and_searches_from_the_disk(site: Path, browser: Browser) -> None:
    """A page of each kind in Chromium, which asks for nothing outside the site; names and keys are found first."""
    page = browser.new_page(viewport={"width": PHONE, "height": 800})
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    kinds = {
        place(path, site).partition("/")[0]: path for path in sorted(site.rglob("*.html")) if path.name != "404.html"
    }
    for path in kinds.values():
        page.goto(path.as_uri())
        wide = page.evaluate(WIDE)
        assert not wide, f"{path} has what is wider than a phone: {wide}"
    page.locator("label[for=__search]").first.click()
    query, first = page.locator("input[name=query]"), page.locator(".md-search-result__item").first.locator("a")
    for typed, name in [("cem", "affmap.CEMPlanner"), ("affmap.train", "affmap.train")]:
        query.fill("")
        query.press_sequentially(typed)
        expect(first.first).to_have_attribute("href", re.compile(rf"/api/{name}\.html\?h="))
    for group, key in [("control", "beta"), ("model", "context_size"), ("planner.cem", "num_iterations")]:
        query.fill("")
        query.press_sequentially(key)
        reference = re.compile(rf"/settings\.html\?h=[\w+]+#{group}\.{key}$")
        expect(first.nth(1)).to_have_attribute("href", reference)
    assert [url for url in asked if not url.startswith((site.as_uri(), "data:", "blob:"))] == []
    page.close()


def test_formulas_are_drawn_by_the_browser_itself(site: Path) -> None:
    """As many as there are in the Markdown, none of which is left as LaTeX."""
    text = (DOCS / "equations.md").read_text("utf-8")
    assert Found(site / "equations.html").formulas == text.count("```math") + text.count("$`") > 20
    assert "\\mathbf" not in (site / "equations.html").read_text("utf-8").replace("alttext", "")


def test_excerpts_of_code_say_what_they_leave_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole statements, with the loops and conditions around them, and a mark for each gap; docstrings are none."""
    monkeypatch.syspath_prepend(DOCS / "hooks")
    excerpt = importlib.import_module("excerpt").excerpt
    code = '''
    def walk(steps):
        """Walk."""
        place = 0
        for step in steps:
            if step:
                place += sum(
                    step,
                )
            else:
                break
            place %= 2
        return place
    '''
    loop = (
        "for step in steps:\n    if step:\n        place += sum(\n            step,\n        )\n    else:\n        ..."
    )
    assert excerpt(code, ["place ="]) == "place = 0\n..."
    assert excerpt(code, ["place +="]) == f"...\n{loop}\n    ...\n..."
    assert excerpt(code, ["place", "break"]) == f"place = 0\n{loop[:-3]}break\n    place %= 2\nreturn place"
    with pytest.raises(ValueError, match="walk has no line with jump"):
        excerpt(code, ["place", "jump"])


def test_sentences_of_the_page_on_trouble_exist() -> None:
    """Its quotes, in the source; a dot stands for the parts that vary."""
    source = "".join(path.read_text("utf-8") for path in (ROOT / "affmap").rglob("*.py"))
    source = re.sub(r"\{[^{}\n]*\}", "…", re.sub(r"\"\s+f?\"", "", source))
    quotes = re.findall(r"^\| `([^`]* [^`]*)` \|", (DOCS / "troubleshooting.md").read_text("utf-8"), flags=re.M)
    assert len(quotes) > 5
    assert [part for quote in quotes for part in quote.split("…") if part.strip() not in source] == []


ENTRIES = re.split(r"^## ", (DOCS / "lablog.md").read_text("utf-8"), flags=re.M)[1:]


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.partition("\n")[0])
def test_numbers_of_the_lab_log_are_those_of_its_sources(entry: str) -> None:
    """Decimals and percentages of each entry's words, in the files that it names."""
    told, _, sources = entry.partition("Source: ")
    files = [ROOT / name for name in re.findall(r"`([\w/.]+\.(?:md|yaml|py))`", sources)]
    text = " ".join(" ".join(path.read_text("utf-8") for path in files).split())
    words = " ".join(re.sub(r"^[\[|].*$", "", told, flags=re.M).split())
    numbers = re.findall(r"[−-]?\d+\.\d+|\d+ %", words)
    assert [number for number in numbers if number not in text] == []
    assert sources


def test_commits_of_the_lab_log_exist() -> None:
    history = subprocess.run(["git", "log", "--format=%h", "--abbrev=7"], cwd=ROOT, capture_output=True, text=True)
    if history.returncode or len(history.stdout.split()) < 100:
        pytest.skip("no whole history here")
    commits = re.findall(r"`([0-9a-f]{7})`", "".join(ENTRIES))
    assert len(commits) > 10 and set(commits) <= set(history.stdout.split())


def test_pictures_are_small() -> None:
    """Below 200 KB each, 3 MB in all; films may be larger."""
    pictures = list((DOCS / "images").iterdir())
    assert max(path.stat().st_size for path in pictures if path.suffix == ".png") < 200_000
    assert sum(path.stat().st_size for path in pictures) < 3_000_000


PAGES = [
    ROOT / "README.md",
    *(DOCS / f"{name}.md" for name in ("index", "quickstart", "python", "plots", "configuration", "environment")),
    *sorted(DOCS.glob("howto/*.md")),
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_says_works(page: Path, checkout: Path) -> None:
    """All of its code and commands, in order, in a checkout of their own."""
    if page.stem == "experiment":
        pytest.importorskip("material", reason="the extra [docs]: make docs")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PYTHONPATH": str(checkout), "PATH": path, "OMP_NUM_THREADS": "1"}
    script = [sys.executable, "-W", "ignore", ROOT / "tests/pages.py", page]
    result = subprocess.run(script, cwd=checkout, env=environment, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stdout + result.stderr
