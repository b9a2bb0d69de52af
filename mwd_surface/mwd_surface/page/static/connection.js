// The state as the server last sent it, and how long ago that was by the server's own clock.

const SILENT_AFTER = 2.5;
// A connection whose other end is gone without a word (a cable, a switch) is closed by nobody.
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

  // Seconds on the server's steady clock. The smallest offset is the message that travelled fastest; creeping up
  // slowly follows two clocks that do not run at quite the same speed. The browser's time of day is not used.
  now() {
    if (this.offset === null) return null;
    const { replay } = this.server;
    if (!replay) return seconds() - this.offset;
    // The clock of a recording stands while it is paused, and runs at its rate.
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
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket = socket;
    this.openedAt = seconds();
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
    this.failed();
    this.open();
  }

  failed() {
    this.failures += 1;
    if (this.failures >= 2) this.startPolling();
  }

  // Some proxies let no WebSocket through.
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
        // Silence shows by itself: the banner comes from the age of the last message.
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
      this.sections[name] = "whole" in section ? this.joined(name, section) : section;
    }
    this.onChange(whole ? null : new Set(Object.keys(message.sections)));
  }

  // Strips come by their new rows.
  joined(name, { whole, columns, rows }) {
    const old = whole ? [] : this.sections[name]?.rows || [];
    return { columns, rows: old.concat(rows).slice(-7200) };
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
    return { ok: false, message: "no answer from the surface unit" };
  }
}
