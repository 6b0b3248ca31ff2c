// Player of the animation.

const timeAxis = { name: "t", unit: "s" };
const SPEEDS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10]; // relative to real time
const PATH_DURATION = 3; // of one playback of anything but time [s]
const PREFERRED_DURATION = 6; // desired duration of one playback at the initial speed [s]
const MAX_FRAME_DELAY = 100; // limits the time step after a pause of the browser, for example in a hidden tab [ms]
const motion = { frames: null, draw: null, time: 0, isPlaying: false, lastClock: 0, color: null, follow: null };

function drawMotion(frames, color = null) {
  pause();
  motion.frames = frames;
  const isStill = !frames || frames.t.length < 2;
  byId("player").hidden = isStill;
  if (!frames) {
    byId("stage").replaceChildren(createPlaceholder("No animation of this model."));
    byId("stage-legend").replaceChildren();
    return;
  }
  drawStage(color);
  byId("frame").max = frames.t.length - 1;
  if (!isStill) {
    const duration = frames.t.at(-1) - frames.t[0];
    const deviation = (speed) => Math.abs(Math.log(duration / speed / PREFERRED_DURATION));
    const [best] = [...SPEEDS].sort((a, b) => deviation(a) - deviation(b));
    byId("speed").selectedIndex = SPEEDS.indexOf(best);
  }
  showTime(frames.t[0]);
}

// Show other frames at the same time, for example of another case.
function replaceFrames(frames) {
  if (!motion.frames || !frames) {
    drawMotion(frames);
    return;
  }
  motion.frames = frames;
  drawStage(frames.colors.find(({ title }) => title === motion.color?.title) ?? null);
  byId("player").hidden = frames.t.length < 2;
  byId("frame").max = frames.t.length - 1;
  showTime(clamp(motion.time, frames.t[0], frames.t.at(-1)));
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
    html("div", { class: "controls" }, ...createColorSelect(frames.colors, color, select)),
    html("div", { class: "legend" }, ...createBodyLegend(frames)),
  );
}

function showTime(time) {
  const { t } = motion.frames;
  const next = t.findIndex((value) => value > time);
  const frame = next < 0 ? t.length - 1 : Math.max(next - 1, 0);
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

// Advance per second of playback; in PATH_DURATION seconds, a path or a period is shown once.
function playbackRate() {
  const { t } = motion.frames;
  return isTime() ? SPEEDS[byId("speed").selectedIndex] : (t.at(-1) - t[0]) / PATH_DURATION;
}

function advance(clock) {
  if (!motion.isPlaying) return;
  const { t } = motion.frames;
  const elapsed = Math.min(clock - motion.lastClock, MAX_FRAME_DELAY) / 1000;
  motion.lastClock = clock;
  const time = motion.time + elapsed * playbackRate();
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
