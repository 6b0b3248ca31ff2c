// Tables of facts about a run, such as its cost, accuracy and provenance, in the sections of the page.

const FACT_SECTIONS = { results: "result-facts", errors: "error-facts", solver: "solver-facts" };

function drawFactTables() {
  for (const [section, id] of Object.entries(FACT_SECTIONS)) {
    byId(id).replaceChildren(...page.tables.filter((table) => table.section === section).map(createFactTable));
  }
}

// Sections without content are hidden. Charts, tables and texts count, controls do not.
function hideEmptySections() {
  const hasContent = (id) => byId(id).children.length > 0;
  byId("errors").hidden = !["reference", "error-facts", "error-panels"].some(hasContent);
  byId("solver").hidden = !["solver-facts", "solver-panels"].some(hasContent) && !byId("versions").textContent;
  byId("results").hidden = !isStudyPage() && !hasContent("result-facts");
}

function createFactTable({ title, head, rows }) {
  const isNumeric = (k) =>
    head.length > 0 && k > 0 && rows.every((row) => row[k] === "-" || Number.isFinite(Number(row[k])));
  const columnClass = (k) => (isNumeric(k) ? "number" : "");
  const bodyRows = rows.map(([name, ...values]) => {
    const cells = values.map((value, k) => html("td", { class: columnClass(k + 1) }, formatValue(value)));
    return html("tr", {}, html("th", { scope: "row" }, name), ...cells);
  });
  const headCells = head.map((name, k) =>
    name ? html("th", { scope: "col", class: columnClass(k) }, name) : html("td", {}),
  );
  const tableHead = head.length ? [html("thead", {}, html("tr", {}, ...headCells))] : [];
  const table = html("table", {}, ...tableHead, html("tbody", {}, ...bodyRows));
  const heading = title ? [html("h3", {}, title)] : [];
  return html("div", { class: "printed" }, ...heading, createScrollBox(`table: ${title || page.title}`, table));
}
