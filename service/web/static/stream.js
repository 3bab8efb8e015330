// Server-sent events that survive lost connections and sleep. EventSource cannot send an API key; fetch can.

import { KeyNeeded, request } from "./access.js";

const SILENCE_MS = 40_000;
const FIRST_PAUSE_MS = 1000;
const LONGEST_PAUSE_MS = 30_000;

// Follows the stream at `path` until the returned function is called. `opened` is called at every connection; where what
// it does fails, the connection is given up and tried again. `event(kind, data)` is called with each event, `lost(error)`
// when the connection is gone and will be tried again.
export function follow(path, { opened, event, lost }) {
  let stopped = false;
  let attempt = null;
  let lastId = null;
  let heard = 0;
  let pause = FIRST_PAUSE_MS;
  let wake = () => {};

  async function connect() {
    const own = new AbortController();
    attempt = own;
    const headers = { Accept: "text/event-stream", ...(lastId && { "Last-Event-ID": lastId }) };
    const response = await request(path, { headers, signal: attempt.signal, cache: "no-store" });
    if (!response.ok) throw new Error(`${response.status} ${response.statusText}`);
    heard = performance.now();
    let refused = null;
    Promise.resolve(opened?.()).then(
      () => {
        pause = FIRST_PAUSE_MS;
      },
      (error) => {
        // Another connection has taken over what it did.
        if (error.name === "AbortError") return;
        refused = error;
        own.abort();
      },
    );
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    let text = "";
    for (;;) {
      const { value, done } = await reader.read().catch((error) => {
        throw refused ?? error;
      });
      if (done) throw new Error("the stream has ended");
      heard = performance.now();
      const blocks = (text + value.replaceAll("\r", "")).split("\n\n");
      text = blocks.pop();
      for (const block of blocks) take(block);
    }
  }

  function take(block) {
    let kind = "message";
    const data = [];
    for (const line of block.split("\n")) {
      const [, field, value] = /^([a-z]*): ?(.*)$/.exec(line) ?? [];
      if (field === "event") kind = value;
      else if (field === "data") data.push(value);
      else if (field === "id") lastId = value;
    }
    if (data.length) event(kind, JSON.parse(data.join("\n")));
  }

  async function run() {
    while (!stopped) {
      try {
        await connect();
      } catch (error) {
        attempt?.abort();
        if (stopped) return;
        lost(error);
        if (error instanceof KeyNeeded) return;
        await new Promise((resolve) => {
          wake = resolve;
          setTimeout(resolve, pause);
        });
        pause = Math.min(LONGEST_PAUSE_MS, 2 * pause);
      }
    }
  }

  // After sleep a connection may look open and be dead; the daemon sends something every 15 s.
  function look() {
    if (performance.now() - heard > SILENCE_MS) attempt?.abort();
    wake();
  }
  function shown() {
    if (!document.hidden) look();
  }
  // A page that was only busy finds what came meanwhile before it is asked a second time.
  let silent = false;
  const watching = setInterval(() => {
    const late = performance.now() - heard > SILENCE_MS;
    if (late && silent) attempt?.abort();
    silent = late;
  }, 5000);
  document.addEventListener("visibilitychange", shown);
  window.addEventListener("online", look);
  run();
  return () => {
    stopped = true;
    attempt?.abort();
    wake();
    clearInterval(watching);
    document.removeEventListener("visibilitychange", shown);
    window.removeEventListener("online", look);
  };
}
