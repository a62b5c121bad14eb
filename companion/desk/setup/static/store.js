// Holds the draft as the server has it, and tells whoever shows it when it changes.

import { ask } from "./api.js";
import { say } from "./sending.js";

export class Store {
  constructor() {
    this.state = null;
    this.last = null; // the change that is being made
    this.refused = new Map(); // by key what was not taken, and is tried again with the next: some are right only together
    this.listeners = [];
  }

  async load() {
    return this.take(await ask("/state.json"));
  }

  // changes: "section.key" -> value, null: removed. Resolves to "" or to what is wrong.
  // One after the other: what is typed last is looked at last. waits: whether it is tried again where it is refused.
  async change(changes, waits = false) {
    const before = this.last;
    this.last = (async () => {
      await before;
      const waiting = Object.fromEntries([...this.refused].filter(([key, value]) => !(key in changes) && value !== undefined));
      const problem = this.take(await ask("/draft", { changes, waiting }));
      if (problem && waits) Object.entries(changes).forEach(([key, value]) => this.refused.set(key, value));
      return problem;
    })();
    return this.last;
  }

  async post(path, content = {}) {
    return this.take(await ask(path, content));
  }

  take({ answer, problem }) {
    if (problem) say(problem);
    else {
      this.state = answer;
      answer.taken?.forEach((key) => this.refused.delete(key));
      this.rows = new Map(answer.settings.map((row) => [row.key, row]));
      this.listeners.forEach((told) => told(answer));
    }
    return problem ?? "";
  }

  row(key) {
    return this.rows.get(key);
  }

  value(key) {
    return this.row(key).value;
  }
}
