// Curves in script files beside the page, which are loaded when one of their cases is selected: a page that was
// opened from a folder may load scripts, but no data.

const curveFiles = new Map(); // "loading", "loaded" or "missing", by index of the file

function mayHaveCurves(run) {
  return Boolean(run.curves) || run.block !== undefined;
}

function loadCurves(run) {
  const { block } = run;
  if (run.curves || block === undefined || ["loading", "loaded"].includes(curveFiles.get(block))) return;
  curveFiles.set(block, "loading");
  const finish = (result) => () => {
    curveFiles.set(block, result);
    // The charts above the table may grow.
    keepInPlace(document.activeElement, showSelection);
  };
  const script = html("script", { src: page.curve_files[block], load: finish("loaded"), error: finish("missing") });
  document.head.append(script);
}

// Called by the files.
function addCurves(text) {
  const curves = new Map(Object.entries(JSON.parse(text)));
  for (const run of page.cases) run.curves ??= curves.get(run.id) ?? null;
}

function isLoading({ block }) {
  return curveFiles.get(block) === "loading";
}

// Why the curves of a case have not been loaded, or undefined.
function describeCurveFile(run) {
  const { label, block } = run;
  if (isLoading(run)) return `Loading the curves of ${label} …`;
  if (curveFiles.get(block) !== "missing") return undefined;
  const [folder, file] = page.curve_files[block].split("/").map(decodeURIComponent);
  return `The curves of ${label} cannot be loaded; keep the folder ${folder} with ${file} beside this page.`;
}
