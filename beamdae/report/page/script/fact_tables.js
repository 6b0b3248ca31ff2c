// Tables of facts about a run, such as its cost, accuracy and provenance.

// On the page of a single run, the first table is shown beside the animation.
function drawFactTables() {
  const besideMotion = isStudyPage() ? 0 : 1;
  const tables = { facts: page.tables.slice(0, besideMotion), "more-facts": page.tables.slice(besideMotion) };
  for (const [id, sectionTables] of Object.entries(tables)) {
    byId(id).hidden = !sectionTables.length;
    byId(id).replaceChildren(...sectionTables.map(createFactTable));
  }
}

function createFactTable({ title, head, rows }) {
  const isNumeric = (k) =>
    head.length > 0 && k > 0 && rows.every((row) => row[k] === "-" || Number.isFinite(Number(row[k])));
  const columnClass = (k) => (isNumeric(k) ? "number" : "");
  const bodyRows = rows.map(([name, ...values]) => {
    const cells = values.map((value, k) => html("td", { class: columnClass(k + 1) }, formatValue(value)));
    return html("tr", {}, html("th", { scope: "row" }, name), ...cells);
  });
  const headCells = head.map((name, k) => html("th", { scope: "col", class: columnClass(k) }, name));
  const tableHead = head.length ? [html("thead", {}, html("tr", {}, ...headCells))] : [];
  return html(
    "div",
    {},
    html("h2", {}, title),
    html("div", { class: "scroll" }, html("table", {}, ...tableHead, html("tbody", {}, ...bodyRows))),
  );
}
