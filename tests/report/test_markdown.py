"""References: markdown-it reads back the text that was escaped; pages by hand."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from affmap.report.markdown import bullets, code, escape, escape_name, fill, text_table
from affmap.report.page import html, parse, pdf, plain
from affmap.settings import ConfigError

TEXTS = st.text(st.characters(codec="ascii", exclude_categories=["Cc"]) | st.sampled_from("äé–“”…−λ"), max_size=40)


@dataclass
class Content:
    """Two directives."""

    amount: str

    def number(self) -> str:
        return self.amount

    def twice(self, word: str) -> str:
        return f"{word} {word}"


def page(folder: Path, **texts: str) -> Path:
    """Write texts; the path of the one called `page`."""
    for name, text in texts.items():
        (folder / f"{name}.md").write_text(text, "utf-8")
    return folder / "page.md"


@given(TEXTS.map(lambda text: " ".join(text.split())).filter(bool))
@example("1. one")
@example("- *a* _b_ `c` [d](e) ![f](g) <h> &amp; | # \\\\*")
@example("+ a")
@example("1) a")
def test_escaped_text_is_text_everywhere(text: str) -> None:
    """In a paragraph, a heading, a list, italics and the cell of a table."""
    escaped = escape(text)
    assert plain(parse(f"{escaped}")) == text
    assert plain(parse(f"## {escaped}")) == text
    assert plain(parse(bullets([escaped]))) == text
    (italics,) = parse(f"*{escaped}*")
    assert [part["kind"] for part in italics["parts"]] == ["em"] and plain([italics]) == text
    (table,) = parse(text_table([text], [[text]]))
    assert [plain(table["head"][0]), plain(table["rows"][0][0])] == [text, text]


@given(TEXTS.map(lambda text: " ".join(text.split())).filter(bool))
@example("`` a ` b ``")
@example("two_words _x_ __y__")
def test_code_and_names_are_text(text: str) -> None:
    """Also of many backticks; underscores stay as they are within words."""
    ((node,),) = (part["parts"] for part in parse(code(text)))
    assert (node["kind"], node["text"]) == ("code_inline", text)
    assert plain(parse(escape_name(text))) == text
    assert escape_name("procedural_easy") == "procedural_easy"


def test_what_github_takes_for_mathematics_has_no_dollar() -> None:
    assert escape("$x$ ~~y~~") == "&#36;x&#36; &#126;&#126;y&#126;&#126;"


def test_directives_are_filled_in_lines_and_within_them(tmp_path: Path) -> None:
    path = page(tmp_path, page="# {{ twice a/b }}\n\n{{ number }}\n\n\n\nsaid {{ number }} times\n")
    assert fill(path, Content("5"), [tmp_path]) == "# a/b a/b\n\n5\n\nsaid 5 times\n"


def test_an_included_text_goes_with_what_it_is_about(tmp_path: Path) -> None:
    """Heading and explanation of an empty table are left out; a text without directives stays."""
    texts = {
        "page": "{{ include part }}\n\n{{ include fixed }}\n",
        "part": "## Part\n\n{{ number }}\n",
        "fixed": "F.\n",
    }
    path = page(tmp_path, **texts)
    assert fill(path, Content("5"), [tmp_path]) == "## Part\n\n5\n\nF.\n"
    assert fill(path, Content(""), [tmp_path]) == "F.\n"
    (tmp_path / "own").mkdir()
    page(tmp_path / "own", fixed="Own.\n")
    assert fill(path, Content(""), [tmp_path / "own", tmp_path]) == "Own.\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{{ amount }}", r"\{\{ amount \}\} is not a directive; choose one of: include, number, twice"),
        ("{{ nothing }}", "is not a directive"),
        ("{{ number 5 }}", r"needs no argument; write \{\{ number \}\}"),
        ("{{ twice }}", r"needs an argument; write \{\{ twice word \}\}"),
        ("{{number}}", r"\{\{number\}\} cannot be read; write \{\{ name \}\}"),
        ("{{ twice a b }}", "cannot be read"),
        ("{{ include page }}", "includes itself"),
        ("{{ include other }}", "there is no text 'other' to include; looked for .*other.md"),
    ],
)
def test_a_wrong_directive_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        fill(page(tmp_path, page=text), Content("5"), [tmp_path])


def test_figures_alerts_and_widgets_are_parts_of_their_own() -> None:
    """By hand; HTML that is no place of a widget is text."""
    text = "![one](figures/one.png)\n\n*A caption.*\n\n**Beware.**\n\n<!-- player -->\n\n<b>x</b>\n"
    figure, alert, widget, raw = parse(text)
    assert (figure["kind"], figure["source"], plain(figure["parts"])) == ("figure", "figures/one.png", "A caption.")
    assert (alert["kind"], plain(alert["parts"])) == ("alert", "Beware.")
    assert (widget["kind"], widget["name"]) == ("widget", "player")
    assert plain([raw]) == "<b>x</b>" and {part["kind"] for part in raw["parts"]} == {"text"}


def test_headings_of_one_name_have_places_of_their_own() -> None:
    """By hand: the links of the contents lead to each."""
    anchors = [part["anchor"] for part in parse("## A b\n\n## A b\n\n### C\n")]
    assert anchors == ["part-a-b", "part-a-b-2", "part-c"]


def test_everything_that_markdown_can_say_is_set(tmp_path: Path) -> None:
    """Each kind of CommonMark, as PDF and as HTML."""
    text = (
        "# T\n\n---\n\n> quote\n\n1. one\n\n`code` **b** *i* [link](#x) ![in a line](none.png)\\\nnext\n\n    block\n"
    )
    assert pdf(tmp_path, text, None).startswith(b"%PDF")
    shown = html(tmp_path, text, {})
    assert all(tag in shown for tag in ("<hr>", "<blockquote>", "<ol>", "<code>", "<br>", "<pre>", "in a line"))
