// What the points of cases do not show: those that failed, and those without numbers.

function drawUnplotted() {
  const axes = chosenAxes();
  const drawn = (one) => axes.every((axis) => axis && plottable(one, axis));
  const broken = scatters() ? casesHere().filter(failed) : [];
  const unmeasured = scatters() ? casesHere().filter((one) => !failed(one) && !drawn(one)).length : 0;
  const parts = [];
  if (broken.length)
    parts.push(
      html("strong", {}, `Failed, not drawn: ${broken.length}`),
      html("ul", {}, ...broken.map(failure)),
    );
  if (unmeasured)
    parts.push(html("p", { class: "quiet" }, `Without ${withoutWhat(axes)}, not drawn: ${unmeasured}`));
  byId("unplotted").replaceChildren(...parts);
}

function withoutWhat([x, y]) {
  return x && y ? `${y.label} or ${x.label}` : "an error or a wall time";
}

function failure(one) {
  const button = html(
    "button",
    { type: "button", click: () => toggle(one.id) },
    familySign(one.family),
    " ",
    one.label,
  );
  const tag = one.limited ? [html("span", { class: "tag" }, "limited"), " "] : [];
  return html("li", {}, button, " ", ...tag, one.status);
}
