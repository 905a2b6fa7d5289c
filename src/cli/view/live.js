
// The live page: requests to its server, the state of the work, and what the controls do.

let parameters = null;
let slice = null;
let shownNumber = 0;
let isFetching = false;
let timer = 0;

// Sends a request; returns the response, or shows the error.
async function ask(what, body) {
  try {
    const answer = await fetch(what, body === undefined ? {} : { method: "POST", body });
    if (answer.ok) return answer;
    showError([{ text: await answer.text(), wrong: true }]);
  } catch {
    fail("druse does not answer: it has ended");
    $("wait").hidden = false;
  }
  return null;
}

// The description at the head of a binary answer, and where the rest begins.
function readHead(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { about, offset: 4 + length };
}

function showError(messages) {
  $("error").hidden = messages.length === 0;
  $("error").textContent = messages.map((m) => m.text).join("\n");
  $("error").classList.toggle("wrong", messages.some((m) => m.wrong));
}

const seconds = (s) => s < 90 ? `${numberText(+s.toPrecision(2))} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`;
const bytesText = (n) => n < 1048576 ? `${Math.ceil(n / 1024)} KB` : n < 1073741824 ? `${(n / 1048576).toFixed(0)} MB` : `${(n / 1073741824).toFixed(1)} GB`;
const count = (n) => Math.round(n).toLocaleString("en");

function stageText({ name, share }) {
  return share === null ? name : `${name} ${Math.round(100 * share)} %`;
}

function showState(state) {
  const { result, stage, busy, estimate, full } = state;
  const done = result?.step ? `step ${result.step} of ${result.steps}` : result?.shows ?? "";
  const voxels = result?.voxelSize ? `voxels of ${withUnit(numberText(result.voxelSize), result.unit)}, ${count(result.activeVoxels)} active` : "";
  $("status").textContent = [voxels || done, busy ? stageText(stage) : ""].filter(Boolean).join(" · ") || "nothing is computed";
  $("progress").hidden = !busy;
  if (busy && stage.share !== null) $("progress").value = stage.share;
  else $("progress").removeAttribute("value");
  $("cancel").disabled = !busy;
  $("estimate").textContent = estimate
    ? `full run: ${count(estimate.active_voxels)} voxels, ${bytesText(estimate.peak_memory_bytes)} of memory, ${bytesText(estimate.disk_bytes)} of files, about ${seconds(estimate.seconds)}`
    : "";
  const messages = (state.warnings ?? []).map((w) => ({ key: w.key, text: `${w.code}: ${w.message}` }));
  if (state.error) messages.push({ key: state.error.key, text: [state.error.message, state.error.hint].filter(Boolean).join("; "), wrong: true });
  showError(parameters ? parameters.place(messages) : messages);
  if (full) showFull(full, state.fullStage);
  $("slice-line").hidden = !state.slices;
  document.documentElement.dataset.busy = busy ? "yes" : "no";
}

function showFull(full, stage) {
  $("run").disabled = full.running;
  $("stop").hidden = $("full-progress").hidden = !full.running;
  if (stage.share === null) $("full-progress").removeAttribute("value");
  else $("full-progress").value = stage.share;
  const warnings = (full.warnings ?? []).map((w) => `${w.code}: ${w.message}`);
  const lines = full.running ? [stageText(stage)] : full.cancelled ? ["stopped; no file was changed"]
    : full.error ? [full.error.message] : [...(full.files ?? []).map((f) => `${f.path}  ${f.size}`), ...(full.requirements ?? []), ...warnings];
  $("full").textContent = lines.join("\n");
}

// Fetches a new result and shows it.
async function fetchScene(number) {
  isFetching = true;
  const answer = await ask("scene");
  if (answer) {
    const buffer = await answer.arrayBuffer();
    const { about, offset } = readHead(buffer);
    await showScene(about, new Uint8Array(buffer, offset));
    shownNumber = number;
    document.documentElement.dataset.scene = number;
    slice.update();
  }
  isFetching = false;
}

async function poll() {
  clearTimeout(timer);
  const answer = await ask("state");
  if (!answer) return;
  const state = await answer.json();
  showState(state);
  if (state.number > shownNumber && !isFetching) await fetchScene(state.number);
  clearTimeout(timer);
  timer = setTimeout(poll, state.busy || state.full?.running ? 80 : 2000);
}

// Sends changed values; the newest ones win.
let wanted = null;
let isSending = false;
async function send(text) {
  wanted = text;
  keepLink();
  if (isSending) return;
  isSending = true;
  while (wanted !== null) {
    const body = wanted;
    wanted = null;
    const answer = await ask("set", body);
    if (answer) showState(await answer.json());
  }
  isSending = false;
  poll();
}

async function addControls() {
  const answer = await ask("controls");
  if (!answer) return;
  const about = await answer.json();
  parameters = new Parameters(about, $("parameters"), send);
  opensCut = about.cut;
  for (const id of ["changes", "parameters", "recipe-box"]) $(id).hidden = false;
  $("name").value = about.name.replace(/\.toml$/, "_2.toml");
  const link = new URLSearchParams(location.hash.slice(1)).get("set");
  try {
    if (link) parameters.load(link);
  } catch { /* the link is not from this page */ }
  parameters.show();
}

function connectLive() {
  const on = (id, event, act) => $(id).addEventListener(event, act);
  on("undo", "click", () => parameters.undo());
  on("redo", "click", () => parameters.redo());
  on("reset", "click", () => parameters.reset());
  on("cancel", "click", async () => { await ask("cancel", ""); poll(); });
  on("run", "click", async () => { if (await ask("run", "")) poll(); });
  on("stop", "click", async () => { await ask("stop", ""); poll(); });
  on("save", "submit", async (e) => {
    e.preventDefault();
    const answer = await ask("save", $("name").value);
    if (answer) $("full").textContent = `saved ${(await answer.json()).path}`;
  });
  on("download", "click", async () => {
    const answer = await ask("recipe");
    if (answer) download(new Blob([await answer.text()], { type: "application/toml" }), $("name").value);
  });
  on("sliced", "change", (e) => slice.toggle(e.target.checked));
  window.addEventListener("keydown", (e) => {
    if (!(e.ctrlKey || e.metaKey) || !parameters) return;
    const act = e.key === "z" && !e.shiftKey ? "undo" : e.key === "y" || e.key.toLowerCase() === "z" ? "redo" : null;
    if (!act) return;
    e.preventDefault();
    document.activeElement?.blur?.();
    parameters[act]();
  });
}

async function startLive() {
  slice = new Slice();
  connectLive();
  moreKeys.s = () => { if (!$("slice-line").hidden) toggle("sliced"); };
  moreLink = (link) => {
    const text = parameters?.text();
    if (text && text !== JSON.stringify({ values: {}, off: [] })) link.set("set", text);
  };
  onCut = () => slice.update();
  const first = await (await ask("state")).json();
  if (first.recipe) await addControls();
  await poll();
}

startLive().catch((e) => fail(e.message));
