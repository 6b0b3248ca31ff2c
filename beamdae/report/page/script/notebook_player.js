// Initialization of the animation in a notebook.

function startNotebookPlayer() {
  const { frames, caption, speed, colored } = parseData(byId("data").textContent);
  byId("caption").textContent = caption;
  if (!SPEEDS.includes(speed)) SPEEDS.push(speed);
  listenToPlayer();
  drawMotion(frames, colored ? frames.colors[0] : null);
  byId("speed").selectedIndex = SPEEDS.indexOf(speed);
  if (frames.t.length > 1) play();
  new ResizeObserver(fitIframe).observe(document.body);
}

// Notebooks that sandbox the frame deny access to it; the frame then keeps its initial height.
function fitIframe() {
  if (window.frameElement) window.frameElement.style.height = `${document.documentElement.offsetHeight}px`;
}

startNotebookPlayer();
