// Panel of rig control (owner, set-points, achieved values) and of the advice on the next interval.

import { el, pill } from "./dom.js";
import * as units from "./units.js";

const KINDS = { driller: "idle", "asked for": "doubtful", controller: "info", fault: "reject" };
const GRANT = 0, DENY = 1, ABORT = 2;

const facts = (rows) => el("dl", { class: "facts" }, rows.map(([name, text]) => el("div", {}, el("dt", {}, name), el("dd", {}, text))));
const value = (kind, v) => (v === null ? "–" : `${units.number(kind, v)}${units.after(kind)}`);

function asked(control) {
  if (control.asked_speed !== null) return `${control.mode} at ${value("rotation", control.asked_speed)}`;
  if (control.asked_turn !== null) return `${control.mode}: ${value("coarse_angle", control.asked_turn)}`;
  return control.mode;
}

function buttons(control, judge) {
  if (!control.enabled) return [];
  const button = (id, text, decision, on) => el("button", { type: "button", id, disabled: !(judge && on), onclick: () => judge(decision, control.pending) }, text);
  const held = control.state === "controller" || control.state === "fault";
  return [el("div", { class: "buttons" },
    button("grant-control", "Grant", GRANT, control.pending), button("deny-control", "Deny", DENY, control.pending),
    button("abort-control", "Take control back", ABORT, held))];
}

function controlPart(control) {
  if (control.since === null) return [el("p", { class: "empty" }, "Unknown: the state of rig control has not been reported.")];
  if (!control.enabled) return [el("p", { class: "empty" }, `The driller has the rig: ${control.reason || "control is switched off (control.enabled)."}`)];
  return [
    el("p", {}, pill(KINDS[control.state], control.owner ? `${control.owner} has control` : control.state === "fault" ? "fault" : "the driller has the rig"), ` ${control.role}`),
    control.pending ? el("p", { class: "headline" }, `${control.pending_controller} asks for control (request ${control.pending}), ${control.pending_reason}.`) : "",
    control.reason ? el("p", {}, control.reason) : "",
    control.refusal ? el("p", { class: "headline" }, control.refusal) : "",
    facts([
      ["Commanded", `${asked(control)}${control.sequence && control.acknowledged === control.sequence ? ", acknowledged" : ""}`],
      ["Top drive actual", `${value("rotation", control.achieved.speed)}, ${value("torque", control.achieved.torque)}`],
      ["Flow commanded, actual", `${control.flow_rate === null ? "the driller's" : value("flow", control.flow_rate)}, ${value("flow", control.achieved.flow)}`],
      ["If the controller dies", `sliding: ${control.reactions.controller_lost_sliding}, rotating: ${control.reactions.controller_lost_rotating}`],
      ["If the MWD dies", `sliding: ${control.reactions.mwd_lost_sliding}, rotating: ${control.reactions.mwd_lost_rotating}`],
    ]),
  ];
}

function advicePart(advice) {
  if (advice.mode === "none") return [el("p", { class: "empty" }, `No advice: ${advice.reason || "nothing is known yet"}.`)];
  const depth = (v) => (v === null ? "–" : units.number("length", v));
  const from = advice.from_depth === null ? "" : ` from ${depth(advice.from_depth)}`;
  const rows = [["Advice", advice.mode === "rotate" ? `rotate${from} to ${depth(advice.to_depth)} ${units.unit("length")}`
    : `slide${from}${advice.slide_to_depth === null ? "" : ` to ${depth(advice.slide_to_depth)} ${units.unit("length")}, then rotate`}`]];
  if (advice.toolface !== null) {
    const sigma = advice.sigma === null ? "" : `, sigma ${units.size("coarse_angle", advice.sigma, -1)}°`;
    rows.push(["Toolface", `${units.bearing(advice.toolface, 0)}° ${advice.magnetic ? "MTF" : "GTF"} ± ${units.size("coarse_angle", advice.limit, -1)}°${sigma}`]);
  }
  if (advice.confidence !== null) rows.push(["Right within the limit", `${Math.floor(100 * advice.confidence)} %`]);
  return [facts(rows), el("p", { class: "quiet-text" }, `${advice.source}: ${advice.reason}`)];
}

// Replace elements only if they changed, so that a button does not vanish between press and release.
function keep(place, key, build) {
  if (place.dataset.key === key) return;
  place.dataset.key = key;
  place.replaceChildren(...build());
}

// judge(decision, number of the request that was shown); null if this page may not command.
export function showControl(place, control, advice, judge) {
  if (!place.firstChild) {
    const part = (title, count) => el("div", {}, el("h2", {}, title), ...Array.from({ length: count }, () => el("div", {})));
    place.replaceChildren(el("div", { class: "split two" }, part("Next interval", 1), part("Control of the rig", 2)));
  }
  const [next, rig] = place.firstChild.children;
  if (advice) keep(next.children[1], JSON.stringify([advice, units.isField()]), () => advicePart(advice));
  if (!control) return;
  keep(rig.children[1], JSON.stringify([control, units.isField()]), () => controlPart(control));
  keep(rig.children[2], JSON.stringify([control.enabled, control.state, control.pending, judge !== null]), () => buttons(control, judge));
}
