// Tabs, or all panels at once on a large screen.

import { byId, el, mark } from "./dom.js";

const TABS = [
  ["surveys", "Surveys"], ["path", "Path"], ["charts", "Charts"], ["steering", "Steering"], ["link", "Link"], ["alarms", "Alarms"], ["system", "System"], ["controls", "Operator"],
];

const wide = window.matchMedia("(min-width: 1800px) and (min-height: 900px)");
const ALWAYS = ["surveys", "path"];

let tab = "surveys";
let onSelect = () => {};

export function select(name, focus = false) {
  if (wide.matches && ALWAYS.includes(name)) name = "charts";
  tab = name;
  const tabs = TABS.filter(([key]) => !wide.matches || !ALWAYS.includes(key));
  byId("tabs").replaceChildren(...tabs.map(([key, text]) => el("button", {
    type: "button", role: "tab", id: `select-${key}`, "aria-selected": String(key === tab), "aria-controls": `tab-${key}`,
    tabindex: key === tab ? "0" : "-1", onclick: () => select(key, true),
  }, text)));
  for (const [key] of TABS) {
    const panel = byId(`tab-${key}`);
    const always = wide.matches && ALWAYS.includes(key);
    panel.hidden = !(always || key === tab);
    mark(panel, "role", always ? "region" : "tabpanel");
  }
  if (focus) byId(`select-${tab}`).focus();
  onSelect();
}

// Shows the first tab; `shown` is called whenever other panels become visible.
export function startTabs(shown) {
  onSelect = shown;
  byId("tabs").addEventListener("keydown", (event) => {
    const keys = [...byId("tabs").children].map((b) => b.id.slice("select-".length));
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const k = keys.indexOf(tab);
    if (step) select(keys[(k + step + keys.length) % keys.length], true);
    if (event.key === "Home") select(keys[0], true);
    if (event.key === "End") select(keys[keys.length - 1], true);
  });
  wide.addEventListener("change", () => select(tab));
  select(tab);
}
