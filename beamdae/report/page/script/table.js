// The table of cases.

const TABLED = { error: height, cost: (one) => one.cost };

function tableColumns() {
  const given = page.columns.find((column) => column.key === "label") ?? { label: "case", unit: "" };
  const sentence = page.columns.find((column) => column.kind === "status") ?? { label: "status", unit: "" };
  const others = page.columns.filter((column) => column.key !== "label" && column.kind !== "status");
  return [
    { ...given, kind: "label", value: (one) => one.label, order: (one) => one.rank ?? one.label },
    { ...sentence, kind: "status", value: (one) => one.status },
    ...others.map((column) => ({
      ...column,
      value: TABLED[column.kind] ?? ((one) => own(one.values, column.key)),
    })),
  ];
}

function drawTable() {
  byId("cases").hidden = !scatters();
  const [head, body] = byId("table").children;
  head.replaceChildren(html("tr", {}, html("th", { "aria-label": "selected" }), ...columns.map(header)));
  body.replaceChildren(...casesHere().map(row));
  sortTable();
  filterTable();
}

function header(column) {
  const unit = column.unit ? [html("span", { class: "unit" }, `[${column.unit}]`)] : [];
  const button = html(
    "button",
    { type: "button", click: () => sortBy(column) },
    html("span", { class: "name" }, column.label),
    ...unit,
  );
  return html("th", { class: column.kind, scope: "col" }, button);
}

function row(one) {
  const box = html("input", {
    type: "checkbox",
    "aria-label": `select ${one.label}`,
    change: () => toggle(one.id),
  });
  const select = (event) => event.target !== box && toggle(one.id);
  const cells = columns.map((column) => cell(one, column));
  return html(
    "tr",
    { "data-case": one.id, click: select },
    html("td", {}, box, " ", html("span", { class: "number badge" })),
    ...cells,
  );
}

function cell(one, column) {
  const alarm = column.kind === "status" && failed(one) ? "alarm" : "";
  const image = column.kind === "label" ? [familySign(one.family)] : [];
  return html("td", { class: `${column.kind} ${alarm}` }, ...image, cellText(one, column));
}

function cellText(one, column) {
  const text = shown(column.value(one));
  if (column.kind !== "error" || !one.below) return text;
  return resolution() ? `< ${shown(resolution(), 2)}` : "not resolved";
}

function sortBy(column) {
  const again = state.order?.column === column;
  state.order = { column, descending: again && !state.order.descending };
  sortTable();
}

function sortTable() {
  const [head, body] = byId("table").children;
  const rows = new Map([...body.children].map((element) => [element.dataset.case, element]));
  body.append(
    ...casesHere()
      .sort(compare)
      .map((one) => rows.get(one.id)),
  );
  columns.forEach((column, k) => {
    const direction =
      state.order?.column === column ? (state.order.descending ? "descending" : "ascending") : "none";
    head.rows[0].cells[k + 1].setAttribute("aria-sort", direction);
  });
}

function compare(one, other) {
  const ends = failed(one) - failed(other);
  if (ends || !state.order) return ends;
  const { value, order = value } = state.order.column;
  const [a, b] = [one, other].map(order);
  const missing = (a ?? null) === null || (b ?? null) === null;
  if (missing) return ((a ?? null) === null) - ((b ?? null) === null);
  const way = state.order.descending ? -1 : 1;
  const numbers = typeof a === "number" && typeof b === "number";
  return way * (numbers ? a - b : String(a).localeCompare(String(b), "en", { numeric: true }));
}

function filterTable() {
  const words = byId("filter").value.toLowerCase().split(/\s+/);
  const rows = [...byId("table").tBodies[0].rows];
  for (const element of rows) {
    const text = element.textContent.toLowerCase();
    element.hidden = !words.every((word) => text.includes(word));
  }
  byId("count").value = `${rows.filter((element) => !element.hidden).length} of ${rows.length} cases`;
}
