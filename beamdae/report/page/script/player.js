// Player of the animation.

const timeAxis = { name: "t", unit: "s" };
const SPEEDS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10]; // relative to real time
const PATH_DURATION = 3; // of one playback of anything but time [s]
const PREFERRED_DURATION = 6; // desired duration of one playback at the initial speed [s]
const MAX_FRAME_DELAY = 100; // limits the time step after a pause of the browser, for example in a hidden tab [ms]
const motion = { frames: null, draw: null, time: 0, isPlaying: false, lastClock: 0, color: null, follow: null };

// Show frames; those of another motion are shown at the same time and in the same color.
function drawMotion(frames, color = frames?.colors?.find(({ title }) => title === motion.color?.title)) {
  const isFirst = !motion.frames;
  if (isFirst || !frames) pause();
  motion.frames = frames;
  const isStill = !frames || frames.t.length < 2;
  byId("player").hidden = isStill;
  if (!frames) {
    byId("stage").replaceChildren(createPlaceholder("No animation of this model."));
    byId("stage-legend").replaceChildren();
    return;
  }
  drawStage(color ?? null);
  const { t } = frames;
  byId("frame").max = t.length - 1;
  if (isFirst && !isStill) {
    const deviation = (speed) => Math.abs(Math.log((t.at(-1) - t[0]) / speed / PREFERRED_DURATION));
    const [best] = [...SPEEDS].sort((a, b) => deviation(a) - deviation(b));
    byId("speed").selectedIndex = SPEEDS.indexOf(best);
  }
  showTime(isFirst ? t[0] : clamp(motion.time, t[0], t.at(-1)));
}

function drawStage(color) {
  const { frames } = motion;
  motion.color = color;
  const select = (other) => {
    drawStage(other);
    showTime(motion.time);
  };
  byId("stage").replaceChildren(createStage(frames, color));
  byId("stage-legend").replaceChildren(
    html("div", { class: "controls" }, ...createColorSelect(frames.colors ?? [], color, select)),
    html("div", { class: "legend" }, ...createBodyLegend(frames)),
  );
}

function showTime(time) {
  const { t } = motion.frames;
  const frame = Math.max(t.findLastIndex((value) => value <= time), 0);
  motion.time = time;
  motion.draw(frame);
  byId("frame").value = frame;
  byId("frame").setAttribute("aria-valuetext", formatTime(t[frame]));
  byId("time").value = formatTime(t[frame], 3);
  motion.follow?.(time);
}

// Time, or the quantity that takes its place, such as the load factor of an equilibrium path.
function formatTime(value, digits = 4) {
  const { name, unit } = timeAxis;
  return [name, "=", formatValue(value, digits), unit].filter(Boolean).join(" ");
}

function isTime() {
  return timeAxis.name === "t";
}

function advance(clock) {
  if (!motion.isPlaying) return;
  const { t } = motion.frames;
  const elapsed = Math.min(clock - motion.lastClock, MAX_FRAME_DELAY) / 1000;
  // In PATH_DURATION seconds, a path or a period is shown once.
  const rate = isTime() ? SPEEDS[byId("speed").selectedIndex] : (t.at(-1) - t[0]) / PATH_DURATION;
  const time = motion.time + elapsed * rate;
  motion.lastClock = clock;
  showTime(time > t.at(-1) ? t[0] : time);
  requestAnimationFrame(advance);
}

function play() {
  motion.isPlaying = true;
  motion.lastClock = performance.now();
  byId("play").textContent = "Pause";
  requestAnimationFrame(advance);
}

function pause() {
  motion.isPlaying = false;
  byId("play").textContent = "Play";
}

function listenToPlayer() {
  byId("speed").closest("label").hidden = !isTime();
  byId("speed").replaceChildren(...SPEEDS.map((speed) => html("option", {}, `× ${formatValue(speed, 3)}`)));
  byId("play").addEventListener("click", () => (motion.isPlaying ? pause() : play()));
  byId("frame").addEventListener("input", (event) => showTime(motion.frames.t[event.target.value]));
}
