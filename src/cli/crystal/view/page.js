// The page: requests to the server and their responses.
"use strict";

const drawing = new Drawing($("canvas"));
let words = { extrusions: [], schemes: [] };
// The extrusion that the sliders change, with the selection of its faces.
let pending = null;
let busy = false;

function say(text, wrong) {
  $("message").textContent = text;
  $("message").className = wrong ? "wrong" : "";
}

// Sends a request; returns the response, or shows the error.
async function ask(what, body) {
  try {
    const answer = await fetch(what, body === undefined ? {} : { method: "POST", body });
    if (answer.ok) return answer;
    say(await answer.text(), true);
  } catch {
    say("druse does not answer: it has ended", true);
  }
  return null;
}

// Requests a model and shows it; returns whether it arrived.
async function change(what, body, look) {
  if (busy) return false;
  busy = true;
  const answer = await ask(what, body);
  if (answer) {
    const model = unpack(await answer.arrayBuffer());
    const about = model.about;
    drawing.hovered = -1;
    drawing.chosen = 0;
    drawing.show(model, look);
    say(about.drawn ? about.notes.join("\n") : "more triangles than are drawn here");
    $("summary").textContent = about.summary;
    $("script").textContent = about.script;
    $("script").scrollTop = $("script").scrollHeight;
    $("undo").disabled = !about.undo;
    $("redo").disabled = !about.redo;
    $("under").textContent = "";
    listGroups(about.groups ?? []);
  }
  busy = false;
  return answer !== null;
}

function listGroups(groups) {
  const rows = groups.slice(0, 24).map(({ group, faces, color }) => {
    const row = document.createElement("tr");
    const cells = ["", `group ${group}`, `${faces} faces`].map((text) => {
      const cell = document.createElement("td");
      cell.textContent = text;
      return cell;
    });
    cells[0].style.background = `rgb(${color.map((c) => Math.round(255 * c)).join(" ")})`;
    row.append(...cells);
    row.onpointerenter = () => drawing.light(-1, group);
    row.onpointerleave = () => drawing.light(-1, 0);
    return row;
  });
  $("groups").replaceChildren(...rows);
}

const kind = () => words.extrusions.find((e) => e.name === $("kind").value);
const tiers = () => [...$("tiers").querySelectorAll("input")].map((i) => i.value);

// The step that the sliders describe, for these faces.
function extrusion(faces) {
  const angle = $("regular").checked ? "" : ` dihedral=${$("dihedral").value}`;
  const times = kind().iterates && $("iterations").value > 1 ? ` iterations=${$("iterations").value}` : "";
  return `extrude ${kind().name} ${faces}${angle} tiers=[${tiers().join(", ")}]${times}`;
}

function slider(label, value) {
  const line = document.createElement("label");
  line.className = "slider";
  line.innerHTML = '<span></span> <input type="range" min="-2" max="3" step="0.05"><output></output>';
  line.firstChild.textContent = label;
  line.querySelector("input").value = value;
  return line;
}

function kindChanged() {
  const count = kind().tiers;
  $("tiers").replaceChildren(...Array.from({ length: count }, (_, k) => slider(`tier ${k + 1}`, 1)));
  $("dihedral").value = kind().dihedral;
  $("iterations").disabled = !kind().iterates;
  showValues();
}

function showValues() {
  $("dihedral").disabled = $("regular").checked;
  $("dihedral-value").textContent = $("regular").checked ? `${kind().dihedral.toFixed(2)}°` : `${$("dihedral").value}°`;
  $("iterations-value").textContent = $("iterations").value;
  for (const line of $("tiers").children) {
    line.querySelector("output").textContent = Number(line.querySelector("input").value).toFixed(2);
  }
}

// Sliders change the last extrusion; the newest position wins.
let wanted = null;
async function again() {
  showValues();
  if (!pending || !$("live").checked) return;
  wanted = extrusion(pending);
  while (wanted && !busy) {
    const step = wanted;
    wanted = null;
    await change("again", step);
  }
}

async function extrude(face) {
  const group = drawing.model.groups[face];
  const faces = $("whole").checked ? `group=${group}` : `faces(index == ${face})`;
  if (await change("step", extrusion(faces))) pending = faces;
}

// After any other change the sliders no longer change the last extrusion.
function other(what, body, look) {
  pending = null;
  return change(what, body, look);
}

// The pointer: a click extrudes a face, at rest it highlights one.
function pick(x, y) {
  const face = x < 0 ? -1 : drawing.under(x, y);
  drawing.light(face, face >= 0 && $("whole").checked ? drawing.model.groups[face] : 0);
  const about = (f) => `face ${f}, group ${drawing.model.groups[f]}, ${drawing.model.about.sides[f]} corners`;
  $("under").textContent = face < 0 ? "" : about(face);
}

function extrudeUnder(x, y) {
  const face = drawing.under(x, y);
  if (face >= 0) extrude(face);
}

const savePicture = async () => download(await drawing.picture(), `${$("name").value.replace(/\.[^.]*$/, "")}.png`);
const views = addViews(drawing, () => drawing.home());
addPointer($("canvas"), drawing, { pick, mark: extrudeUnder });
addKeys(drawing, { ...views, p: savePicture, e: () => toggle("edges"), d: () => toggle("dark"), u: () => other("undo", "") });
drawing.onDraw = () => drawTriad(drawing.camera);
$("picture").onclick = savePicture;
$("edges").onchange = (e) => { drawing.state.edges = e.target.checked; drawing.request(); };
$("dark").onchange = (e) => setTheme(drawing, e.target.checked);
setTheme(drawing, matchMedia("(prefers-color-scheme: dark)").matches);

$("kind").onchange = () => { kindChanged(); again(); };
for (const id of ["regular", "dihedral", "iterations"]) $(id).oninput = again;
$("tiers").oninput = again;
$("remesh").onclick = () => other("step", `remesh ${$("scheme").value}`);
$("undo").onclick = () => other("undo", "");
$("redo").onclick = () => other("redo", "");
$("any").onsubmit = (e) => { e.preventDefault(); other("step", $("step").value, true); };
$("keep").onsubmit = async (e) => {
  e.preventDefault();
  const answer = await ask("save", $("name").value);
  if (answer) {
    const { path, bytes } = await answer.json();
    say(`${path}  ${bytes} bytes`);
  }
};
window.addEventListener("keydown", (e) => {
  if (!(e.ctrlKey || e.metaKey) || e.target.tagName === "INPUT" && e.target.type === "text") return;
  const what = e.key === "z" && !e.shiftKey ? "undo" : e.key === "y" || e.key === "z" || e.key === "Z" ? "redo" : null;
  if (what) {
    e.preventDefault();
    other(what, "");
  }
});
window.addEventListener("resize", () => { drawing.camera.refit(drawing.wide()); drawing.request(); });

const options = (list) => list.map((name) => new Option(name.replaceAll("_", " "), name));
ask("words").then(async (answer) => {
  if (!answer) return;
  words = await answer.json();
  $("kind").replaceChildren(...options(words.extrusions.map((e) => e.name)));
  $("kind").value = "cubical";
  $("scheme").replaceChildren(...options(words.schemes));
  kindChanged();
  await change("model", undefined, true);
});
