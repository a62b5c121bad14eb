// Single keys answer the call that stands first.

import { element } from "./elements.js";

const KEYS = [["G", "go"], ["S", "stay"], ["L", "look again"], ["N", "name the thing; ", "Enter", " sends it with go"],
  ["T", "to the picture: arrow keys move your frame, with ", "Shift", " they change its size"], ["Esc", "take back what you have not sent"]];

// first: returns the card of the first open call, or nothing. Returns the list of keys, with the switch that allows them.
export function listenToKeys(first) {
  const enabled = element("input", { type: "checkbox", checked: true });
  document.addEventListener("keydown", (event) => {
    const card = event.ctrlKey || event.altKey || event.metaKey ? null : first();
    if (!card) return;
    if (event.key === "Escape") card.clear();
    if (event.repeat || !enabled.checked || event.target.closest("input:not([type=checkbox]), select, textarea")) return;
    const act = { g: () => card.send("go"), s: () => card.send("stay"), l: () => card.send("look"), n: () => card.name(), t: () => card.aim() }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  const key = (text) => element("kbd", {}, text);
  const rows = KEYS.map(([name, before, other, after]) =>
    element("div", {}, element("dt", {}, key(name)), element("dd", {}, before, other ? key(other) : "", after)));
  return element("details", {}, element("summary", {}, "Keys"),
    element("p", {}, element("label", {}, enabled, " Single keys answer the call that stands first")), element("dl", { className: "keys" }, ...rows));
}
