// What all pages share: access to elements, files, themes, views and the axes in the corner.
"use strict";

const $ = (id) => document.getElementById(id);

function make(tag, properties, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

function toggle(id) {
  $(id).checked = !$(id).checked;
  $(id).dispatchEvent(new Event("change"));
}

function setTheme(drawing, dark) {
  document.documentElement.className = dark ? "dark" : "light";
  $("dark").checked = dark;
  drawing.state.theme = dark ? "dark" : "light";
  drawing.request();
}

// Connects the buttons of views; returns their keys. `home` shows all of the part.
function addViews(drawing, home) {
  const shown = (act) => () => { act(); drawing.request(); };
  const face = (turn, tilt) => shown(() => drawing.camera.face(turn, tilt, drawing.wide()));
  const views = { h: shown(home), 1: face(-Math.PI / 2, 0), 2: face(0, 0), 3: face(-Math.PI / 2, Math.PI / 2) };
  const buttons = { home: views.h, front: views[1], side: views[2], top: views[3] };
  for (const [id, act] of Object.entries(buttons)) $(id).addEventListener("click", act);
  return views;
}

function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function drawTriad(camera) {
  const { right, up, back } = camera.axes();
  const ends = [["x", "#d9413a", 0], ["y", "#3c9a3f", 1], ["z", "#3a6fe0", 2]];
  ends.sort((a, b) => back[a[2]] - back[b[2]]);
  $("triad").innerHTML = ends.map(([name, color, k]) => {
    const [x, y] = [24 * right[k], -24 * up[k]];
    return `<line x2="${x}" y2="${y}" stroke="${color}" stroke-width="2.5" stroke-linecap="round"/>` +
      `<text x="${1.32 * x}" y="${1.32 * y}" fill="${color}">${name}</text>`;
  }).join("");
}
