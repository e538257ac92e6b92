// Tables are sorted by a click on the head of a column: upwards, downwards, and as they were written.

const NUMBER = /^[<>±+]?\s*([−-]?\d+(?:\.\d+)?)(?=$|[\s[(*%])/;
const NOTHING = "–";

/** The number that a text such as "−0.41 [−0.5, −0.3]", "0.41 *" or "< 0.001" begins with; NaN where there is none. */
function leading(text) {
  const found = NUMBER.exec(text);
  if (!found) return NaN;
  const value = Number(found[1].replace("−", "-"));
  return text.startsWith("<") ? value - 1e-9 : value;
}

/** What tells the order of two rows by the texts of a column; those that have nothing come last in either order. */
function comparison(texts, sign) {
  const known = texts.filter((text) => text && text !== NOTHING);
  const numeric = known.every((text) => !Number.isNaN(leading(text)));
  const missing = (text) => !text || text === NOTHING;
  return (a, b) => {
    if (missing(a) || missing(b)) return missing(a) - missing(b);
    return sign * (numeric ? leading(a) - leading(b) : a.localeCompare(b, "en", { numeric: true }));
  };
}

for (const table of document.querySelectorAll("table")) {
  const body = table.tBodies[0];
  const written = [...body.rows];
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: null }[head.getAttribute("aria-sort")];
      const order = next === undefined ? "ascending" : next;
      for (const other of heads) other.removeAttribute("aria-sort");
      if (!order) return body.append(...written);
      head.setAttribute("aria-sort", order);
      const text = (row) => row.cells[column].textContent.trim();
      const compare = comparison(written.map(text), order === "ascending" ? 1 : -1);
      body.append(...written.toSorted((a, b) => compare(text(a), text(b))));
    });
  });
}
