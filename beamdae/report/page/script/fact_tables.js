// Tables of facts about a run, such as its cost, accuracy and provenance, in the sections of the page.

const MAX_NARROW_COLUMNS = 6; // of tables that are printed side by side
const MAX_PHONE_CHARACTERS = 34; // beside the first column; rows of wider tables become blocks on a phone
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

// Width of all columns but the first one, in characters, if the heads are wrapped.
function countCharacters(head, rows) {
  const widths = head.map((name, k) => {
    const words = name.split(" ").map((word) => word.length);
    return Math.max(...words, ...rows.map((row) => String(formatValue(row[k])).length));
  });
  return widths.slice(1).reduce((sum, width) => sum + width, 0);
}

function createFactTable({ title, head, rows }) {
  const isNumeric = (k) =>
    head.length > 0 && k > 0 && rows.every((row) => row[k] === "-" || Number.isFinite(Number(row[k])));
  const columnClass = (k) => (isNumeric(k) ? "number" : "");
  const bodyRows = rows.map(([name, ...values]) => {
    const cells = values.map((value, k) => {
      const attributes = { class: columnClass(k + 1), "data-column": head[k + 1] ?? false };
      return html("td", attributes, formatValue(value));
    });
    return html("tr", {}, html("th", { scope: "row" }, name), ...cells);
  });
  const headCells = head.map((name, k) =>
    name ? html("th", { scope: "col", class: columnClass(k) }, name) : html("td", {}),
  );
  const tableHead = head.length ? [html("thead", {}, html("tr", {}, ...headCells))] : [];
  const isCards = head.length > 2 && countCharacters(head, rows) > MAX_PHONE_CHARACTERS;
  const table = html("table", { class: isCards && "cards" }, ...tableHead, html("tbody", {}, ...bodyRows));
  const heading = title ? [html("h3", {}, title)] : [];
  const wide = head.length > MAX_NARROW_COLUMNS ? "wide" : "";
  return html("div", { class: `printed ${wide}` }, ...heading, createScrollBox(`table: ${title || page.title}`, table));
}
