// The telemetry link: a strip that is always shown, and a tab with spectrum, pressure, passes and words.

import { byId, el, mark, pill, scale, setText } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const KINDS = { locked: "good", doubtful: "doubtful", searching: "info", "no flow": "idle", "no pressure": "reject" };
const UNITS = { rad: "angle", T: "field", degC: "temperature", V: "voltage", gAPI: "gamma" };
const SAYS = { locked: t("Words arrive"), searching: t("No words yet"), "no flow": t("No mud flows: the tool is silent"), doubtful: t("Words are doubtful"), "no pressure": t("No pressure arrives") };
const HARMONICS = [1, 2, 3, 6];
const MOST_PASSES = 12; // shown

function valueText(word) {
  if (word.unit === "m/s^2") return `${(word.value / 9.80665).toFixed(4)} g`;
  const kind = UNITS[word.unit];
  if (kind) return `${units.number(kind, word.value)}${kind === "angle" ? "" : " "}${units.unit(kind)}`;
  return `${Number(word.value.toPrecision(4))} ${word.unit}`;
}

function wordBox(word) {
  const share = Math.floor(100 * word.confidence);
  const bar = el("span", { class: "link-share", "aria-hidden": "true" });
  // Set the width by script, because the content policy forbids styles in the markup.
  bar.style.setProperty("--share", `${share}%`);
  return el("span", { class: "link-word", "data-status": word.status, title: provisional(word, t`${say(word.status)}, right with a probability of ${share} %`) },
    el("span", { class: "name" }, say(word.name)), el("span", { class: "number" }, word.status === "erased" ? t("erased") : valueText(word)), bar);
}

const provisional = (word, text) => (word.final ? text : t`${text}, provisional`);

const state = (link) => pill(KINDS[link.state] || "idle", `${say(link.name)}: ${say(link.state)}`);

const margin = (link) => (link.margin_db === null ? "" : t`margin ${link.margin_db < 0 ? "−" : "+"}${units.decimal(Math.abs(link.margin_db).toFixed(1))} dB`);

// State, margin, present pass, and words of the last survey.
export function showLinkStrip(link, since) {
  const place = byId("link-strip");
  place.hidden = !link;
  if (!link) return;
  const running = link.words_expected ? t`${say(link.mode)} ${link.words_done} of ${link.words_expected}` : "";
  const old = link.survey_age === null ? "" : t`survey ${units.age(link.survey_age + since)} old`;
  const key = JSON.stringify([link.state, link.reason, link.margin_db, running, old, link.survey, link.others.map((one) => [one.name, one.state])]);
  if (key === place.dataset.key) return;
  place.dataset.key = key;
  place.replaceChildren(
    el("span", { class: "link-state" }, [link, ...link.others].map(state)),
    el("span", { class: "link-say" }, [margin(link), running, old, say(link.reason)].filter(Boolean).join(" · ")),
    el("span", { class: "link-words" }, link.survey.map(wordBox)),
  );
}

// overLink: false if the tool is connected directly; null or true if no link state has come yet.
export function showLink(link, overLink) {
  const place = byId("link-body");
  if (!link) {
    place.replaceChildren(el("p", { class: "empty" }, overLink === false ? t("The tool is connected directly: there is no telemetry link to show.") : t("No telemetry link has reported yet.")));
    return;
  }
  if (!place.querySelector("canvas")) {
    place.replaceChildren(
      el("p", { class: "link-reason" }),
      el("div", { class: "link-pictures" },
        el("figure", {}, el("figcaption", {}, t("Spectrum of the pressure, the newest on the right")), el("canvas", { id: "link-waterfall", role: "img" })),
        el("figure", {}, el("figcaption", {}, t("Pressure of the last two minutes, with the chosen pulses below")), el("canvas", { id: "link-wave", role: "img" }))),
      el("div", { class: "link-tables" }),
      el("div", { class: "link-others" }));
  }
  const says = [say(link.reason) || SAYS[link.state] || say(link.state), margin(link)].filter(Boolean).join(" · ");
  setText(place.querySelector(".link-reason"), link.others.length ? t`In use: ${say(link.name)}. ${says}` : says);
  if (!byId("tab-link").hidden) {
    drawWaterfall(byId("link-waterfall"), link);
    drawWave(byId("link-wave"), link);
  }
  place.querySelector(".link-tables").replaceChildren(...tables(link));
  place.querySelector(".link-others").replaceChildren(...link.others.map(other));
}

const tables = (link) => [figures(link), passes(link), words(link)];

// Row of a link that is received, but is not the link in use.
function other(link) {
  return el("section", { "aria-label": link.name },
    el("p", {}, state(link), ` ${say(link.reason) || margin(link)}`), el("div", { class: "link-tables" }, tables(link)));
}

function figures(link) {
  const rows = [
    ["Eb/N0", link.ebn0_db === null ? t("no signal") : `${link.ebn0_db.toFixed(1)} dB`],
    [t("margin"), link.margin_db === null ? t("no signal") : `${link.margin_db.toFixed(1)} dB`],
    [t("believed bits"), link.goodput === null ? t("none yet") : `${link.goodput.toFixed(2)} /s`],
    [t("expected share of wrong words"), link.word_error === null ? t("not known") : `${(100 * link.word_error).toFixed(1)} %`],
    [t("tool clock"), link.clock_error === null ? t("not known") : `${(100 * link.clock_error).toFixed(3)} %`],
    [t("pumps"), link.strokes.length ? link.strokes.map((hz) => `${(60 * hz).toFixed(1)} /min`).join(", ") : t("not counted")],
  ];
  return el("table", { class: "link-figures" }, el("tbody", {}, rows.map(([name, text]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, text)))));
}

function passes(link) {
  const rows = link.frames.slice(-MOST_PASSES).reverse().map((frame) => el("tr", {}, [
    units.clock(frame.start_ns), say(frame.kind), t`${frame.believed} of ${frame.words}`, frame.ebn0_db === null ? "–" : units.decimal(frame.ebn0_db.toFixed(1)), say(frame.reason) || t("complete"),
  ].map((text) => el("td", {}, text))));
  return table([t("begin, UTC"), t("pass"), t("believed"), "Eb/N0 dB", t("end")], rows, t("No pass yet."));
}

function words(link) {
  const rows = [...link.words].reverse().slice(0, 20).map((word) => el("tr", { "data-status": word.status }, [
    units.clock(word.stamp_ns), say(word.name), valueText(word), `${(Math.floor(1000 * word.confidence) / 10).toFixed(1)} %`, provisional(word, say(word.status)),
  ].map((text) => el("td", {}, text))));
  return table([t("end, UTC"), t("word"), t("value"), t("confidence"), t("status")], rows, t("No word yet."));
}

function table(names, rows, empty) {
  if (!rows.length) return el("p", { class: "empty" }, empty);
  return el("table", { class: "link-table" }, el("thead", {}, el("tr", {}, names.map((name) => el("th", { scope: "col" }, name)))), el("tbody", {}, rows));
}

function prepared(canvas) {
  const box = canvas.getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.max(1, Math.round(box.width * ratio));
  canvas.height = Math.max(1, Math.round(box.height * ratio));
  const context = canvas.getContext("2d");
  context.setTransform(ratio * scale(), 0, 0, ratio * scale(), 0, 0);
  context.font = `12px ${getComputedStyle(document.body).fontFamily}`;
  const css = getComputedStyle(document.documentElement);
  return { context, width: box.width / scale(), height: box.height / scale(), colour: (name) => css.getPropertyValue(name).trim() };
}

// Columns are time, rows are frequency. Lightness grows with power, so that the picture is readable without colour.
function drawWaterfall(canvas, link) {
  const { context, width, height, colour } = prepared(canvas);
  const picture = link.picture;
  if (!picture?.spectra.length) return;
  const all = picture.spectra.flat().sort((a, b) => a - b);
  const low = all[Math.floor(all.length * 0.05)];
  const high = Math.max(low + 10, all[Math.floor(all.length * 0.995)]);
  const left = 44;
  const step = (width - left - 96) / 45;
  const tall = height / picture.spectra[0].length;
  picture.spectra.forEach((column, k) => {
    const x = left + (45 - picture.spectra.length + k) * step;
    column.forEach((db, row) => {
      const share = Math.max(0, Math.min(1, (db - low) / (high - low)));
      context.fillStyle = `hsl(${215 - 165 * share} 70% ${8 + 62 * share}%)`;
      context.fillRect(x, height - (row + 1) * tall, step + 0.6, tall + 0.6);
    });
  });
  const top = picture.bin_hz * picture.spectra[0].length;
  context.fillStyle = colour("--muted");
  for (let hz = 0; hz < top; hz += 2) context.fillText(`${hz} Hz`, 4, height - (hz / top) * height - 2);
  context.fillStyle = colour("--text");
  const rows = [];
  link.strokes.forEach((hz, k) => HARMONICS.forEach((n) => { if (n * hz < top) rows.push([n * hz, t`pump ${k + 1} ×${n}`]); }));
  let last = Infinity;
  for (const [hz, text] of rows.sort((a, b) => a[0] - b[0])) {
    const y = height - (hz / top) * height;
    context.fillRect(width - 96, y, 8, 1);
    if (last - y > 12) { context.fillText(text, width - 84, y + 4); last = y; }
  }
  mark(canvas, "aria-label", t`Spectrum of the pressure up to ${top.toFixed(0)} Hz`);
}

function drawWave(canvas, link) {
  const { context, width, height, colour } = prepared(canvas);
  const picture = link.picture;
  if (!picture?.line.length) return;
  const span = 120;
  // Scale to the range of most samples: starting pumps are drawn beyond the edge and do not hide the pulses.
  const sizes = picture.line.map(Math.abs).sort((a, b) => a - b);
  const most = Math.max(20, 2 * sizes[Math.floor(0.9 * sizes.length)]);
  const x = (ago) => width * (1 - ago / span);
  const room = height - 26;
  context.strokeStyle = colour("--trace");
  context.lineWidth = 1.5;
  context.beginPath();
  picture.line.forEach((kpa, k) => {
    const at = x((picture.line.length - 1 - k) / picture.line_hz);
    const y = room / 2 - (kpa / most) * (room / 2 - 4);
    if (k) context.lineTo(at, y); else context.moveTo(at, y);
  });
  context.stroke();
  context.fillStyle = colour("--muted");
  context.fillText(`± ${most.toFixed(0)} kPa`, 4, 12);
  for (const word of link.words) {
    context.fillStyle = colour(word.status === "erased" ? "--idle" : "--good");
    const ago = (picture.end_ns - word.start_ns) / 1e9;
    if (ago < 0) continue;
    for (const pulse of word.pulses) {
      const at = x(ago - pulse);
      if (at >= 0 && at <= width) context.fillRect(at - 1.5, room + 2, 3, 10);
    }
    const at = x(ago);
    if (at > -60 && at < width) context.fillText(say(word.name), Math.max(2, at), height - 2);
  }
  mark(canvas, "aria-label", t("Pressure of the last two minutes with the chosen pulses"));
}
