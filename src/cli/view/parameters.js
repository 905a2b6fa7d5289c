
// Controls of a recipe's values, with undo and redo.

// A step of a slider: 1, 2 or 5 times a power of ten.
function niceStep(size) {
  const power = 10 ** Math.floor(Math.log10(size));
  const share = size / power;
  return power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
}

// Bounds of the slider of a number; the field beside it takes any.
function sliderRange({ key, kind, value, first }) {
  value ??= first;
  if (key.endsWith("volume_fraction")) return [0.02, 0.95, 0.01];
  const reach = 3 * Math.abs(value) || 10;
  const low = value > 0 ? (kind === "integer" ? Math.min(1, value) : value / 5) : -reach;
  const step = kind === "integer" ? 1 : niceStep((reach - low) / 200);
  return [Math.floor(low / step) * step || (low > 0 ? step : 0), Math.ceil(reach / step) * step, step];
}

class Parameters {
  // `changed` gets the values that differ from the file's.
  constructor(about, box, changed) {
    Object.assign(this, { about, changed, past: [], future: [], rows: new Map(), boxes: new Map(), switches: [], adders: [] });
    this.state = this.initial();
    this.settled = this.text();
    this.build(box);
  }

  initial() {
    const values = Object.fromEntries(this.about.controls.map((c) => [c.key, c.value]));
    return { values, off: [], order: this.about.operations.map((_, n) => n) };
  }

  // What differs from the file.
  text() {
    const values = {};
    for (const { key, value } of this.about.controls) {
      if (this.state.values[key] !== value) values[key] = this.state.values[key];
    }
    const { off, order } = this.state;
    return JSON.stringify(order.every((op, n) => op === n) ? { values, off } : { values, off, order });
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
      if (!control.key.startsWith("op.")) this.addRow(section(nameOf(control.key)), control, nameOf(control.key));
    }
    for (const [name, fieldset] of sections) {
      const absent = this.about.controls.filter((c) => c.first !== undefined && nameOf(c.key) === name);
      if (absent.length) fieldset.append(this.adder(name, absent));
    }
    this.about.operations.forEach((op, n) => this.addSwitch(section(`op.${n}`), op, n));
    for (const control of this.about.controls) {
      if (control.key.startsWith("op.")) this.addRow(section(nameOf(control.key)), control, nameOf(control.key));
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
    const name = op.name.replaceAll("_", " ");
    const mover = (sign, by, words) => {
      const button = make("button", { type: "button", className: "mover", textContent: sign, title: words });
      button.setAttribute("aria-label", `${words}: ${name}`);
      button.onclick = () => { this.move(n, by); button.focus(); };
      return button;
    };
    const movers = this.about.operations.length > 1 ? [mover("\u2191", -1, "earlier"), mover("\u2193", 1, "later")] : [];
    fieldset.firstChild.replaceChildren(make("label", { title: op.summary }, input, ` ${name}`), ...movers);
  }

  // Moves an operation among its neighbours.
  move(n, by) {
    const order = [...this.state.order];
    const at = order.indexOf(n);
    if (at + by < 0 || at + by >= order.length) return;
    [order[at], order[at + by]] = [order[at + by], order[at]];
    this.state.order = order;
    this.preview();
    this.settle();
  }

  // Adds a row under the heading of its group: the keys between the section and the last one.
  addRow(fieldset, control, section) {
    const inner = control.key.slice(section.length + 1).replace(section.startsWith("op.") ? /^\w+\.(?=\D)/ : "", "");
    const words = inner.replaceAll("_", " ").replace(/\.(\d)$/, (_, n) => ` ${"xyz"[n] ?? n}`).split(".");
    const name = words.pop();
    const group = words.join(" ");
    if (group !== (fieldset.dataset.group ?? "")) fieldset.append(make("p", { className: "group", textContent: group }));
    fieldset.dataset.group = group;
    fieldset.append(this.row(control, section, name));
  }

  row(control, section, name) {
    const { key, kind, unit, choices, description } = control;
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
    if (control.first !== undefined) {
      const remove = make("button", { type: "button", className: "mover", textContent: "\u00d7", title: "remove" });
      remove.setAttribute("aria-label", `remove ${key}`);
      remove.onclick = () => { this.state.values[key] = null; this.preview(); this.settle(); };
      row.append(remove);
    }
    row.append(make("p", { className: "warning", hidden: true }));
    this.rows.set(key, row);
    if (choices) field.value = control.value;
    return row;
  }

  // A list of the keys that a section lacks.
  adder(name, absent) {
    const select = make("select", { className: "adder" });
    select.setAttribute("aria-label", `add a key to ${name}`);
    select.onchange = () => {
      const control = absent.find((c) => c.key === select.value);
      if (control) this.set(control.key, control.first);
      this.settle();
    };
    this.adders.push({ select, absent });
    return select;
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
    const { values = {}, off = [], order = [] } = JSON.parse(text);
    this.state = this.initial();
    for (const [key, value] of Object.entries(values)) {
      if (key in this.state.values) this.state.values[key] = value;
    }
    this.state.off = off.filter((n) => n < this.switches.length);
    if (order.length === this.switches.length && new Set(order).size === order.length) this.state.order = order;
    this.settled = this.text();
    this.preview();
  }

  show() {
    for (const { key, kind } of this.about.controls) {
      const [row, value] = [this.rows.get(key), this.state.values[key]];
      const field = row.querySelector("[id]");
      const slider = row.querySelector("input[type=range]");
      row.hidden = value === null;
      if (row.hidden) continue;
      if (kind === "flag") field.checked = value;
      else if (document.activeElement !== field || kind === "word") field.value = value;
      if (slider) slider.value = value;
    }
    for (const { select, absent } of this.adders) {
      const left = absent.filter((c) => this.state.values[c.key] === null);
      const names = left.map((c) => new Option(c.key.split(".").at(-1).replaceAll("_", " "), c.key));
      select.replaceChildren(new Option("add \u2026", ""), ...names);
      select.hidden = !left.length;
    }
    this.switches.forEach((s, n) => {
      s.checked = !this.state.off.includes(n);
      this.boxes.get(`op.${n}`).classList.toggle("off", !s.checked);
    });
    this.arrange();
    $("undo").disabled = !this.past.length;
    $("redo").disabled = !this.future.length;
    $("reset").disabled = this.text() === JSON.stringify({ values: {}, off: [] });
  }

  // Puts the boxes of operations in their order.
  arrange() {
    const boxes = this.state.order.map((n) => this.boxes.get(`op.${n}`));
    const parent = boxes[0]?.parentNode;
    if (!parent) return;
    const now = [...parent.children].filter((box) => boxes.includes(box));
    if (now.every((box, n) => box === boxes[n])) return;
    const end = now.at(-1).nextSibling;
    for (const box of boxes) parent.insertBefore(box, end);
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
