// The page.

const page = unpackedPage(JSON.parse(byId("data").textContent));
const families = distinct(page.cases.map((one) => one.family));
const columns = tableColumns();
const state = { group: null, slots: [], order: null, names: {} };

function drawHeader() {
  byId("title").textContent = page.title;
  byId("subtitle").textContent = page.subtitle;
  byId("notes").replaceChildren(...page.notes.map((note) => html("li", {}, note)));
  byId("made").textContent = Object.entries(page.made)
    .map((entry) => entry.join(" "))
    .join(", ");
  byId("group").replaceChildren(...page.groups.map((group) => html("option", {}, group.label || group.id)));
}

function drawReference() {
  const { reference } = state.group;
  if (!reference)
    return byId("reference").replaceChildren(
      html("span", { class: "alarm" }, "No reference: errors are not known."),
    );
  const verdict = reference.accepted ? [] : [html("span", { class: "alarm" }, "Reference not accepted. ")];
  const said = reference.sentence || (reference.methods ?? []).join(" and ");
  return byId("reference").replaceChildren(...verdict, said);
}

function showGroup(group) {
  state.group = group;
  drawReference();
  drawPrecision();
  drawUnplotted();
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
  if (page.groups.length) showGroup(page.groups[0]);
  else document.querySelector("main").replaceChildren(empty("This study has no cases."));
}

start();
