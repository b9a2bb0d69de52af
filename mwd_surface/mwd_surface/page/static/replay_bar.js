// The bar of `mwd view`: position in the recording, play and pause, rate; hidden on a live page.

import { byId, el, setText } from "./dom.js";
import { t } from "./words.js";

const RATES = [0.25, 1, 2, 5, 10, 30, 100];
let built = null;
let held = false;

function time(seconds) {
  const whole = Math.floor(seconds);
  const parts = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return parts.map((part) => String(part).padStart(2, "0")).join(":");
}

async function ask(given) {
  try {
    await fetch("replay", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(given) });
  } catch {
    // No action is needed: the banner shows that the viewer is gone.
  }
}

function build(replay) {
  const play = el("button", { type: "button", id: "replay-play", onclick: () => ask({ playing: play.dataset.playing !== "yes" }) });
  const slider = el("input", {
    type: "range", id: "replay-slider", min: 0, max: replay.length, step: 0.1, "aria-label": t("Time in the recording"),
    onpointerdown: () => { held = true; },
    oninput: () => { setText(built.at, time(Number(slider.value))); },
    onchange: () => { held = false; ask({ seek: Number(slider.value) }); },
  });
  const rate = el("select", { id: "replay-rate", "aria-label": t("Playback speed"), onchange: () => ask({ rate: Number(rate.value) }) },
    RATES.map((value) => el("option", { value }, `${value} ×`)));
  const at = el("output", { id: "replay-at" });
  byId("replay").append(play, slider, at, el("span", {}, `/ ${time(replay.length)}`), rate);
  byId("replay").hidden = false;
  built = { play, slider, rate, at };
}

export function showReplay(replay) {
  if (!replay) return;
  if (!built) build(replay);
  const { play, slider, rate, at } = built;
  play.dataset.playing = replay.playing ? "yes" : "no";
  setText(play, replay.playing ? t("Pause") : t("Play"));
  if (!held) {
    slider.value = replay.at;
    setText(at, replay.seeking ? `${time(replay.at)} …` : time(replay.at));
  }
  if (!RATES.includes(replay.rate) && ![...rate.options].some((option) => Number(option.value) === replay.rate)) {
    rate.append(el("option", { value: replay.rate }, `${replay.rate} ×`));
  }
  if (document.activeElement !== rate) rate.value = String(replay.rate);
}
