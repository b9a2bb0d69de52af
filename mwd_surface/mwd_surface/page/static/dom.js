// Elements of the page. Text is only inserted as text, so the name of a well or person cannot become markup.

const SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children.flat(Infinity)) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child);
  }
  return element;
}

export const el = (name, attributes = {}, ...children) => fill(document.createElement(name), attributes, children);

export const svg = (name, attributes = {}, ...children) =>
  fill(document.createElementNS(SVG, name), attributes, children);

// Factor by which the page is larger than at 1920 x 1080; use it for sizes in pixels.
export const scale = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

export const byId = (id) => document.getElementById(id);

// Set text only if it changed: setting it again would cost layout time and make screen readers repeat it.
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function mark(element, name, value) {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

const MARKS = { good: "✓", doubtful: "▲", reject: "✕", idle: "–", stale: "◌", info: "●" };

export function pill(kind, text) {
  return el("span", { class: `pill ${kind}` }, el("span", { "aria-hidden": "true" }, MARKS[kind] || "●"), ` ${text}`);
}
