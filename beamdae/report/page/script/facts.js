// Tables of facts: what a run cost, how good it is, where it comes from.

function drawFacts() {
  byId("facts").hidden = !page.tables.length;
  byId("facts").replaceChildren(...page.tables.map(factTable));
}

function factTable({ title, head, rows }) {
  const cells = (row, [first, ...others]) => html("tr", {}, html("th", { scope: row }, first), ...others);
  const lines = rows.map((row) =>
    cells("row", [String(row[0]), ...row.slice(1).map((value) => html("td", {}, shown(value)))]),
  );
  const heads = head.length
    ? [html("thead", {}, html("tr", {}, ...head.map((name) => html("th", { scope: "col" }, name))))]
    : [];
  return html(
    "div",
    {},
    html("h2", {}, title),
    html("div", { class: "scroll" }, html("table", {}, ...heads, html("tbody", {}, ...lines))),
  );
}
