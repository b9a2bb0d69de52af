// The panel beside the numbers: progress of a survey, quality of the last one, offset from the plan.

import { byId, el, pill } from "./dom.js";
import * as units from "./units.js";

const LIGHTS = { good: "good", doubtful: "doubtful", reject: "reject", "no reference": "idle" };
const VERDICTS = { accept: ["good", "accept"], doubtful: ["doubtful", "doubtful"], reject: ["reject", "reject"] };
const KINDS = { "m/s^2": "gravity_deviation", T: "field", rad: "angle" };

export function showProgress(progress) {
  const place = byId("progress");
  if (!progress.active) {
    place.replaceChildren(...(progress.result ? [el("p", { class: "result" }, progress.result)] : []));
    return;
  }
  const total = progress.elapsed + progress.remaining;
  const share = total > 0 ? progress.elapsed / total : 0;
  const words = `TAKING SURVEY · ${Math.ceil(progress.remaining)} s to go`;
  place.replaceChildren(
    el("p", { class: "taking" }, words),
    el("p", { class: "quiet-text" }, progress.state),
    el("progress", { max: 1, value: share.toFixed(3), "aria-label": "Survey in progress" }),
  );
}

export function showQuality(quality) {
  const place = byId("lights");
  if (!quality.known) {
    place.replaceChildren(el("p", { class: "empty" }, "No survey yet."));
    byId("reasons").replaceChildren();
    return;
  }
  const [kind, word] = VERDICTS[quality.verdict];
  const rows = quality.lights.map((light) => {
    const unit = KINDS[light.unit];
    const text = light.deviation === null
      ? (light.value === null ? "no data" : "no reference")
      : `${units.signed(unit, light.deviation)} of ± ${units.size(unit, light.limit)}${units.after(unit)}`;
    const share = light.deviation === null ? 0 : Math.max(-1, Math.min(1, light.deviation / (2 * light.limit)));
    const bar = el("span", { class: "bar", "aria-hidden": "true" }, el("span", { class: `fill ${LIGHTS[light.light]}` }));
    const fill = bar.firstChild.style;
    fill.left = `${50 + Math.min(0, share) * 50}%`;
    fill.width = `${Math.abs(share) * 50}%`;
    return el("div", { class: "light", "data-light": light.light },
      pill(LIGHTS[light.light], light.light), el("span", { class: "name" }, light.corrected ? `${light.name}, corrected` : light.name), el("span", { class: "deviation" }, text), bar);
  });
  place.replaceChildren(
    el("p", { class: "verdict" }, `No. ${quality.sequence}, ${units.clock(quality.stamp_ns)}`, pill(kind, word)),
    ...rows,
  );
  byId("reasons").replaceChildren(...quality.reasons.map((text) => el("li", {}, text)));
}

export function showOffset(o) {
  const place = byId("offset");
  if (!o.known) {
    place.replaceChildren(el("p", { class: "empty" }, "No plan loaded."));
    return;
  }
  const length = (v) => `${units.number("length", Math.abs(v))} ${units.unit("length")}`;
  const facts = [
    ["Well is", `${length(o.up)} ${o.up < 0 ? "below" : "above"}, ${length(o.right)} ${o.right < 0 ? "left" : "right"}`],
    ["Steer back at", `${units.bearing(o.toolface, 0)}° GTF`],
  ];
  if (o.dogleg_to_target !== null) facts.push(["To hit target", `${units.number("dogleg", o.dogleg_to_target)}${units.after("dogleg")}`]);
  place.replaceChildren(el("dl", { class: "facts" }, facts.map(([name, text]) => el("div", {}, el("dt", {}, name), el("dd", {}, text)))));
}
