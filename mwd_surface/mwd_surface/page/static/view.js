// The view of the page: "all" panels, the dial alone ("toolface"), or one tab that fills the page (the tab's name).
// The address names it (?view=path), so that a screen can be set up with it and the browser's Back button leaves it.

import { mark } from "./dom.js";

let view = "all";
let onView = () => {};

export const current = () => view;

// Whether one tab fills the page.
export const fills = () => view !== "all" && view !== "toolface";

const asked = () => new URL(location.href).searchParams.get("view") || "all";

function show(next) {
  view = next;
  mark(document.body, "data-view", fills() ? "tab" : view);
  onView();
}

// replace: replace the history entry, so that the Back button does not return to the previous view.
export function setView(next, { replace = false } = {}) {
  if (next !== view) {
    const address = new URL(location.href);
    if (next === "all") address.searchParams.delete("view");
    else address.searchParams.set("view", next);
    history[replace ? "replaceState" : "pushState"](null, "", address);
  }
  show(next);
}

// names: names of the views; shown is called whenever another view becomes visible.
export function startView(names, shown) {
  onView = shown;
  const wanted = () => (names.includes(asked()) ? asked() : "all");
  window.addEventListener("popstate", () => show(wanted()));
  show(wanted());
}
