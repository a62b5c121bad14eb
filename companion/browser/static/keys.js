// Single keys answer the call that stands first.

// first: returns the card of the first open call, or nothing. enabled: the checkbox that allows it.
export function listenToKeys(first, enabled) {
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
}
