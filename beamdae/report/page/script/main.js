// State and initialization of the page.

const page = decodePage(JSON.parse(byId("data").textContent));
const families = removeDuplicates(page.cases.map((run) => run.family));
const columns = listTableColumns();
const quantities = listQuantities();
const state = {
  group: null,
  slots: [], // selected cases, see selection.js
  table: null, // listed cases, and rows and searchable texts by id of the case
  order: null, // sorting column and direction of the case table
  axes: {}, // keys of the quantities of the scatter plot
  choices: {}, // label of the selected choice, by panel
  differences: {}, // by panel, true to show the difference from the reference
  charts: new Map(), // by id
  views: {}, // visible ranges, by id of the chart
  hidden: { families: new Set(), cases: new Set(), names: {} },
};

function drawHeader() {
  byId("title").textContent = page.title;
  byId("subtitle").textContent = page.subtitle;
  byId("notes").replaceChildren(...page.notes.map((note) => html("li", {}, note)));
  byId("versions").textContent = Object.entries(page.made)
    .map((entry) => entry.join(" "))
    .join(", ");
  byId("group").replaceChildren(...page.groups.map((group) => html("option", {}, group.label || group.id)));
  if (!isStudyPage()) byId("selected-title").textContent = "Over time";
  byId("motion").hidden = !page.groups.some((group) => group.frames);
  document.querySelector("main").classList.toggle("without-motion", byId("motion").hidden);
}

function drawReference() {
  const { reference } = state.group;
  byId("choice").hidden = page.groups.length < 2 && !reference;
  const elements = [];
  if (reference) {
    if (!reference.accepted) elements.push(html("span", { class: "alarm" }, "Reference not accepted. "));
    elements.push(reference.sentence || (reference.methods ?? []).join(" and "));
  }
  byId("reference").replaceChildren(...elements);
}

function showGroup(group) {
  state.group = group;
  for (const key of ["scatter", ...PANELS.map((panel) => panel.key)]) {
    state.views[key] = { x: null, y: null };
    state.hidden.names[key] = new Set();
  }
  drawReference();
  drawScatter();
  listUnplottedCases();
  drawFactTables();
  drawCaseTable();
  drawMotion(state.group.frames);
  selectInitialCases();
  showSelection();
}

function startPage() {
  drawHeader();
  byId("group").addEventListener("change", (event) => showGroup(page.groups[event.target.selectedIndex]));
  byId("filter").addEventListener("input", listCases);
  listenToTable();
  byId("clear").addEventListener("click", clearSelection);
  listenToPlayer();
  if (page.cases.length) showGroup(page.groups[0]);
  else document.querySelector("main").replaceChildren(createPlaceholder("This study has no cases."));
}

startPage();
