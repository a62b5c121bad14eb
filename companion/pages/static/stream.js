// Listens to server-sent events. It connects again by itself, and says why there is no connection.

import { Delay } from "./delay.js";

const AGAIN = 2000; // ms
export const PATIENCE = 5000; // ms without any event after which the stream counts as dead

export class Stream {
  // take: called with (kind, content, late), late: seconds that an event waited on its way; and with
  // ("connection", "" or why there is none). whyNot: asks for that, async. whileHidden: whether to listen while
  // nobody sees the page. quietly: returns whether to listen then for calls alone.
  constructor(kinds, take, whyNot, { whileHidden = false, quietly = () => false } = {}) {
    Object.assign(this, { kinds, take, whyNot, whileHidden, quietly });
    this.stream = null;
    this.heardAt = 0;
    if (!whileHidden) document.addEventListener("visibilitychange", () => (this.wanted ? this.open() : this.close()));
    setInterval(() => this.check(), 1000);
    if (this.wanted) this.open();
  }

  get wanted() {
    return this.whileHidden || !document.hidden || this.quietly();
  }

  open() {
    this.close();
    this.heardAt = performance.now();
    const stream = new EventSource(document.hidden && !this.whileHidden ? "/events?quiet" : "/events");
    const delay = new Delay();
    this.stream = stream;
    for (const kind of this.kinds) {
      stream.addEventListener(kind, (event) => {
        this.heardAt = performance.now();
        this.take("connection", "");
        const content = JSON.parse(event.data);
        this.take(kind, content, delay.late(content.clock, performance.now() / 1000));
      });
    }
    stream.onerror = () => this.lost(stream);
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
    this.take("connection", await this.whyNot());
    setTimeout(() => this.stream || !this.wanted || this.open(), AGAIN);
  }
}

// Returns what says why there is no stream. path: answers while the server runs. token: said where it wants one,
// refused: where it has too many streams, gone: where nothing answers.
export const whyNot = (path, { token, refused, gone }) => async () => {
  try {
    const answer = await fetch(path, { signal: AbortSignal.timeout(PATIENCE) });
    return answer.status === 401 ? token : refused;
  } catch {
    return gone;
  }
};
