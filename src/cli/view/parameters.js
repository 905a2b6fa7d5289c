
// Controls of a recipe's values, with undo and redo.

// A step of a slider: 1, 2 or 5 times a power of ten.
function niceStep(size) {
  const power = 10 ** Math.floor(Math.log10(size));
  const share = size / power;
  return power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
}

// Bounds of the slider of a number; the field beside it takes any.
function sliderRange({ key, kind, value }) {
  if (key.endsWith("volume_fraction")) return [0.02, 0.95, 0.01];
  const reach = 3 * Math.abs(value) || 10;
  const low = value > 0 ? (kind === "integer" ? Math.min(1, value) : value / 5) : -reach;
  const step = kind === "integer" ? 1 : niceStep((reach - low) / 200);
  return [Math.floor(low / step) * step || (low > 0 ? step : 0), Math.ceil(reach / step) * step, step];
}

class Parameters {
  // `changed` gets the values that differ from the file's.
  constructor(about, box, changed) {
    Object.assign(this, { about, changed, past: [], future: [], rows: new Map(), boxes: new Map(), switches: [] });
    this.state = this.initial();
    this.settled = this.text();
    this.build(box);
  }

  initial() {
    const values = Object.fromEntries(this.about.controls.map((c) => [c.key, c.value]));
    return { values, off: [] };
  }

  // What differs from the file.
  text() {
    const values = {};
    for (const { key, value } of this.about.controls) {
      if (this.state.values[key] !== value) values[key] = this.state.values[key];
    }
    return JSON.stringify({ values, off: this.state.off });
  }

  build(box) {
    const sections = new Map();
    const section = (name) => {
      if (!sections.has(name)) {
        const legend = make("legend", { textContent: name.replace(/^cell\./, "cell ") });
        const fieldset = make("fieldset", {}, legend);
        fieldset.dataset.section = name;
        fieldset.append(make("p", { className: "warning", hidden: true }));
        sections.set(name, fieldset);
      }
      return sections.get(name);
    };
    const nameOf = (key) => key.split(".").slice(0, /^(cell|crystal|op)\./.test(key) ? 2 : 1).join(".");
    for (const control of this.about.controls) {
      if (!control.key.startsWith("op.")) section(nameOf(control.key)).append(this.row(control, nameOf(control.key)));
    }
    this.about.operations.forEach((op, n) => this.addSwitch(section(`op.${n}`), op, n));
    for (const control of this.about.controls) {
      if (control.key.startsWith("op.")) section(nameOf(control.key)).append(this.row(control, nameOf(control.key)));
    }
    this.boxes = sections;
    box.replaceChildren(...sections.values());
  }

  addSwitch(fieldset, op, n) {
    const input = make("input", { type: "checkbox", checked: true, id: `op-${n}` });
    input.onchange = () => {
      this.state.off = this.switches.map((s, k) => s.checked ? -1 : k).filter((k) => k >= 0);
      this.preview();
      this.settle();
    };
    this.switches[n] = input;
    fieldset.firstChild.replaceChildren(make("label", { title: op.summary }, input, ` ${op.name.replaceAll("_", " ")}`));
  }

  row(control, section) {
    const { key, kind, unit, choices, description } = control;
    const inner = key.slice(section.length + 1).replace(section.startsWith("op.") ? /^\w+\.(?=\D)/ : "", "");
    const name = inner.replaceAll("_", " ").replace(/\.(\d)$/, (_, n) => ` ${"xyz"[n] ?? n}`).replaceAll(".", " ");
    const field = this.field(control);
    field.id = `key-${key}`;
    field.setAttribute("aria-label", key);
    const label = make("span", { textContent: name || section, title: description });
    const row = make("div", { className: `parameter ${kind}` }, label);
    row.dataset.key = key;
    if (kind === "number" || kind === "integer") {
      const [min, max, step] = sliderRange(control);
      const slider = make("input", { type: "range", min, max, step, value: control.value });
      slider.setAttribute("aria-label", `${key}, slider`);
      slider.oninput = () => this.set(key, Number(slider.value));
      slider.onchange = () => this.settle();
      row.append(slider);
    }
    row.append(field);
    if (unit) row.append(make("span", { className: "unit", textContent: unit }));
    row.append(make("p", { className: "warning", hidden: true }));
    this.rows.set(key, row);
    if (choices) field.value = control.value;
    return row;
  }

  field({ key, kind, value, choices }) {
    const isNumber = kind === "number" || kind === "integer";
    if (kind === "word") {
      const select = make("select", {}, ...choices.map((c) => new Option(c.replaceAll("_", " "), c)));
      select.onchange = () => { this.set(key, select.value); this.settle(); };
      return select;
    }
    if (kind === "flag") {
      const box = make("input", { type: "checkbox", checked: value });
      box.onchange = () => { this.set(key, box.checked); this.settle(); };
      return box;
    }
    const input = make("input", { value, spellcheck: false });
    if (isNumber) input.inputMode = "decimal";
    input.onchange = () => {
      const number = Number(input.value);
      if (isNumber && !(input.value.trim() && Number.isFinite(number))) return this.show();
      this.set(key, isNumber ? (kind === "integer" ? Math.round(number) : number) : input.value);
      this.settle();
    };
    return input;
  }

  set(key, value) {
    this.state.values[key] = typeof value === "number" ? +value.toPrecision(12) : value;
    this.preview();
  }

  // Shows and computes the state.
  preview() {
    this.show();
    this.changed(this.text());
  }

  // Ends a change: what undo goes back to.
  settle() {
    if (this.text() === this.settled) return;
    this.past.push(this.settled);
    this.future = [];
    this.settled = this.text();
    this.show();
  }

  go(from, to) {
    if (!from.length) return;
    to.push(this.settled);
    this.load(from.pop());
  }

  undo() { this.go(this.past, this.future); }

  redo() { this.go(this.future, this.past); }

  reset() {
    this.state = this.initial();
    this.preview();
    this.settle();
  }

  // Takes a state as text; unknown keys are left out.
  load(text) {
    const { values = {}, off = [] } = JSON.parse(text);
    this.state = this.initial();
    for (const [key, value] of Object.entries(values)) {
      if (key in this.state.values) this.state.values[key] = value;
    }
    this.state.off = off.filter((n) => n < this.switches.length);
    this.settled = this.text();
    this.preview();
  }

  show() {
    for (const { key, kind } of this.about.controls) {
      const [row, value] = [this.rows.get(key), this.state.values[key]];
      const field = row.querySelector("[id]");
      const slider = row.querySelector("input[type=range]");
      if (kind === "flag") field.checked = value;
      else if (document.activeElement !== field || kind === "word") field.value = value;
      if (slider) slider.value = value;
    }
    this.switches.forEach((s, n) => {
      s.checked = !this.state.off.includes(n);
      this.boxes.get(`op.${n}`).classList.toggle("off", !s.checked);
    });
    $("undo").disabled = !this.past.length;
    $("redo").disabled = !this.future.length;
    $("reset").disabled = this.text() === JSON.stringify({ values: {}, off: [] });
  }

  // Shows messages beside their keys; returns those without one.
  place(messages) {
    const spots = [...this.rows.values(), ...this.boxes.values()].map((e) => e.querySelector(":scope > .warning"));
    spots.forEach((p) => { p.textContent = ""; p.hidden = true; });
    const rest = [];
    for (const { key, text, wrong } of messages) {
      const first = key && [...this.boxes.keys()].find((name) => name === key || key.startsWith(`${name}.`) || name.startsWith(`${key}.`));
      const spot = (this.rows.get(key) ?? this.boxes.get(first))?.querySelector(":scope > .warning");
      if (!spot) {
        rest.push({ text, wrong });
        continue;
      }
      spot.textContent += (spot.textContent ? "\n" : "") + text;
      spot.classList.toggle("wrong", Boolean(wrong));
      spot.hidden = false;
    }
    return rest;
  }
}
