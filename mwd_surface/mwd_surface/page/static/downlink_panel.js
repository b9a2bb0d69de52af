// The downlink command: its state for everyone, its buttons for people with the token.

import { byId, el, pill } from "./dom.js";
import { act, mayCommand, operatorName } from "./operator_tab.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const KINDS = { confirmed: "good", unconfirmed: "doubtful", aborted: "reject", denied: "reject", lapsed: "doubtful", idle: "idle" };
const UNDER_WAY = ["draft", "pending", "granted", "armed", "running", "sent"];
const DECISIONS = { submit: 0, grant: 1, deny: 2, abort: 3 };
const UNITS = { pulse_width: " s", carrier: " Hz", toolface_rate: t(" times") };

let chosen = "";

// number: number of the request that was shown, so that a later request is not granted by mistake.
const decide = (word, number) => () => act("decide_downlink", { decision: DECISIONS[word], operator_name: operatorName(), number });

export function showDownlink(table, server) {
  const place = byId("downlink");
  place.hidden = !table;
  if (!table) return;
  const may = mayCommand(server);
  const key = JSON.stringify([table, may, units.isField()]);
  // Do not replace a list while it is open.
  if (key === place.dataset.key || place.contains(document.activeElement) && document.activeElement.tagName === "SELECT") return;
  place.dataset.key = key;
  place.replaceChildren(
    el("h2", {}, t("Command to the tool")),
    el("p", { class: "downlink-state" }, pill(KINDS[table.state] || "info", say(table.state)), ` ${describe(table)}`),
    table.blocked_by.length ? el("ul", { class: "downlink-blocked" }, table.blocked_by.map((text) => el("li", {}, say(text)))) : "",
    may ? buttons(table) : el("p", { class: "quiet-text" }, t("With the token you can send, grant and abort commands; without it this page is read-only.")),
  );
}

function describe(table) {
  const running = table.state === "running" ? t`symbol ${table.symbol} of ${table.symbols}, ${units.age(table.remaining)} left, ${say(table.medium)} ${units.number(table.medium, table.set_point)}${units.after(table.medium)} of ${units.number(table.medium, table.base)}` : "";
  const who = [table.requested_by && t`asked by ${table.requested_by}`, table.decided_by && t`decided by ${table.decided_by}`].filter(Boolean).join(", ");
  return [say(table.reason) || t("No command was sent yet."), running, who].filter(Boolean).join(" \u00b7 ");
}

function buttons(table) {
  const button = (id, text, onclick, shown) => (shown ? el("button", { type: "button", id, onclick }, text) : "");
  const choice = el("select", { id: "downlink-command", "aria-label": t("Command"), onchange: () => { chosen = choice.value; } }, options(table));
  if (chosen) choice.value = chosen;
  const draft = () => {
    const [command, value] = JSON.parse(choice.value);
    act("draft_downlink", { command, value, operator_name: operatorName() });
  };
  const free = !UNDER_WAY.includes(table.state) || table.state === "draft";
  return el("div", { class: "buttons" },
    free ? choice : "",
    button("downlink-draft", t("Draft"), draft, free),
    button("downlink-submit", t("Ask for permission"), decide("submit", table.number), table.state === "draft"),
    button("downlink-grant", t("Grant"), decide("grant", table.number), table.state === "pending"),
    button("downlink-deny", t("Deny"), decide("deny", table.number), table.state === "pending"),
    button("downlink-abort", t("Abort"), decide("abort", table.number), UNDER_WAY.includes(table.state)));
}

function options(table) {
  return table.choices.flatMap(([name, values]) => (values.length ? values : [0]).map((value) => el("option", { value: JSON.stringify([name, value]) },
    `${say(name.replaceAll("_", " "))}${values.length ? ` ${value}${UNITS[name] || ""}` : ""}`)));
}
