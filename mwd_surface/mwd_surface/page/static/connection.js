// The last state from the server, and its age by the server's own clock.

import { t } from "./words.js";

const SILENT_AFTER = 2.5;
// If the other end disappears silently (cable, switch), no close event comes, so use a timeout.
const REOPEN_AFTER = 6;
const POLL_EVERY = 1000;
const DRIFT = 1e-4;

const seconds = () => performance.now() / 1000;

export class Connection {
  constructor(onChange) {
    this.sections = {};
    this.server = {};
    this.mode = "websocket";
    this.onChange = onChange;
    this.receivedAt = null;
    this.offset = null;
    this.said = null;
    this.failures = 0;
    this.polling = null;
    this.socket = null;
    this.open();
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden && this.silent()) this.open();
    });
    setInterval(() => {
      if (this.socket && Math.min(this.silence(), seconds() - this.openedAt) > REOPEN_AFTER) this.openAgain();
    }, POLL_EVERY);
  }

  // Time on the server's steady clock, s. The message with the smallest offset travelled fastest. The offset creeps up
  // slowly to follow two clocks that differ in speed. The browser's time of day is not used.
  now() {
    if (this.offset === null) return null;
    const { replay } = this.server;
    if (!replay) return seconds() - this.offset;
    // The clock of a recording stops while it is paused, and runs at the replay rate.
    const since = replay.playing && !replay.seeking ? Math.min(seconds() - this.receivedAt, 1) * replay.rate : 0;
    return this.said + since;
  }

  silence() {
    return this.receivedAt === null ? Infinity : seconds() - this.receivedAt;
  }

  silent() {
    return this.silence() > SILENT_AFTER;
  }

  open() {
    if (this.socket) {
      this.socket.onclose = null;
      this.socket.onmessage = null;
      this.socket.close();
    }
    clearTimeout(this.retry);
    let fresh = true;
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.openedAt = seconds();
    let socket;
    try {
      socket = new WebSocket(`${scheme}://${location.host}/live`);
    } catch {
      // A rule of the browser or an extension forbids WebSocket altogether.
      this.socket = null;
      this.failures = Math.max(this.failures, 1);
      this.failed();
      return;
    }
    this.socket = socket;
    socket.onmessage = (event) => {
      this.failures = 0;
      this.stopPolling();
      this.mode = "websocket";
      this.take(JSON.parse(event.data), fresh);
      fresh = false;
    };
    socket.onclose = () => {
      this.socket = null;
      this.failed();
      this.retry = setTimeout(() => this.open(), Math.min(4000, 400 * 2 ** Math.min(this.failures, 4)));
    };
  }

  openAgain() {
    // A proxy may be holding a socket that has been silent for this long: poll at once.
    this.failures = Math.max(this.failures, 1);
    this.failed();
    this.open();
  }

  failed() {
    this.failures += 1;
    if (this.failures >= 2) this.startPolling();
  }

  // Poll, because some proxies block WebSocket.
  startPolling() {
    if (this.polling) return;
    this.polling = setInterval(async () => {
      try {
        const answer = await fetch("state.json", { cache: "no-store", signal: AbortSignal.timeout(2000) });
        if (!answer.ok || !this.polling) return;
        const message = await answer.json();
        this.mode = "polling";
        this.take(message, true);
      } catch {
        // No action is needed: the banner appears when the last message is too old.
      }
    }, POLL_EVERY);
  }

  stopPolling() {
    clearInterval(this.polling);
    this.polling = null;
  }

  take(message, whole) {
    const at = seconds();
    const offset = at - message.now;
    if (whole || message.server.replay || this.offset === null || offset < this.offset) this.offset = offset;
    else this.offset += Math.min(offset - this.offset, DRIFT * (at - this.receivedAt));
    this.receivedAt = at;
    this.said = message.now;
    this.server = message.server;
    if (whole) this.sections = {};
    for (const [name, section] of Object.entries(message.sections)) {
      this.sections[name] = section && "whole" in section ? this.joined(name, section) : section;
    }
    this.onChange(whole ? null : new Set(Object.keys(message.sections)));
  }

  // Growing sections are sent as their new rows only.
  joined(name, { whole, columns, rows, length }) {
    const all = (whole ? [] : this.sections[name]?.rows || []).concat(rows);
    const last = all.length ? all[all.length - 1][0] : 0;
    return { columns, length, rows: all.filter((row) => last - row[0] <= length) };
  }
}

export async function command(name, token, given) {
  try {
    const answer = await fetch(`command/${name}`, {
      method: "POST",
      headers: { "Content-Type": "application/json", Authorization: `Bearer ${token}` },
      body: JSON.stringify(given),
      signal: AbortSignal.timeout(20000),
    });
    const { ok, message } = await answer.json();
    return { ok, message };
  } catch {
    return { ok: false, message: t("no answer from the surface unit") };
  }
}

// Files that were exported, newest first: name, bytes, changed (s since the epoch).
export async function exportedFiles(token) {
  try {
    const answer = await fetch("exports", { headers: { Authorization: `Bearer ${token}` }, signal: AbortSignal.timeout(10000) });
    return answer.ok ? (await answer.json()).files : [];
  } catch {
    return [];
  }
}

// Give an exported file to the browser as a download; returns what went wrong, or an empty text.
export async function download(name, token) {
  try {
    const answer = await fetch(`exports/${encodeURIComponent(name)}`, { headers: { Authorization: `Bearer ${token}` } });
    if (!answer.ok) return (await answer.json()).message;
    const address = URL.createObjectURL(await answer.blob());
    const link = document.createElement("a");
    [link.href, link.download] = [address, name];
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 60000);
    return "";
  } catch {
    return t("no answer from the surface unit");
  }
}
