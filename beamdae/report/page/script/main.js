// State and initialization of the page.

const page = parseData(byId("data").textContent);
Object.assign(timeAxis, page.time);
const families = removeDuplicates([...page.families, ...page.cases.map((run) => run.family)]);
const columns = listTableColumns();
const quantities = listQuantities();
const state = {
  group: null,
  slots: [], // selected cases, see cases.js
  sliderSlot: null, // slot of the case that was selected by the sliders
  position: page.sliders.map(() => 0), // of the sliders, as indices of values
  listed: [], // cases of the table
  texts: null, // searchable texts by id of the case
  order: null, // sorting column and direction of the case table
  axes: {}, // keys of the quantities of the scatter plot
  choices: { portrait: page.portrait?.y, over: page.portrait?.x }, // label of the selected choice, by panel
  charts: new Map(), // by id
};

function drawHeader() {
  byId("title").textContent = page.title;
  byId("subtitle").textContent = page.subtitle;
  byId("remarks").hidden = !page.notes.length;
  // Many notes would take the place of the motion on the first screen.
  byId("remarks").open = page.notes.length === 1 && !window.matchMedia("(max-width: 34rem)").matches;
  byId("remarks").firstElementChild.textContent = page.notes.length === 1 ? "1 note" : `${page.notes.length} notes`;
  byId("notes").replaceChildren(...page.notes.map((note) => html("li", {}, note)));
  byId("versions").textContent = Object.entries(page.made).map((entry) => entry.join(" ")).join(", ");
  byId("group").replaceChildren(...page.groups.map((group) => html("option", {}, group.label || group.id)));
  const title = isTime() ? "Over time" : "Curves";
  byId("selected-title").textContent = isStudyPage() ? `Selected ${page.noun}` : title;
  byId("cases-title").textContent = `All ${page.noun}`;
  const isMoving = page.groups.some((group) => group.frames) || page.cases.some((run) => run.frames);
  byId("motion").hidden = !isMoving;
  document.querySelector("main").classList.toggle("without-motion", !isMoving);
  byId("curves").hidden = (isMoving || isStudyPage()) && !page.cases.some((run) => run.curves) && !page.leads;
  document.querySelector("main").classList.toggle("without-curves", isMoving && byId("curves").hidden);
  byId("top").hidden = !isMoving && byId("curves").hidden;
  if (page.leads) byId("curves").prepend(byId("precision"));
}

function drawReference() {
  const { reference } = state.group;
  const isRejected = Boolean(reference) && !reference.accepted;
  byId("choice").hidden = page.groups.length < 2 && !isRejected;
  byId("rejection").textContent = isRejected ? "No errors are known: the reference was not accepted." : "";
  const alarm = isRejected ? [html("span", { class: "alarm" }, "Reference not accepted. ")] : [];
  byId("reference").replaceChildren(...(reference ? [html("p", {}, ...alarm, reference.sentence)] : []));
}

function showGroup(group) {
  state.group = group;
  [...state.charts.keys()].forEach(removeChart);
  drawReference();
  listUnplottedCases();
  drawFactTables();
  drawCaseTable();
  byId("shown").textContent = "";
  motion.frames = null;
  drawMotion(group.frames);
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
