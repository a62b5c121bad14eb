// Single keys answer the call that stands first.

import { element } from "./elements.js";

const KEYS = [["G", "go"], ["S", "stay"], ["L", "look again"], ["N", "name the thing; ", "Enter", " sends it with go"],
  ["T", "to the picture: arrow keys move your frame, with ", "Shift", " they change its size"], ["Esc", "take back what you have not sent, and leave the field, list or slider: in it a key does not answer"]];

// In a text field a key is a letter, in a list it chooses, and who holds a slider answers nothing yet.
const keeps = (part) => part.closest("input:not([type=checkbox]), textarea, select") !== null;

// A new call takes the focus out of a field in which nothing is typed: the key that answers it would become a name.
export function leaveEmptyField() {
  const part = document.activeElement;
  if (part && keeps(part) && !part.value) part.blur();
}

// first: returns the card of the first open call, or nothing. Returns the list of keys, with the switch that allows them.
export function listenToKeys(first) {
  const enabled = element("input", { type: "checkbox", checked: true });
  document.addEventListener("keydown", (event) => {
    const card = event.ctrlKey || event.altKey || event.metaKey ? null : first();
    if (!card) return;
    if (event.key === "Escape") {
      card.clear();
      if (keeps(event.target)) event.target.blur();
    }
    if (event.repeat || !enabled.checked || keeps(event.target)) return;
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
