// Tables of facts about a run, such as its cost, accuracy and provenance, in the sections of the page.

const MAX_NARROW_COLUMNS = 6; // of tables that are printed side by side
const MAX_PHONE_COLUMNS = 4; // rows of wider tables become blocks on a phone
const FACT_SECTIONS = { motion: "motion-facts", results: "result-facts", errors: "error-facts", solver: "solver-facts" };

function drawFactTables() {
  for (const [section, id] of Object.entries(FACT_SECTIONS)) {
    byId(id).replaceChildren(...page.tables.filter((table) => table.section === section).map(createFactTable));
  }
}

// Sections without content are hidden. Charts, tables and texts count, controls do not.
function hideEmptySections() {
  const hasContent = (id) => byId(id).children.length > 0;
  byId("errors").hidden = !["reference", "error-facts", "error-panels"].some(hasContent);
  byId("solver").hidden = !["solver-facts", "solver-panels"].some(hasContent);
  byId("results").hidden = !isStudyPage() && !hasContent("result-facts");
}

function createFactTable({ title, head, rows }) {
  const isNumber = (cell) => cell === "-" || Number.isFinite(Number(cell));
  const classes = head.map((_, k) => (k > 0 && rows.every((row) => isNumber(row[k])) ? "number" : ""));
  const headCells = head.map((name, k) => (name ? html("th", { scope: "col", class: classes[k] }, name) : html("td", {})));
  const bodyRows = rows.map(([name, ...values]) => {
    const cells = values.map((value, k) => html("td", { class: classes[k + 1] ?? "", "data-column": head[k + 1] ?? false }, formatValue(value)));
    return html("tr", {}, html("th", { scope: "row" }, name), ...cells);
  });
  const tableHead = head.length ? [html("thead", {}, html("tr", {}, ...headCells))] : [];
  const table = html("table", { class: head.length > MAX_PHONE_COLUMNS && "cards" }, ...tableHead, html("tbody", {}, ...bodyRows));
  const box = html("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `table: ${title || page.title}` }, table);
  const heading = title ? [html("h3", {}, title)] : [];
  return html("div", { class: head.length > MAX_NARROW_COLUMNS && "wide" }, ...heading, box);
}
