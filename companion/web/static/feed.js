// Fetches what the companion tells. It connects again by itself, and listens only while the page is seen.

import { Delay } from "./model.js";

const AGAIN = 2000; // ms
const PATIENCE = 5000; // ms without any event after which the stream counts as dead
const FILES_EVERY = 5000; // ms

export class Feed {
  // take: called with ("news" | "picture" | "calls" | "log" | "connection", content, late). late: seconds that
  // an event waited on its way.
  constructor(take) {
    this.take = take;
    this.stream = null;
    this.heardAt = 0;
    this.reading = false;
    document.addEventListener("visibilitychange", () => (document.hidden ? this.close() : this.open()));
    setInterval(() => this.check(), 1000);
    setInterval(() => this.readFiles(), FILES_EVERY);
    if (!document.hidden) this.open();
  }

  open() {
    this.close();
    this.heardAt = performance.now();
    const stream = new EventSource("/events");
    const delay = new Delay();
    this.stream = stream;
    for (const kind of ["news", "picture"]) {
      stream.addEventListener(kind, (event) => {
        this.heardAt = performance.now();
        this.take("connection", "");
        const content = JSON.parse(event.data);
        this.take(kind, content, delay.late(content.clock, performance.now() / 1000));
      });
    }
    stream.onerror = () => this.lost(stream);
    this.readFiles();
  }

  close() {
    this.stream?.close();
    this.stream = null;
  }

  check() {
    if (this.stream && performance.now() - this.heardAt > PATIENCE) this.lost(this.stream);
  }

  async lost(stream) {
    if (stream !== this.stream) return;
    this.close();
    this.take("connection", await whyNot());
    setTimeout(() => this.stream || document.hidden || this.open(), AGAIN);
  }

  async readFiles() {
    if (document.hidden || this.reading) return;
    this.reading = true;
    try {
      this.take("calls", await (await read("/calls.json")).json());
      this.take("log", await (await read("/log.txt")).text());
    } catch {
      // The state at the top says that there is no connection.
    } finally {
      this.reading = false;
    }
  }
}

async function read(path) {
  const answer = await fetch(path, { signal: AbortSignal.timeout(PATIENCE) });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer;
}

async function whyNot() {
  try {
    const answer = await fetch("/healthz", { signal: AbortSignal.timeout(PATIENCE) });
    if (answer.status === 401) return "The page wants its token: open it with ?token=... again.";
    return "The rover answers, but refuses the stream: close other pages like this one.";
  } catch {
    return "This page has no connection to the rover, and tries again.";
  }
}
