// Holds the draft as the server has it, and tells whoever shows it when it changes.

import { ask } from "./api.js";
import { say } from "./sending.js";

export class Store {
  constructor() {
    this.state = null;
    this.last = null; // the change that is being made
    this.listeners = [];
  }

  async load() {
    return this.take(await ask("/state.json"));
  }

  // changes: "section.key" -> value, null: removed. Resolves to "" or to what is wrong.
  // One after the other: what is typed last is looked at last.
  async change(changes) {
    const before = this.last;
    this.last = (async () => {
      await before;
      return this.take(await ask("/draft", { changes }));
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
