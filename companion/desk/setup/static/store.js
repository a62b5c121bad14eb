// Holds the draft as the server has it, and tells whoever shows it when it changes.

import { ask } from "./api.js";
import { say } from "./sending.js";

export class Store {
  constructor() {
    this.state = null;
    this.last = null; // what was asked last
    this.refused = new Map(); // by key the {value, problem} of what was not taken; it is tried again with the next change
    this.listeners = [];
  }

  load() {
    return this.turn(() => ask("/state.json"));
  }

  // One after the other: what is asked last is looked at last. act: resolves to {answer} or {problem}.
  turn(act) {
    const before = this.last;
    this.last = (async () => {
      await before;
      return this.take(await act());
    })();
    return this.last;
  }

  // changes: "section.key" -> value, null: removed. Resolves to "" or to what is wrong.
  // waits: whether it is tried again where it is refused: some settings are right only together.
  change(changes, waits = false) {
    return this.turn(async () => {
      const waiting = [...this.refused].filter(([key, { value }]) => !(key in changes) && value !== undefined);
      const told = await ask("/draft", { changes, waiting: Object.fromEntries(waiting.map(([key, { value }]) => [key, value])) });
      const { problem } = told;
      if (problem && waits) Object.entries(changes).forEach(([key, value]) => this.refused.set(key, { value, problem }));
      return told;
    });
  }

  post(path, content = {}) {
    return this.turn(() => ask(path, content));
  }

  take({ answer, problem }) {
    if (problem) say(problem);
    else {
      this.state = answer;
      answer.taken?.forEach((key) => this.refused.delete(key));
      Object.entries(answer.refused ?? {}).forEach(([key, why]) => Object.assign(this.refused.get(key) ?? {}, { problem: why }));
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
