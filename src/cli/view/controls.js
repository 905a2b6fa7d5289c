// Pointer and keys: turn, pan, zoom, pick.
"use strict";

const CLICK_PIXELS = 4;

// One finger or the left button turns; two fingers, the right button or Shift pan; wheel and pinch zoom. `pick` gets
// the place of the pointer when it rests there, `mark` that of a click.
function addPointer(canvas, drawing, { pick, mark }) {
  const fingers = new Map();
  let start = null;
  let resting = 0;
  const middle = () => {
    const all = [...fingers.values()];
    const mean = (k) => all.reduce((s, p) => s + p[k], 0) / all.length;
    const spread = all.length > 1 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0;
    return { x: mean("x"), y: mean("y"), spread };
  };
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    canvas.focus({ preventScroll: true });
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    start = { ...middle(), moved: start?.moved ?? false, pan: e.button > 0 || e.shiftKey, from: [e.clientX, e.clientY] };
  });
  canvas.addEventListener("pointermove", (e) => {
    if (!fingers.has(e.pointerId)) {
      cancelAnimationFrame(resting);
      resting = requestAnimationFrame(() => pick(e.clientX, e.clientY));
      return;
    }
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    start.moved ||= Math.hypot(e.clientX - start.from[0], e.clientY - start.from[1]) > CLICK_PIXELS;
    if (!start.moved) return;
    const now = middle();
    const [dx, dy] = [now.x - start.x, now.y - start.y];
    if (start.pan || fingers.size > 1) drawing.camera.pan(dx, dy, canvas.clientHeight);
    else drawing.camera.orbit(dx, dy);
    if (start.spread && now.spread) drawing.camera.zoom(start.spread / now.spread);
    Object.assign(start, now);
    drawing.request();
  });
  const end = (e) => {
    if (!fingers.delete(e.pointerId)) return;
    if (fingers.size) Object.assign(start, middle());
    else {
      if (e.type === "pointerup" && !start.moved && e.button === 0) mark(e.clientX, e.clientY);
      start = null;
    }
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", () => { cancelAnimationFrame(resting); pick(-1, -1); });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    const pixels = e.deltaMode === 1 ? 30 * e.deltaY : e.deltaY;
    drawing.camera.zoom(Math.exp(0.0012 * Math.max(-400, Math.min(400, pixels))));
    drawing.request();
  }, { passive: false });
}

// Keys of the whole page; fields of text and lists keep theirs. `act` has what other keys do.
function addKeys(drawing, act) {
  window.addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    const { tagName, type } = e.target;
    if (tagName === "SELECT" || tagName === "INPUT" && !["checkbox", "radio", "button"].includes(type)) return;
    const step = 30;
    const camera = drawing.camera;
    const height = drawing.canvas.clientHeight;
    const arrows = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (arrows[e.key]) {
      if (type === "radio") return;
      if (e.shiftKey) camera.pan(...arrows[e.key], height);
      else camera.orbit(...arrows[e.key].map((d) => d / 2));
    } else if (e.key === "+" || e.key === "=") camera.zoom(1 / 1.15);
    else if (e.key === "-") camera.zoom(1.15);
    else if (act[e.key]) act[e.key]();
    else return;
    e.preventDefault();
    drawing.request();
  });
}
