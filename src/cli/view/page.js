// The page: its controls, what they show, and the link that restores them.
"use strict";

let scene = null;
const numberText = (v) => Number.isFinite(v) ? String(+v.toPrecision(4)) : "none";
const withUnit = (text, unit) => unit ? `${text} ${unit}` : text;
let drawing = null;
let bodies = [];
let axis = "x";
let side = 1;
let mark = null;
// What a live page adds: keys, parts of the link, and what follows a moved cut.
const moreKeys = {};
let moreLink = () => {};
let onCut = () => {};
// Whether a scene without a link opens with a cut.
let opensCut = false;

function fail(message) {
  $("wait").textContent = message;
  $("wait").className = "wrong";
}

// Colours of a category: hues. Its key and that of the components list agree.
function listKeys(field) {
  const rows = (field?.labels ?? []).slice(0, 60).map((label, n) => {
    const row = document.createElement("span");
    const patch = document.createElement("i");
    patch.style.background = hueColor(n);
    row.append(patch, label);
    return row;
  });
  $("keys").replaceChildren(...rows);
}

function colorBy(n) {
  const field = drawing.body.fields[n];
  const isNumber = Boolean(field) && !field.labels;
  $("field").value = n;
  for (const id of ["legend", "limits", "mark-line"]) $(id).hidden = !isNumber;
  listKeys(field);
  drawing.color(n);
  if (isNumber) {
    setRange(...usualRange(field));
    $("mark").value = "";
    setMark();
    $("legend-name").textContent = withUnit(field.name, field.unit && `(${field.unit})`);
    const stops = Array.from({ length: 13 }, (_, k) => rampColor(k / 12));
    $("legend-bar").style.background = `linear-gradient(to right, ${stops.join(", ")})`;
  }
}

// The range of a field without its most extreme hundredths.
function usualRange({ values, low, high, atParts }) {
  const sorted = values.filter((v) => !Number.isNaN(v)).sort();
  if (atParts || sorted.length < 1000) return [low, high];
  const [from, to] = [0.01, 0.99].map((share) => sorted[Math.floor(share * (sorted.length - 1))]);
  return from < to ? [from, to] : [low, high];
}

function setRange(low, high) {
  drawing.state.range = [low, high];
  [$("low").value, $("high").value] = [numberText(low), numberText(high)];
  [$("legend-low").textContent, $("legend-high").textContent] = [numberText(low), numberText(high)];
  drawing.request();
}

function readRange() {
  const [low, high] = [$("low"), $("high")].map((i) => parseFloat(i.value));
  if (low < high) setRange(low, high);
  else setRange(...drawing.state.range);
  keepLink();
}

// A third of the area of the triangles around each vertex.
function areas(body) {
  if (body.areas) return body.areas;
  const { positions: p, triangles: t, size } = body;
  body.areas = new Float32Array(body.vertices);
  const side = (a, b) => size.map((s, k) => (p[3 * b + k] - p[3 * a + k]) * s);
  for (let k = 0; k < t.length; k += 3) {
    const area = Math.hypot(...cross(side(t[k], t[k + 1]), side(t[k], t[k + 2])));
    for (let n = 0; n < 3; n++) body.areas[t[k + n]] += area;
  }
  return body.areas;
}

// The share of the measured surface with values below a limit.
function shareBelow(body, { values, atParts }, limit) {
  const weights = areas(body);
  let [below, all] = [0, 0];
  for (let v = 0; v < body.vertices; v++) {
    const value = values[atParts ? body.part[v] : v];
    if (Number.isNaN(value)) continue;
    all += weights[v];
    if (value < limit) below += weights[v];
  }
  return below / all;
}

// Marks values below a number.
function setMark() {
  const limit = parseFloat($("mark").value);
  drawing.state.mark = Number.isFinite(limit) ? limit : NO_NUMBER;
  const field = drawing.body.fields[drawing.state.field];
  const share = field && Number.isFinite(limit) ? shareBelow(drawing.body, field, limit) : NaN;
  $("mark-share").textContent = Number.isNaN(share) ? "" : `${(100 * share).toFixed(1)} % of the surface`;
  drawing.request();
}

const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };

// The text of a length; rounding around zero is not shown.
function lengthText(v) {
  return numberText(Math.abs(v) < 1e-6 * drawing.camera.size ? 0 : v);
}

// Cuts across a direction; the half towards the eye goes unless `kept` gives the side.
function setAxis(name, kept) {
  side = kept ?? (name === "view" || dot(drawing.camera.axes().back, AXES[name]) >= 0 ? 1 : -1);
  axis = name;
  const radio = document.querySelector(`input[name=axis][value=${name}]`);
  if (radio) radio.checked = true;
  const normal = name === "view" ? drawing.camera.axes().back : AXES[name];
  drawing.state.normal = normal.map((c) => side * c);
  setCut();
}

function setCut() {
  const [low, high] = drawing.cutRange();
  const share = $("at").value / 1000;
  // The slider goes along the axis, whichever side is kept.
  drawing.state.at = side > 0 ? low + share * (high - low) : high - share * (high - low);
  drawing.state.cut = $("cut").checked;
  const place = lengthText(side * drawing.state.at);
  $("at-value").textContent = withUnit(axis === "view" ? place : `${axis} = ${place}`, scene.unit);
  $("at").setAttribute("aria-valuetext", $("at-value").textContent);
  drawing.request();
  onCut();
}

function flip() {
  setAxis(axis, -side);
}

function move(by) {
  if (!$("cut").checked) toggle("cut");
  $("at").value = +$("at").value + by;
  setCut();
}

function choose(part) {
  drawing.state.chosen = drawing.state.chosen === part ? -1 : part;
  [...$("parts").children].forEach((row, n) => row.classList.toggle("chosen", n === drawing.state.chosen));
  drawing.request();
}

function listParts(body) {
  $("parts-box").hidden = body.elements || body.numbers.length > 0 || body.parts < 2;
  const cavities = body.rows.filter((r) => r.cavity).length;
  const count = (n, one, more) => `${n} ${n === 1 ? one : more}`;
  const solids = body.parts - cavities;
  $("parts-title").textContent = count(solids, "component", "components") + (cavities ? `, ${count(cavities, "cavity", "cavities")}` : "");
  const rows = body.rows.map((row, n) => {
    const line = document.createElement("div");
    const shown = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
    shown.setAttribute("aria-label", `show component ${n + 1}`);
    shown.onchange = () => drawing.toggle(n, shown.checked);
    const patch = document.createElement("i");
    patch.style.background = hueColor(n);
    const name = document.createElement("button");
    const volume = row.volume === null ? `${row.triangles} triangles` : withUnit(numberText(row.volume), scene.unit && `${scene.unit}³`);
    name.textContent = `${row.cavity ? "cavity" : "component"} ${n + 1}: ${volume}`;
    name.title = "Highlight";
    name.onclick = () => choose(n);
    line.append(shown, patch, name);
    return line;
  });
  $("parts").replaceChildren(...rows);
}

function show(n) {
  const body = bodies[n];
  drawing.show(body);
  describeBody(body);
  colorBy(body.elements || body.numbers.length ? 0 : -1);
  drawing.state.edges = $("edges").checked = body.lines.length > 0;
  setAxis(axis);
}

// Shows another state of the same part: camera, cut, colour and edges stay.
function refresh(old) {
  const body = bodies[Math.max(0, bodies.findIndex((b) => b.name === old.name))];
  const field = old.fields[drawing.state.field];
  const [low, high, limit] = [$("low"), $("high"), $("mark")].map((i) => i.value);
  const isUsual = field && !field.labels && usualRange(field).every((v, k) => numberText(v) === [low, high][k]);
  drawing.show(body, true);
  describeBody(body);
  // The scaffold that stands for the part at first has edges of its own.
  if (old.elements !== body.elements) drawing.state.edges = $("edges").checked = body.lines.length > 0;
  const n = field ? body.fields.findIndex((f) => f.name === field.name) : -1;
  const lost = field && n < 0 ? field.name : null;
  lostField = lost ?? (field || !lostField ? null : lostField);
  const back = lostField ? body.fields.findIndex((f) => f.name === lostField) : -1;
  if (back >= 0) lostField = null;
  colorBy(Math.max(n, back));
  if (n >= 0 && !field.labels) {
    if (!isUsual) setRange(parseFloat(low), parseFloat(high));
    $("mark").value = limit;
    setMark();
  }
  setAxis(axis, side);
}

// The colour that returns with its field: coarse results have no wall thickness.
let lostField = null;

function describeBody(body) {
  const size = body.size.map(numberText).join(" × ");
  $("kind").textContent = `${scene.kind}, ${withUnit(size, scene.unit)}`;
  const options = body.fields.map((f, k) => new Option(f.name, k));
  $("field").replaceChildren(new Option("nothing", -1), ...options);
  $("shrink-line").hidden = !body.elements;
  drawing.state.chosen = -1;
  listParts(body);
}

// The place, value and part under the pointer as text.
function about(found) {
  const { body, state } = drawing;
  const place = withUnit(`(${found.point.map(lengthText).join(", ")})`, scene.unit);
  if (found.cap) return `${place}\nin the part, on the cut`;
  const lines = [place];
  const field = body.fields[state.field];
  if (field?.labels) lines.push(`${field.name}: ${field.labels[Math.round(found.value)] ?? "none"}`);
  else if (field) lines.push(`${field.name}: ${withUnit(numberText(found.value), field.unit)}`);
  if (body.numbers.length) lines.push(`element ${body.numbers[found.part]}`);
  else if (body.parts > 1 && field?.name !== "component") lines.push(`${body.rows[found.part]?.cavity ? "cavity" : "component"} ${found.part + 1}`);
  return lines.join("\n");
}

function pick(x, y) {
  const found = x < 0 ? null : drawing.under(x, y);
  let text = found ? about(found) : "";
  if (found && mark) {
    const distance = Math.hypot(...found.point.map((c, k) => c - mark[k]));
    text += `\n${withUnit(numberText(distance), scene.unit)} from the mark`;
  }
  $("under").textContent = text;
}

function setMeasure(x, y) {
  const found = drawing.under(x, y);
  mark = mark || !found ? null : found.point;
  pick(x, y);
}

async function savePicture() {
  download(await drawing.picture(), `${scene.title.replace(/\.[^.]*$/, "")}.png`);
}

// The link restores camera, cut and colour.
let kept = 0;
function keepLink() {
  clearTimeout(kept);
  kept = setTimeout(() => {
    if (!drawing) return;
    const { state, camera } = drawing;
    const link = new URLSearchParams({ camera: camera.text(), body: bodies.indexOf(drawing.body), color: state.field });
    if (state.cut) link.set("cut", [axis, side, $("at").value].join(","));
    moreLink(link);
    try { history.replaceState(null, "", `#${link}`); } catch { /* some browsers refuse it for files */ }
  }, 300);
}

function restore() {
  const link = new URLSearchParams(location.hash.slice(1));
  const n = Number(link.get("body"));
  if (n > 0 && n < bodies.length) {
    $("bodies").querySelectorAll("input")[n].checked = true;
    show(n);
  }
  if (link.has("color") && drawing.body.fields[link.get("color")]) colorBy(Number(link.get("color")));
  const [name, sign, at] = (link.get("cut") ?? "").split(",");
  if (link.has("camera")) drawing.camera.restore(link.get("camera"));
  if (AXES[name] || name === "view") {
    $("at").value = at;
    $("cut").checked = true;
    setAxis(name, Number(sign) < 0 ? -1 : 1);
  }
}

function connect() {
  const on = (id, event, act) => $(id).addEventListener(event, act);
  const views = addViews(drawing, () => drawing.camera.reset(drawing.wide()));
  on("picture", "click", savePicture);
  on("field", "change", (e) => { colorBy(Number(e.target.value)); keepLink(); });
  for (const id of ["low", "high"]) on(id, "change", readRange);
  on("whole-range", "click", () => { const f = drawing.body.fields[drawing.state.field]; setRange(f.low, f.high); });
  on("mark", "input", setMark);
  on("cut", "change", () => setAxis(axis));
  on("at", "input", () => {
    if ($("cut").checked) setCut();
    else toggle("cut");
  });
  on("flip", "click", flip);
  document.querySelectorAll("input[name=axis]").forEach((r) => r.addEventListener("change", () => { $("cut").checked = true; setAxis(r.value); }));
  on("shrink", "input", (e) => { drawing.state.shrink = e.target.value / 100; $("shrink-value").textContent = `${e.target.value} %`; drawing.request(); });
  on("edges", "change", (e) => { drawing.state.edges = e.target.checked; drawing.request(); });
  on("box", "change", (e) => { drawing.state.box = e.target.checked; drawing.request(); });
  on("dark", "change", (e) => setTheme(drawing, e.target.checked));
  addPointer($("canvas"), drawing, { pick, mark: setMeasure });
  const cutAlong = (name) => () => { $("cut").checked = true; setAxis(name); };
  addKeys(drawing, {
    ...views, p: savePicture, f: flip, "[": () => move(-25), "]": () => move(25), x: cutAlong("x"), y: cutAlong("y"),
    z: cutAlong("z"), ...moreKeys, c: () => toggle("cut"), e: () => toggle("edges"), b: () => toggle("box"), d: () => toggle("dark"),
  });
  window.addEventListener("resize", () => { drawing.camera.refit(drawing.wide()); drawing.request(); });
  drawing.onDraw = () => { drawTriad(drawing.camera); keepLink(); };
}

function describe() {
  $("title").textContent = scene.title;
  const facts = scene.facts.flatMap(([name, text]) => {
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    [dt.textContent, dd.textContent] = [name, text];
    return [dt, dd];
  });
  $("facts").replaceChildren(...facts);
  $("notes").replaceChildren(...scene.notes.map((note) => Object.assign(document.createElement("li"), { textContent: note })));
  const count = scene.bodies.reduce((sum, b) => sum + b.triangles, 0);
  $("about").textContent = `${count.toLocaleString("en")} triangles · druse ${scene.version}, MIT or Apache-2.0 · nothing is loaded from a network`;
  $("body-box").hidden = bodies.length < 2;
  const rows = bodies.flatMap((body, n) => {
    const label = document.createElement("label");
    const isShown = drawing.body ? drawing.body.name === body.name : n === 0;
    const radio = Object.assign(document.createElement("input"), { type: "radio", name: "body", checked: isShown });
    radio.onchange = () => show(n);
    label.append(radio, ` ${body.name}`);
    return [label, document.createElement("br")];
  });
  $("bodies").replaceChildren(...rows);
}

// Shows a scene: a description and compressed numbers. A later one keeps what the user has chosen.
async function showScene(about, packed) {
  if (typeof DecompressionStream === "undefined") throw new Error("this browser is too old; expected Chrome or Edge 80, Firefox 113, Safari 16.4, or newer");
  const fresh = await decode(about, packed);
  const old = drawing?.body;
  [scene, bodies] = [about, fresh];
  if (!drawing) {
    drawing = new Drawing($("canvas"));
    connect();
    setTheme(drawing, matchMedia("(prefers-color-scheme: dark)").matches);
  }
  describe();
  if (old) {
    refresh(old);
    return;
  }
  show(0);
  if (opensCut && !location.hash) {
    // Across the axis that faces the eye most, so that the inside is seen.
    const facing = (name) => Math.abs(dot(drawing.camera.axes().back, AXES[name]));
    $("cut").checked = true;
    setAxis(Object.keys(AXES).reduce((a, b) => facing(b) > facing(a) ? b : a));
  }
  restore();
  $("wait").hidden = true;
  document.documentElement.dataset.ready = "yes";
}
