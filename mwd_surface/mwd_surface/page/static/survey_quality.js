// Panel next to the numbers: progress of a survey, quality of the last survey, offset from the plan.

import { byId, el, mark, pill, setText } from "./dom.js";
import { percent } from "./survey_table.js";
import { stateOfStream } from "./streams.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const LIGHTS = { good: "good", doubtful: "doubtful", reject: "reject", "no reference": "unknown", "not measured": "unknown" };
const VERDICTS = { accept: ["good"], doubtful: ["doubtful"], reject: ["reject"] };
const SIGNS = { accept: "✓", doubtful: "▲", reject: "✕" };
const KINDS = { "m/s^2": "gravity_deviation", T: "field", rad: "angle" };

const progressParts = { head: el("p", { class: "taking" }), state: el("p", { class: "doing" }), bar: el("progress", { max: 1, value: 0, "aria-label": t("Survey in progress") }), result: el("p", { class: "result" }) };

// State of the survey under way, its time, and the result of the last one; the box keeps its height.
export function showProgress({ survey_progress: progress, quality, rig, streams }, now, silent) {
  const { head, state, bar, result } = progressParts;
  const place = byId("progress");
  if (!progress) return;
  if (!place.firstChild) place.append(head, state, bar, result);
  const past = progress.since === null ? 0 : Math.max(0, now - progress.since);
  const waiting = progress.active && Boolean(progress.waits_for);
  const elapsed = progress.elapsed === null ? null : progress.elapsed + past;
  const left = progress.remaining === null ? null : Math.max(0, progress.remaining - past);
  const pumps = { true: t("pumps on"), false: t("pumps off") }[rig?.pumps_on] || "";
  // Without new samples no survey can be running, whatever the last report said.
  const held = progress.active && Boolean(streams) && stateOfStream(streams.estimator, now, silent) !== "live";
  mark(place, "data-state", silent || held ? "silent" : waiting ? "waiting" : progress.active ? "taking" : "idle");
  // Between surveys, if the last survey was not accepted, its instruction fills the box, so that it is not cut off. The
  // result of a later attempt has priority over the instruction.
  const newest = !progress.result || progress.result.startsWith(`survey ${quality?.sequence}:`);
  const instructs = !silent && !progress.active && newest && quality && quality.verdict !== "accept";
  const instruction = instructs ? say(quality.headline) : "";
  mark(place, "data-instructs", instruction ? "yes" : "no");
  setText(head, silent ? t("NO SURVEY REPORT") : held ? t("SURVEY HELD UP") : waiting
    ? t`SURVEY WAITS · at most ${whole(left, Math.ceil)}`
    : progress.active ? t`TAKING SURVEY · ${left === null ? t("time unknown") : left > 0 ? t`${Math.ceil(left)} s to go` : t("finishing")}` : instruction || t("No survey under way"));
  const doing = waiting ? t`${say(progress.waits_for)}; averaging for ${whole(elapsed, Math.floor)} so far` : progress.state === "none under way" ? "" : say(progress.state);
  setText(state, instruction ? "" : held ? t("no samples arrive") : [doing, progress.active ? pumps : ""].filter(Boolean).join(" · "));
  const share = !progress.active || elapsed === null || left === null || elapsed + left <= 0 ? 0 : elapsed / (elapsed + left);
  mark(bar, "value", share.toFixed(3));
  setText(result, progress.result && !instruction ? t`Last: ${say(progress.result)}` : "");
}

const whole = (seconds, round) => (seconds === null ? t("time unknown") : `${round(seconds)} s`);

function lightRow(light) {
  const unit = KINDS[light.unit];
  const text = light.deviation === null
    ? (light.light === "no survey" ? "" : light.value === null ? t("not measured") : t("no reference"))
    : t`${units.signed(unit, light.deviation)} of ± ${units.size(unit, light.limit)}${units.after(unit)}`;
  const share = light.deviation === null ? 0 : Math.max(-1, Math.min(1, light.deviation / (2 * light.limit)));
  const bar = el("span", { class: "bar", "aria-hidden": "true" }, el("span", { class: `fill ${LIGHTS[light.light]}` }));
  const fill = bar.firstChild.style;
  fill.left = `${50 + Math.min(0, share) * 50}%`;
  fill.width = `${Math.abs(share) * 50}%`;
  return el("div", { class: "light", "data-light": light.light },
    pill(LIGHTS[light.light] || "idle", say(light.light)), el("span", { class: "name" }, light.corrected ? t`${say(light.name)}, corrected` : say(light.name)), el("span", { class: "deviation" }, text), bar);
}

const NAMES = ["inclination", "azimuth", "toolface"];
// Empty rows with the same names, before the first survey.
const NONE = ["total gravity", "total field", "dip"].map((name) => ({ name, unit: "T", value: null, deviation: null, limit: 1, light: "no survey" }));

export function showQuality(quality) {
  const verdict = (word) => [(VERDICTS[word] || ["idle"])[0], say(word)];
  byId("lights").replaceChildren(
    el("p", { class: "verdict" }, quality ? [t`No. ${quality.sequence}, ${units.clock(quality.stamp_ns)}`, pill(...verdict(quality.verdict))] : t("No survey yet.")),
    el("p", { class: "each" }, quality ? NAMES.map((name, k) => el("span", { class: `word ${verdict(quality.verdicts[k])[0]}` }, `${say(name)} ${SIGNS[quality.verdicts[k]] || "–"}`)) : ""),
    ...(quality ? quality.lights : NONE).map(lightRow),
  );
  const other = quality && quality.alternatives.length
    ? t`Azimuth may also be ${quality.alternatives.map(([azimuth, odds]) => `${units.bearing(azimuth, 1)}° (${percent(odds)})`).join(t(" or "))}.` : "";
  const details = quality ? quality.reasons.filter((text) => text !== quality.headline) : [];
  byId("reasons").replaceChildren(
    quality?.headline ? el("p", { class: "headline" }, say(quality.headline)) : "",
    other ? el("p", {}, other) : "",
    details.length ? el("ul", { class: "reasons" }, details.map((text) => el("li", {}, say(text)))) : "",
  );
}

export function showOffset(o, plan, path) {
  const place = byId("offset");
  if (!o) {
    const why = plan?.name ? t`not known yet: no depth or survey to compare with ${plan.name}` : t("no plan loaded");
    place.replaceChildren(el("p", { class: "empty" }, t`Off plan: ${why}.`));
    return;
  }
  const length = (v) => `${units.number("length", Math.abs(v))} ${units.unit("length")}`;
  const whole = (text) => el("span", { class: "whole" }, text);
  const facts = [
    [t("Off plan"), [whole(o.up < 0 ? t`${length(o.up)} below` : t`${length(o.up)} above`), t(", "), whole(o.right < 0 ? t`${length(o.right)} left` : t`${length(o.right)} right`)]],
    [t("Steer back at"), `${units.bearing(o.toolface, 0)}° ${t("GTF")}`],
  ];
  if (o.dogleg_to_target !== null) facts.push([t("To hit target"), `${units.number("dogleg", o.dogleg_to_target)}${units.after("dogleg")}`]);
  const doubt = path?.assumptions.length ? el("p", {}, pill("doubtful", t("assumed")), t(" the position rests on an assumption: see Path")) : "";
  place.replaceChildren(doubt, el("dl", { class: "facts" }, facts.map(([name, text]) => el("div", {}, el("dt", {}, name), el("dd", {}, text)))));
}
