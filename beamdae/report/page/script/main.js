// State and initialization of the page.

const page = decodePage(JSON.parse(byId("data").textContent));
Object.assign(timeAxis, page.time);
const families = removeDuplicates([...page.families, ...page.cases.map((run) => run.family)]);
const columns = listTableColumns();
const quantities = listQuantities();
const state = {
  group: null,
  slots: [], // selected cases, see selection.js
  sliderSlot: null, // slot of the case that was selected by the sliders
  position: page.sliders.map(() => 0), // of the sliders, as indices of values
  table: null, // listed cases, and rows and searchable texts by id of the case
  order: null, // sorting column and direction of the case table
  axes: {}, // keys of the quantities of the scatter plot
  mapped: null, // key of the quantity of the map
  plane: [], // values of the parameters outside the map, as indices
  choices: {}, // label of the selected choice, by panel
  differences: {}, // by panel, true to show the difference from the reference
  charts: new Map(), // by id
  views: {}, // visible ranges, by id of the chart and axis
  legends: {}, // entries that are shown, by id of the chart
};

function drawHeader() {
  byId("title").textContent = page.title;
  byId("subtitle").textContent = page.subtitle;
  byId("remarks").hidden = !page.notes.length;
  // Many notes would take the place of the motion on the first screen.
  byId("remarks").open = page.notes.length === 1 && !window.matchMedia("(max-width: 34rem)").matches;
  byId("remarks").firstElementChild.textContent = page.notes.length === 1 ? "1 note" : `${page.notes.length} notes`;
  byId("notes").replaceChildren(...page.notes.map((note) => html("li", {}, note)));
  byId("versions").textContent = Object.entries(page.made)
    .map((entry) => entry.join(" "))
    .join(", ");
  byId("group").replaceChildren(...page.groups.map((group) => html("option", {}, group.label || group.id)));
  if (!isStudyPage()) byId("selected-title").textContent = isTime() ? "Over time" : "Curves";
  else byId("selected-title").textContent = `Selected ${page.noun}`;
  byId("cases-title").textContent = `All ${page.noun}`;
  const isMoving = page.groups.some((group) => group.frames) || page.cases.some((run) => run.frames);
  byId("motion").hidden = !isMoving;
  document.querySelector("main").classList.toggle("without-motion", !isMoving);
  const hasCurves = page.cases.some(mayHaveCurves);
  byId("curves").hidden = (isMoving || isStudyPage()) && !hasCurves && !page.leads;
  document.querySelector("main").classList.toggle("without-curves", isMoving && byId("curves").hidden);
  byId("top").hidden = !isMoving && byId("curves").hidden;
  if (page.leads) byId("curves").prepend(byId("precision"));
}

function drawReference() {
  const { reference } = state.group;
  const isRejected = Boolean(reference) && !reference.accepted;
  byId("choice").hidden = page.groups.length < 2 && !isRejected;
  byId("rejection").textContent = isRejected ? "No errors are known: the reference was not accepted." : "";
  const elements = [];
  if (reference) {
    if (isRejected) elements.push(html("span", { class: "alarm" }, "Reference not accepted. "));
    elements.push(reference.sentence || (reference.methods ?? []).join(" and "));
  }
  byId("reference").replaceChildren(...elements.length ? [html("p", {}, ...elements)] : []);
}

function showGroup(group) {
  state.group = group;
  state.views = { ...page.views };
  drawReference();
  listUnplottedCases();
  drawFactTables();
  drawCaseTable();
  byId("shown").textContent = "";
  drawMotion(state.group.frames);
  selectInitialCases();
  drawSliders();
  showSelection();
  const [first] = selectedCases();
  if (first) showCase(first.run);
}

// Facts without cases, such as the poles of a system without inputs.
function showTables() {
  for (const id of ["choice", "top", "charts", "cases"]) byId(id).hidden = true;
  drawFactTables();
  byId("results").prepend(html("h2", {}, "Results"));
  hideEmptySections();
}

function startPage() {
  drawHeader();
  motion.follow = (time) => state.charts.forEach((chart) => markTime(chart, time));
  byId("group").addEventListener("change", (event) => showGroup(page.groups[event.target.selectedIndex]));
  byId("filter").addEventListener("input", listCases);
  listenToTable();
  window.addEventListener("beforeprint", preparePrint);
  window.addEventListener("afterprint", restoreScreen);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => showSelection());
  byId("clear").addEventListener("click", clearSelection);
  listenToPlayer();
  if (page.cases.length) showGroup(page.groups[0]);
  else if (page.tables.length) showTables();
  else document.querySelector("main").replaceChildren(createPlaceholder("This study has no cases."));
}

startPage();
