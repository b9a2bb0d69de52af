// Operator controls: a name for the log, a token for the server.

import { command, download, exportedFiles } from "./connection.js";
import { byId, el, setText } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const operator = { name: sessionStorage.getItem("operator") || "", token: "" };

let answerBox = null;

export const operatorName = () => operator.name;

export const mayCommand = (server) => server.controls && operator.token !== "";

export async function act(name, values) {
  const request = Object.fromEntries(Object.entries(values).filter(([, value]) => value !== ""));
  if ("operator_name" in values && !operator.name.trim()) {
    const message = t("give your name under Operator first");
    if (answerBox) setText(answerBox, message);
    return { ok: false, message };
  }
  const answer = await command(name, operator.token, request);
  if (answerBox) setText(answerBox, `${say(name.replaceAll("_", " "))}: ${say(answer.message)}`);
  return answer;
}

export function showControls(server, onToken) {
  const place = byId("tab-controls");
  if (!server.controls) {
    place.replaceChildren(el("h2", {}, t("Operator")), el("p", { id: "read-only" }, t("This page is read-only: the surface unit has no token configured.")));
    answerBox = null;
    return;
  }
  if (answerBox) return;
  answerBox = el("output", { class: "answer", id: "answer" });
  const name = el("input", { type: "text", id: "operator-name", autocomplete: "off", maxlength: 80 });
  const token = el("input", { type: "password", id: "operator-token", autocomplete: "off", maxlength: 200 });
  name.value = operator.name;
  name.addEventListener("input", () => { operator.name = name.value; sessionStorage.setItem("operator", name.value); });
  token.addEventListener("input", () => {
    const had = operator.token !== "";
    operator.token = token.value;
    for (const one of all) one.disabled = operator.token === "";
    if (had !== (operator.token !== "")) onToken();
  });
  const button = (id, text, command_, given = () => ({})) => el("button", { type: "button", id, disabled: true, onclick: () => act(command_, given()) }, text);
  const depth = el("input", { type: "text", id: "bit-depth", inputmode: "decimal", autocomplete: "off", maxlength: 12 });
  const format = el("select", { id: "export-format" }, server.exports.map(([key, text]) => el("option", { value: key }, say(text))));
  const setDepth = el("button", { type: "button", id: "set-depth", disabled: true, onclick: () => {
    const metres = units.metres(depth.value);
    if (metres === null) setText(answerBox, t`bit depth "${depth.value}" is not a number (${units.unit("length")})`);
    else act("set_depth", { bit_depth: metres, operator_name: operator.name });
  } }, t("Set bit depth"));
  const buttons = [
    button("take-survey", t("Take survey"), "take_survey"),
    button("start-recording", t("Start recording"), "start_recording"),
    button("stop-recording", t("Stop recording"), "stop_recording"),
    button("split-recording", t("Split recording"), "split_recording"),
    button("snapshot-recording", t("Snapshot"), "snapshot_recording"),
  ];
  const lengthUnit = (id) => el("span", { id, class: "length-unit" }, units.unit("length"));
  const files = el("ul", { class: "exported", "aria-label": t("Exported files") });
  const writing = el("button", { type: "button", id: "export", disabled: true, onclick: async () => {
    const { ok } = await act("export", { format: format.value });
    if (!ok) return;
    const made = await exportedFiles(operator.token);
    if (made.length) fetched(made[0].name);
    files.replaceChildren(...made.map((one) => el("li", {},
      el("button", { type: "button", onclick: () => fetched(one.name) }, one.name), ` ${units.bytes(one.bytes)}, ${units.clock(one.changed * 1e9, true)}`)));
  } }, t("Export and download"));
  const fetched = async (name) => {
    const problem = await download(name, operator.token);
    if (problem) setText(answerBox, `${name}: ${say(problem)}`);
  };
  const reason = el("input", { type: "text", id: "rod-reason", autocomplete: "off", maxlength: 120 });
  const counted = el("input", { type: "text", id: "rod-count", inputmode: "numeric", autocomplete: "off", maxlength: 5 });
  const rod = (given) => ({ operator_name: operator.name, ...given });
  const rods = [
    button("add-rod", t("Rod drilled down"), "count_rods", () => rod({ change: 1 })),
    button("remove-rod", t("Rod removed"), "count_rods", () => rod({ change: -1 })),
    el("button", { type: "button", id: "correct-rods", disabled: true, onclick: () => {
      // Number("") is 0; an empty field must not empty the hole.
      if (!/^[0-9]+$/.test(counted.value.trim())) setText(answerBox, t`number of rods "${counted.value}" is not a whole number`);
      else act("count_rods", rod({ count: Number(counted.value), reason: reason.value }));
    } }, t("Correct the number")),
  ];
  const leg = el("input", { type: "text", id: "leg-name", autocomplete: "off", maxlength: 40 });
  const legDepth = el("input", { type: "text", id: "leg-depth", inputmode: "decimal", autocomplete: "off", maxlength: 12 });
  const useLeg = el("button", { type: "button", id: "use-leg", disabled: true, onclick: () => {
    // Without a depth the name is that of an earlier leg.
    const from = legDepth.value.trim() === "" ? "" : units.metres(legDepth.value);
    if (from === null) setText(answerBox, t`depth "${legDepth.value}" is not a number (${units.unit("length")})`);
    else act("use_leg", { leg: leg.value, kick_off_depth: from, operator_name: operator.name });
  } }, t("Survey this leg"));
  const all = [...buttons, setDepth, writing, useLeg, ...rods];
  place.replaceChildren(
    el("h2", {}, t("Operator")),
    el("p", { class: "quiet-text" }, t("With the token you can judge surveys in their table row and acknowledge alarms; without it this page is read-only.")),
    el("form", { class: "form", onsubmit: (event) => event.preventDefault() }, el("label", { for: "operator-name" }, t("Your name, for the log")), name, el("label", { for: "operator-token" }, t("Token")), token),
    el("div", { class: "buttons" }, buttons),
    el("div", { class: "buttons" },
      el("label", { for: "bit-depth" }, t("Bit depth, "), lengthUnit("bit-depth-unit")), depth, setDepth,
      el("label", { for: "export-format" }, t("Survey list as")), format, writing),
    el("div", { class: "buttons", id: "rods", hidden: true }, el("span", { id: "rod-tally" }), rods[0], rods[1],
      el("label", { for: "rod-count" }, t("Rods counted")), counted, el("label", { for: "rod-reason" }, t("because")), reason, rods[2]),
    el("div", { class: "buttons" },
      el("label", { for: "leg-name" }, t("Branch or sidetrack")), leg,
      el("label", { for: "leg-depth" }, t("leaves at, "), lengthUnit("leg-depth-unit")), legDepth, useLeg),
    answerBox,
    files,
  );
}

// Rods in the hole by the tally, where the depth is counted by rods.
export function showRods(rods) {
  const place = document.getElementById("rods");
  if (!place) return;
  place.hidden = !rods;
  if (rods) setText(document.getElementById("rod-tally"), t`${rods.rods} rods, bit depth ${units.number("length", rods.bit_depth)} ${units.unit("length")}`);
}
