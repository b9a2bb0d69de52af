// The toolface dial: high side or north up, clockwise looking downhole.

import { el, mark, setText, svg } from "./dom.js";
import { ageOf, stateOf, unusualAge } from "./cells.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const CENTRE = 200;
const QUILL_LASTS = 3; // s until the top drive pointer disappears
const HUB = 92;
const AGE_RING = 120; // s until the age ring is closed
const AGE_RADIUS = 189;
const LABELS_AT = 140;
const RINGS = { newest: 122, oldest: 101 };

const point = (angle, radius) => [
  CENTRE + radius * Math.sin(angle),
  CENTRE - radius * Math.cos(angle),
];
const at = (angle, radius) => point(angle, radius).map((v) => v.toFixed(1)).join(" ");

function sector(from, to, inner, outer) {
  const large = to - from > Math.PI ? 1 : 0;
  return (
    `M ${at(from, inner)} L ${at(from, outer)} A ${outer} ${outer} 0 ${large} 1 ${at(to, outer)} ` +
    `L ${at(to, inner)} A ${inner} ${inner} 0 ${large} 0 ${at(from, inner)} Z`
  );
}

// Path of an arc that starts at the top and goes clockwise.
const arc = (to, radius) => `M ${at(0, radius)} A ${radius} ${radius} 0 ${to > Math.PI ? 1 : 0} 1 ${at(to, radius)}`;

const LABELS = {
  gravity: { 0: t("HIGH"), 90: t("90 R"), 180: t("LOW"), 270: t("90 L") },
  magnetic: { 0: t("N"), 90: t("E"), 180: t("S"), 270: t("W") },
};

export class Dial {
  constructor(place, side, legend) {
    this.advisory = svg("path", { class: "advisory", d: "" });
    this.labels = svg("g", { class: "labels" });
    this.readings = svg("g", { class: "readings" });
    this.needle = svg("path", { class: "needle", d: "M 200 12 L 217 50 L 200 41 L 183 50 Z" });
    this.age = svg("path", { class: "age-ring", d: "" });
    this.quill = svg("path", { class: "quill", d: "M 200 14 L 190 -4 L 210 -4 Z", visibility: "hidden" });
    this.number = svg("text", { class: "dial-number", x: 200, y: 206 }, "");
    this.side = svg("text", { class: "dial-side", x: 200, y: 233 }, "");
    this.mode = svg("text", { class: "dial-mode", x: 200, y: 143 }, "");
    this.note = svg("text", { class: "dial-note", x: 200, y: 259 }, "");
    const ticks = svg("g", { class: "ticks", "aria-hidden": "true" });
    for (let degrees = 0; degrees < 360; degrees += 5) {
      const angle = (degrees * Math.PI) / 180;
      const inner = degrees % 30 === 0 ? 172 : degrees % 10 === 0 ? 179 : 183;
      const [x1, y1] = point(angle, inner);
      const [x2, y2] = point(angle, 188);
      ticks.append(svg("line", { x1, y1, x2, y2, class: degrees % 30 === 0 ? "major" : "minor" }));
    }
    this.svg = svg(
      "svg",
      { viewBox: "0 -6 400 412", role: "img", "aria-label": t("Toolface: no data"), "data-state": "none" },
      svg("circle", { class: "bezel", cx: 200, cy: 200, r: 190 }),
      this.advisory,
      ticks,
      svg("circle", { class: "hub", cx: 200, cy: 200, r: HUB }),
      this.readings,
      this.labels,
      this.age,
      this.needle,
      this.quill,
      this.mode,
      this.number,
      this.side,
      this.note,
    );
    place.append(this.svg);
    // Large numbers next to the full-screen dial, to be read from three metres.
    this.far = { number: el("p", { class: "far-number" }), words: el("p", { class: "far-words" }), note: el("p", { class: "far-note" }) };
    this.beside = el("div", { class: "far", "aria-hidden": "true" }, this.far.words, this.far.number, this.far.note);
    side.append(this.beside);
    this.legend = legend;
    this.labelled = "";
  }

  label(mode) {
    if (this.labelled === mode) return;
    this.labelled = mode;
    this.labels.replaceChildren();
    for (let degrees = 0; degrees < 360; degrees += 30) {
      const [x, y] = point((degrees * Math.PI) / 180, LABELS_AT);
      const word = LABELS[mode][degrees];
      this.labels.append(
        svg("text", { x: x.toFixed(1), y: (y + 6).toFixed(1), class: word ? "cardinal" : "" }, word || String(degrees)),
      );
    }
  }

  show({ toolface, attitude, quill }, now, silent, wordAge) {
    if (!toolface) return;
    this.showAge(wordAge);
    this.showQuill(quill, now, silent);
    const mode = toolface.mode;
    const gravity = mode === "gravity";
    const cell = toolface.angle;
    const state = stateOf(cell, now, silent);
    this.label(mode);
    mark(this.svg, "data-state", state);
    mark(this.svg, "data-rotating", toolface.rotating && state === "live" ? "yes" : "no");
    this.showAdvisory(toolface, state);
    this.showReadings(toolface.readings, now);
    const words = gravity ? t("GTF · high side up") : attitude?.north ? t`MTF · ${say(attitude.north)} north up` : t("MTF · unnamed north up");
    setText(this.mode, gravity ? t("GTF") : t("MTF"));
    mark(this.mode, "data-long", this.mode.textContent.length > 4 ? "yes" : "no");
    if (state === "none") {
      setText(this.number, t("no data"));
      setText(this.side, "");
      setText(this.note, "");
      mark(this.needle, "visibility", "hidden");
      mark(this.svg, "aria-label", t`Toolface, ${words}: no data`);
    } else {
      const degrees = Number(units.bearing(cell.value, 0));
      mark(this.needle, "visibility", "visible");
      mark(this.needle, "transform", `rotate(${((cell.value * 180) / Math.PI).toFixed(1)} 200 200)`);
      setText(this.number, `${degrees}°`);
      setText(this.side, gravity ? sideOf(degrees) : "");
      const inside = toolface.advisory?.inside ?? null;
      const word = inside === null ? unusualAge(cell, now) : inside ? t("INSIDE") : t("OUTSIDE");
      // A string that has just stopped may only be sticking and turn again: do not steer by the toolface yet.
      const turning = attitude?.status?.includes("toolface_unsettled") && !attitude.status.includes("rotating") ? t("MAY TURN") : t("ROTATING");
      const note = state === "stale" ? t`STALE ${ageOf(cell, now)}` : toolface.rotating ? turning : word;
      setText(this.note, note);
      mark(this.svg, "aria-label", t`Toolface ${degrees} degrees, ${words}, ${note}`);
    }
    this.showFar(state);
    this.showLegend(toolface, words, cell, state, wordAge !== null);
  }

  // Show the age of a toolface from a link as a ring that closes within two minutes.
  showAge(age) {
    const share = age === null ? 0 : Math.min(0.999, age / AGE_RING);
    mark(this.age, "d", share > 0 ? arc(share * 2 * Math.PI, AGE_RADIUS) : "");
  }

  showFar(state) {
    for (const name of ["data-state", "data-inside", "data-rotating"]) mark(this.beside, name, this.svg.getAttribute(name) || "none");
    setText(this.far.number, this.number.textContent);
    setText(this.far.words, [this.mode.textContent, this.side.textContent].filter(Boolean).join(" · "));
    setText(this.far.note, state === "none" ? "" : this.note.textContent);
  }

  showAdvisory(toolface, state) {
    const advisory = toolface.advisory;
    if (!advisory) {
      mark(this.advisory, "d", "");
      mark(this.svg, "data-inside", "none");
      return;
    }
    const limit = Math.min(advisory.limit, Math.PI - 0.01);
    mark(this.advisory, "d", sector(advisory.toolface - limit, advisory.toolface + limit, HUB + 2, 170));
    mark(this.svg, "data-inside", state !== "live" || toolface.rotating || advisory.inside === null ? "none" : advisory.inside ? "yes" : "no");
  }

  // Second pointer with the angle of the top drive from the rig: hollow, outside the ring, hidden when the angle is too old.
  showQuill(quill, now, silent) {
    const known = quill && !silent && now - quill.since <= QUILL_LASTS;
    mark(this.quill, "visibility", known ? "visible" : "hidden");
    this.quillText = known ? t`▽ quill ${units.bearing(quill.value, 0)}°` : "";
    if (known) mark(this.quill, "transform", `rotate(${((quill.value * 180) / Math.PI).toFixed(1)} 200 200)`);
  }

  // Put the newest reading on the outer ring; round marks are gravity, square ones magnetic toolfaces.
  showReadings(readings, now) {
    const key = readings.map((r) => r.at).join();
    if (key !== this.readingsKey) {
      this.readingsKey = key;
      const step = (RINGS.newest - RINGS.oldest) / Math.max(1, readings.length - 1);
      this.readings.replaceChildren(
        ...readings.map((reading, k) => {
          const back = readings.length - 1 - k;
          const [x, y] = point(reading.angle, RINGS.newest - back * step);
          const opacity = Math.max(0.25, 1 - back / readings.length).toFixed(2);
          const size = back === 0 ? 7 : 5;
          return reading.mode === "gravity"
            ? svg("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: size, opacity, class: reading.rotating ? "turning" : "" })
            : svg("rect", {
              x: (x - size).toFixed(1), y: (y - size).toFixed(1), width: 2 * size, height: 2 * size, opacity,
              class: reading.rotating ? "turning" : "",
            });
        }),
      );
    }
  }

  showLegend(toolface, words, cell, state, overLink) {
    const parts = [words];
    if (state !== "live" && cell.reason) parts.push(say(cell.reason));
    else if (state !== "none" && cell.sigma !== null) parts.push(`± ${units.spread("coarse_angle", cell.sigma)}° 1σ`);
    const advisory = toolface.advisory;
    const lines = [parts.join(" · ")];
    const second = [];
    if (state !== "none" && toolface.measured_ns) second.push(overLink ? t`word of ${units.clock(toolface.measured_ns)} UTC` : t`read ${units.clock(toolface.measured_ns)} UTC`);
    if (advisory) {
      const wanted = t`wanted ${units.bearing(advisory.toolface, 0)}° ± ${units.size("coarse_angle", advisory.limit, -1)}°`;
      second.push(wanted);
    }
    if (this.quillText) second.push(this.quillText);
    lines.push(second.join(" · "));
    const below = toolface.threshold === null ? t("near vertical") : t`below ${units.size("angle", toolface.threshold, -2)}° inclination`;
    lines.push(t`● GTF  ■ MTF ${below}  ○ rotating`);
    const text = lines.join("\n");
    if (this.legendText === text) return;
    this.legendText = text;
    this.legend.replaceChildren(...lines.map((line) => el("span", {}, line)));
  }
}

function sideOf(degrees) {
  if (degrees === 0) return t("HIGH SIDE");
  if (degrees === 180) return t("LOW SIDE");
  return degrees < 180 ? t`${degrees} R` : t`${360 - degrees} L`;
}
