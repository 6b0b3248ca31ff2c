// Curves in script files beside the page, which are loaded when one of their cases is selected: a page that was
// opened from a folder may load scripts, but no data.

const curveFiles = new Map(); // "loading" or "failed", by index of the file

function mayHaveCurves(run) {
  return Boolean(run.curves) || run.block !== undefined;
}

function loadCurves(run) {
  const { block } = run;
  if (run.curves || block === undefined || curveFiles.get(block) === "loading") return;
  curveFiles.set(block, "loading");
  const finish = () => {
    if (run.curves) curveFiles.delete(block);
    else curveFiles.set(block, "failed");
    // The charts above the table may grow.
    keepInPlace(document.activeElement, showSelection);
  };
  document.head.append(html("script", { src: page.curve_files[block], load: finish, error: finish }));
}

// Called by the files.
function addCurves(text) {
  const curves = new Map(Object.entries(JSON.parse(text)));
  for (const run of page.cases) run.curves ??= curves.get(run.id) ?? null;
}

// Why the curves of a case have not been loaded, or undefined.
function describeCurveFile({ label, block }) {
  if (!curveFiles.has(block)) return undefined;
  if (curveFiles.get(block) === "loading") return `Loading the curves of ${label} …`;
  const [folder, file] = page.curve_files[block].split("/").map(decodeURIComponent);
  return `The curves of ${label} cannot be loaded; keep the folder ${folder} with ${file} beside this page.`;
}
