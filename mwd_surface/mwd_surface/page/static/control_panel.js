// Panel of rig control (owner, set-points, achieved values) and of the advice on the next interval.

import { el, pill } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const KINDS = { driller: "idle", "asked for": "doubtful", controller: "info", fault: "reject" };
const GRANT = 0, DENY = 1, ABORT = 2;

const facts = (rows) => el("dl", { class: "facts" }, rows.map(([name, text]) => el("div", {}, el("dt", {}, name), el("dd", {}, text))));
const value = (kind, v) => (v === null ? "–" : `${units.number(kind, v)}${units.after(kind)}`);

function asked(control) {
  if (control.asked_speed !== null) return t`${say(control.mode)} at ${value("rotation", control.asked_speed)}`;
  if (control.asked_turn !== null) return `${say(control.mode)}: ${value("coarse_angle", control.asked_turn)}`;
  return say(control.mode);
}

function buttons(control, judge) {
  if (!control.enabled) return [];
  const button = (id, text, decision, on) => el("button", { type: "button", id, disabled: !(judge && on), onclick: () => judge(decision, control.pending) }, text);
  const held = control.state === "controller" || control.state === "fault";
  return [el("div", { class: "buttons" },
    button("grant-control", t("Grant"), GRANT, control.pending), button("deny-control", t("Deny"), DENY, control.pending),
    button("abort-control", t("Take control back"), ABORT, held))];
}

function controlPart(control) {
  if (control.since === null) return [el("p", { class: "empty" }, t("Unknown: the state of rig control has not been reported."))];
  if (!control.enabled) return [el("p", { class: "empty" }, t`The driller has the rig: ${say(control.reason) || t("control is switched off (control.enabled).")}`)];
  return [
    el("p", {}, pill(KINDS[control.state], control.owner ? t`${control.owner} has control` : control.state === "fault" ? t("fault") : t("the driller has the rig")), ` ${say(control.role)}`),
    control.pending ? el("p", { class: "headline" }, t`${control.pending_controller} asks for control (request ${control.pending}), ${say(control.pending_reason)}.`) : "",
    control.reason ? el("p", {}, say(control.reason)) : "",
    control.refusal ? el("p", { class: "headline" }, say(control.refusal)) : "",
    facts([
      [t("Commanded"), control.sequence && control.acknowledged === control.sequence ? t`${asked(control)}, acknowledged` : asked(control)],
      [t("Top drive actual"), `${value("rotation", control.achieved.speed)}, ${value("torque", control.achieved.torque)}`],
      [t("Flow commanded, actual"), `${control.flow_rate === null ? t("the driller's") : value("flow", control.flow_rate)}, ${value("flow", control.achieved.flow)}`],
      [t("If the controller dies"), t`sliding: ${say(control.reactions.controller_lost_sliding)}, rotating: ${say(control.reactions.controller_lost_rotating)}`],
      [t("If the MWD dies"), t`sliding: ${say(control.reactions.mwd_lost_sliding)}, rotating: ${say(control.reactions.mwd_lost_rotating)}`],
    ]),
  ];
}

function advicePart(advice) {
  if (advice.mode === "none") return [el("p", { class: "empty" }, t`No advice: ${say(advice.reason) || t("nothing is known yet")}.`)];
  const depth = (v) => (v === null ? "–" : units.number("length", v));
  const from = advice.from_depth === null ? "" : t` from ${depth(advice.from_depth)}`;
  const rows = [[t("Advice"), advice.mode === "rotate" ? t`rotate${from} to ${depth(advice.to_depth)} ${units.unit("length")}`
    : (advice.slide_to_depth === null ? t`slide${from}` : t`slide${from} to ${depth(advice.slide_to_depth)} ${units.unit("length")}, then rotate`)]];
  if (advice.toolface !== null) {
    const sigma = advice.sigma === null ? "" : t`, sigma ${units.size("coarse_angle", advice.sigma, -1)}°`;
    rows.push([t("Toolface"), `${units.bearing(advice.toolface, 0)}° ${advice.magnetic ? t("MTF") : t("GTF")} ± ${units.size("coarse_angle", advice.limit, -1)}°${sigma}`]);
  }
  if (advice.confidence !== null) rows.push([t("Right within the limit"), `${Math.floor(100 * advice.confidence)} %`]);
  return [facts(rows), el("p", { class: "quiet-text" }, `${say(advice.source)}: ${say(advice.reason)}`)];
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
    place.replaceChildren(el("div", { class: "split two" }, part(t("Next interval"), 1), part(t("Control of the rig"), 2)));
  }
  const [next, rig] = place.firstChild.children;
  if (advice) keep(next.children[1], JSON.stringify([advice, units.isField()]), () => advicePart(advice));
  if (!control) return;
  keep(rig.children[1], JSON.stringify([control, units.isField()]), () => controlPart(control));
  keep(rig.children[2], JSON.stringify([control.enabled, control.state, control.pending, judge !== null]), () => buttons(control, judge));
}
