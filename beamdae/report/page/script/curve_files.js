// Curves in script files beside the page, which are loaded when one of their cases is selected: a page that was
// opened from a folder may load scripts, but no data.

const curveFiles = new Map(); // loading, loaded, damaged or missing, by index of the file
const loadedIds = new Set(); // cases whose curves a file contained

function mayHaveCurves(run) {
  return Boolean(run.curves) || run.block !== undefined;
}

function loadCurves(run) {
  const { block } = run;
  if (run.curves || block === undefined || ["loading", "loaded"].includes(curveFiles.get(block))) return;
  curveFiles.set(block, "loading");
  const finish = (findResult) => () => {
    curveFiles.set(block, findResult());
    // The charts above the table may grow.
    keepInPlace(document.activeElement, showSelection);
  };
  // A script with a syntax error is loaded too.
  const load = finish(() => (loadedIds.has(run.id) ? "loaded" : "damaged"));
  const error = finish(() => "missing");
  document.head.append(html("script", { src: page.curve_files[block], load, error }));
}

// Called by the files.
function addCurves(text) {
  const curves = new Map(Object.entries(JSON.parse(text)));
  for (const run of page.cases) run.curves ??= curves.get(run.id) ?? null;
  for (const id of curves.keys()) loadedIds.add(id);
}

function isLoading({ block }) {
  return curveFiles.get(block) === "loading";
}

// Why the curves of a case have not been loaded, or undefined.
function describeCurveFile(run) {
  const { label, block } = run;
  if (isLoading(run)) return `Loading the curves of ${label} …`;
  if (!["damaged", "missing"].includes(curveFiles.get(block))) return undefined;
  const [folder, file] = page.curve_files[block].split("/").map(decodeURIComponent);
  if (curveFiles.get(block) === "damaged") {
    return `The curves of ${label} cannot be loaded: ${file} in ${folder} is damaged; create this page again.`;
  }
  return `The curves of ${label} cannot be loaded; keep the folder ${folder} with ${file} beside this page.`;
}
