// The page.

const page = unpackedPage(JSON.parse(byId("data").textContent));
const families = distinct(page.cases.map((one) => one.family));
const columns = tableColumns();
const quantities = allQuantities();
const state = {
  group: null,
  slots: [],
  order: null,
  // Of panels, by their keys: what they show, if its difference to the reference.
  names: {},
  differences: {},
  charts: new Map(),
  axes: {},
  views: {},
  hidden: { families: new Set(), cases: new Set(), names: {} },
};

function drawHeader() {
  byId("title").textContent = page.title;
  byId("subtitle").textContent = page.subtitle;
  byId("notes").replaceChildren(...page.notes.map((note) => html("li", {}, note)));
  byId("made").textContent = Object.entries(page.made)
    .map((entry) => entry.join(" "))
    .join(", ");
  byId("group").replaceChildren(...page.groups.map((group) => html("option", {}, group.label || group.id)));
  if (!scatters()) byId("selected-title").textContent = "Over time";
  byId("motion").hidden = !page.groups.some((group) => group.frames);
  document.querySelector("main").classList.toggle("still", byId("motion").hidden);
}

function drawReference() {
  const { reference } = state.group;
  byId("choice").hidden = page.groups.length < 2 && !reference;
  if (!reference) return byId("reference").replaceChildren();
  const verdict = reference.accepted ? [] : [html("span", { class: "alarm" }, "Reference not accepted. ")];
  const said = reference.sentence || (reference.methods ?? []).join(" and ");
  return byId("reference").replaceChildren(...verdict, said);
}

function showGroup(group) {
  state.group = group;
  for (const key of ["scatter", ...PANELS.map((panel) => panel.key)]) {
    state.views[key] = { x: null, y: null };
    state.hidden.names[key] = new Set();
  }
  drawReference();
  drawScatter();
  drawUnplotted();
  drawFacts();
  drawTable();
  drawMotion(state.group.frames);
  selectFirst();
  showSelection();
}

function listen() {
  byId("group").addEventListener("change", (event) => showGroup(page.groups[event.target.selectedIndex]));
  byId("filter").addEventListener("input", filterTable);
  byId("clear").addEventListener("click", clearSelection);
  listenToPlayer();
}

function start() {
  drawHeader();
  listen();
  if (page.cases.length) showGroup(page.groups[0]);
  else document.querySelector("main").replaceChildren(empty("This study has no cases."));
}

start();
