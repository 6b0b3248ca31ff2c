// Table of the cases of the group, which users sort by clicking on a column and filter by words.
// Rows are created when they are scrolled into view or printed: thousands of rows take seconds to open.

const ROWS_PER_STEP = 100;
const LONG_TEXT = 16; // texts with more characters have a column of a minimum width

function listTableColumns() {
  const label = page.columns.find(({ key }) => key === "label") ?? { label: "case", unit: "" };
  const status = page.columns.find(({ kind }) => kind === "status") ?? { label: "status", unit: "" };
  const hasStatus = page.columns.some(({ kind }) => kind === "status") || page.cases.some(hasFailed);
  const others = page.columns.filter((column) => column.key !== "label" && column.kind !== "status");
  return [
    { ...label, kind: "label", value: (run) => run.label, sortValue: (run) => run.rank ?? run.label },
    ...(hasStatus ? [{ ...status, kind: "status", value: (run) => run.status }] : []),
    ...others.map(addGetters),
  ];
}

// Columns about the solver are shown on request.
function shownColumns() {
  return columns.filter(({ section }) => section !== "solver" || byId("solver-columns").checked);
}

function drawCaseTable() {
  byId("cases").hidden = !isStudyPage();
  byId("solver-choice").hidden = !columns.some(({ section }) => section === "solver");
  state.texts = new Map(groupCases().map((run) => [run.id, columns.map((column) => formatCell(run, column)).join(" ").toLowerCase()]));
  listCases();
}

// Sort and filter the cases, and show the first rows.
function listCases() {
  const [head, body] = byId("table").children;
  const words = byId("filter").value.toLowerCase().split(/\s+/);
  const all = groupCases().sort(compareCases);
  state.listed = all.filter((run) => words.every((word) => state.texts.get(run.id).includes(word)));
  const headers = shownColumns().map((column) => {
    const unit = column.unit ? [html("span", { class: "unit" }, `[${column.unit}]`)] : [];
    const sort = () => {
      state.order = { column, isDescending: state.order?.column === column && !state.order.isDescending };
      listCases();
    };
    const direction = state.order?.isDescending ? "descending" : "ascending";
    const button = html("button", { type: "button", click: sort }, html("span", { class: "name" }, column.label), ...unit);
    return html("th", { class: column.kind, scope: "col", "aria-sort": state.order?.column === column ? direction : "none" }, button);
  });
  head.replaceChildren(html("tr", {}, html("th", { class: "pick" }, "selected"), ...headers));
  body.replaceChildren();
  showRows(ROWS_PER_STEP);
  byId("count").value = `${state.listed.length} of ${all.length} ${page.noun}`;
}

function showRows(count) {
  const body = byId("table").tBodies[0];
  body.append(...state.listed.slice(body.rows.length, body.rows.length + count).map(createRow));
  markSelection();
}

// Add rows before the end of the table is in view; all rows are added before the page is printed.
function listenToTable() {
  const scroll = byId("table").closest(".scroll");
  scroll.addEventListener("scroll", () => {
    if (scroll.scrollTop + 2 * scroll.clientHeight > scroll.scrollHeight) showRows(ROWS_PER_STEP);
  });
  byId("filter").addEventListener("input", listCases);
  byId("solver-columns").addEventListener("change", listCases);
}

function createRow(run) {
  const box = html("input", { type: "checkbox", "aria-label": `select ${run.label}`, change: () => toggleCase(run.id) });
  const cells = shownColumns().map((column) => {
    const alarm = column.kind === "status" && hasFailed(run) ? "alarm" : "";
    const icon = column.kind === "label" ? [createFamilyIcon(run.family)] : [];
    const text = formatCell(run, column);
    const long = column.kind === "text" && text.length > LONG_TEXT ? "long" : "";
    return html("td", { class: `${column.kind} ${alarm}${long}` }, ...icon, text);
  });
  const pick = html("td", { class: "pick" }, html("label", {}, box, " ", html("span", { class: "number badge" })));
  const select = (event) => event.target.closest(".pick") || toggleCase(run.id);
  return html("tr", { "data-case": run.id, click: select }, pick, ...cells);
}

function formatCell(run, column) {
  if (column.kind !== "error" || !run.below) return formatValue(column.value(run));
  return referenceResolution() ? `< ${formatValue(referenceResolution(), 2)}` : "not resolved";
}

// Failed cases are sorted last, preceded by cases without a value.
function compareCases(run, other) {
  const failures = hasFailed(run) - hasFailed(other);
  if (failures || !state.order) return failures;
  const { value, sortValue = value } = state.order.column;
  const [a, b] = [sortValue(run) ?? null, sortValue(other) ?? null];
  if (a === null || b === null) return (a === null) - (b === null);
  const areNumbers = typeof a === "number" && typeof b === "number";
  return (state.order.isDescending ? -1 : 1) * (areNumbers ? a - b : String(a).localeCompare(String(b), "en", { numeric: true }));
}

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
