// Tabs below the dial, one of which can fill the page, or all panels at once on a large screen.

import { byId, el, mark, setText } from "./dom.js";
import { current, fills, setView, startView } from "./view.js";
import { t } from "./words.js";

const TABS = [
  ["surveys", t("Surveys")], ["path", t("Path")], ["charts", t("Charts")], ["logs", t("Logs")], ["tool", t("Tool")], ["steering", t("Steering")], ["link", t("Link")], ["alarms", t("Alarms")], ["system", t("System")], ["controls", t("Operator")],
];
const NAMES = TABS.map(([key]) => key);

const wide = window.matchMedia("(min-width: 1800px) and (min-height: 900px)");
const ALWAYS = ["surveys", "path"];

let tab = "surveys";
let onSelect = () => {};

// Whether a panel is always shown next to the tabs, whichever tab is selected.
const always = (key) => wide.matches && !fills() && ALWAYS.includes(key);

export function select(name, focus = false) {
  if (fills() && name !== current()) setView(name, { replace: true });
  tab = always(name) ? "charts" : name;
  byId("tabs").replaceChildren(...TABS.filter(([key]) => !always(key)).map(([key, text]) => el("button", {
    type: "button", role: "tab", id: `select-${key}`, "aria-selected": String(key === tab), "aria-controls": `tab-${key}`,
    tabindex: key === tab ? "0" : "-1", onclick: () => select(key, true),
  }, text)));
  for (const key of NAMES) {
    const panel = byId(`tab-${key}`);
    panel.hidden = !(always(key) || key === tab);
    mark(panel, "role", always(key) ? "region" : "tabpanel");
  }
  setText(byId("fill"), fills() ? t("Back") : t("Full page"));
  setText(byId("view"), current() === "toolface" ? t("All panels") : t("Dial"));
  if (focus) byId(`select-${tab}`).focus();
  onSelect();
}

function typing(event) {
  return event.ctrlKey || event.altKey || event.metaKey || event.target.closest?.("input, select, textarea");
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
  byId("fill").addEventListener("click", () => setView(fills() ? "all" : tab));
  document.addEventListener("keydown", (event) => {
    if (typing(event)) return;
    if (event.key === "f") setView(fills() ? "all" : tab);
    if (event.key === "d") setView(current() === "toolface" ? "all" : "toolface");
    if (event.key === "Escape" && current() !== "all") setView("all");
  });
  wide.addEventListener("change", () => select(tab));
  startView(["toolface", ...NAMES], () => select(fills() ? current() : tab));
}
