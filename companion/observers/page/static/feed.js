// Fetches what the companion tells, while the page is seen; in the background only what calls need, where somebody wants that.

import { PATIENCE, Stream, whyNot } from "./stream.js";

const FILES_EVERY = 5000; // ms
const WHY_NOT = {
  token: "The page wants its token: open it with ?token=... again.",
  refused: "The rover answers, but refuses the stream: close other pages like this one.",
  gone: "This page has no connection to the rover, and tries again.",
};

export class Feed {
  // take: called with ("ground" | "news" | "points" | "picture" | "answered" | "calls" | "log" | "connection", content, late). late: seconds that
  // an event waited on its way. quietly: returns whether to hear of calls in the background.
  constructor(take, quietly) {
    this.take = take;
    this.quietly = quietly;
    this.reading = false;
    this.stream = new Stream(["ground", "news", "points", "picture", "answered"], take, whyNot("/healthz", WHY_NOT), { quietly });
    document.addEventListener("visibilitychange", () => this.readFiles());
    setInterval(() => document.hidden || this.readFiles(), FILES_EVERY);
    this.readFiles();
  }

  async readFiles() {
    this.again = this.reading; // what is being read may be older than what this was called for
    if ((document.hidden && !this.quietly()) || this.reading) return;
    this.reading = true;
    try {
      this.take("calls", await (await read("/shown-calls.json")).json());
      this.take("log", await (await read("/log.txt")).text());
    } catch {
      // The state at the top says that there is no connection.
    } finally {
      this.reading = false;
      if (this.again) this.readFiles();
    }
  }
}

async function read(path) {
  const answer = await fetch(path, { signal: AbortSignal.timeout(PATIENCE) });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer;
}
