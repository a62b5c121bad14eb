// What is said of calls, for all pages. Pure.

export const titled = ({ kind, name }) => `${kind === "hold" ? "Hold" : "Call"} ${name}`;

// What is read aloud of a call.
export const aloud = ({ name, reason, stands, todo }) => [`${name}.`, reason, stands, todo].filter(Boolean).join(" ");

export class Untold {
  constructor() {
    this.told = new Set();
  }

  // Returns the open calls that were not told yet; one is told again when it is clear. rover: its calls are these.
  take(calls, rover = "") {
    const named = ({ key, stage }) => `${rover}/${key}/${stage === "clear"}`;
    const found = calls.filter((call) => call.open && !this.told.has(named(call)));
    found.forEach((call) => this.told.add(named(call)));
    return found;
  }
}
