// Tables of facts: what a run cost, how good it is, where it comes from.

// The first one of a single run stands beside its motion.
function drawFacts() {
  const first = scatters() ? 0 : 1;
  const parted = { facts: page.tables.slice(0, first), more: page.tables.slice(first) };
  for (const [id, tables] of Object.entries(parted)) {
    byId(id).hidden = !tables.length;
    byId(id).replaceChildren(...tables.map(factTable));
  }
}

function factTable({ title: name, head, rows }) {
  const numeric = (k) => head.length > 0 && k > 0 && rows.every((row) => row[k] === "-" || isFinite(row[k]));
  const cell = (value, k) => html("td", { class: numeric(k) ? "number" : "" }, shown(value));
  const lines = rows.map(([first, ...others]) =>
    html("tr", {}, html("th", { scope: "row" }, first), ...others.map((value, k) => cell(value, k + 1))),
  );
  const title = (name, k) => html("th", { scope: "col", class: numeric(k) ? "number" : "" }, name);
  const heads = head.length ? [html("thead", {}, html("tr", {}, ...head.map(title)))] : [];
  return html(
    "div",
    {},
    html("h2", {}, name),
    html("div", { class: "scroll" }, html("table", {}, ...heads, html("tbody", {}, ...lines))),
  );
}
