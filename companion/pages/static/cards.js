// The cards of a rover's calls: which are there, which of them stand in front, and which is the first.

import { arrange } from "./elements.js";

const LEFT = 5; // seconds for which a call that has closed may still be what an operator means
const IN_FRONT = 60; // seconds for which a closed call stays in front until another is there, so that what became of it is seen

export class Cards {
  // make: makes a card for a call.
  constructor(make) {
    this.make = make;
    this.byKey = new Map();
  }

  // The card of the first open call, if there is one.
  get firstOpen() {
    return [...this.byKey.values()].find((card) => card.data?.open);
  }

  // front, past: the elements in which the cards stand. before, after: what else stands in `past`. show: shows a call on its card.
  // Returns how many cards stand in `past`.
  show(calls, { front, past, before = [], after = [] }, show) {
    const now = performance.now() / 1000, wanted = new Set(calls.map((call) => call.key));
    for (const [key, card] of this.byKey) if (!wanted.has(key)) card.part.remove(), this.byKey.delete(key);
    const inFront = [], behind = [], latest = calls.find((call) => !call.open);
    for (const call of calls) {
      if (!this.byKey.has(call.key)) {
        const made = this.make(call);
        if ([...this.byKey.values()].some((other) => other.data?.open || now - (other.closedAt ?? -Infinity) < LEFT)) made.mustBeRead?.("is new");
        this.byKey.set(call.key, made);
      }
      const card = this.byKey.get(call.key);
      if (card.data?.open && !call.open) card.closedAt = now;
      show(card, call);
      const stays = call === latest && !calls.some((one) => one.open) && now - (card.closedAt ?? -Infinity) < IN_FRONT;
      (call.open || stays ? inFront : behind).push(card.part);
    }
    arrange(front, inFront);
    arrange(past, [...before, ...behind, ...after]);
    return behind.length;
  }
}

// first: returns the card of the first open call, or nothing. Returns the same, for what acts on the first card, whichever that is:
// one that takes another's place has to be read. To be asked whenever the calls are shown, too.
export function watched(first) {
  let before = null, seen = -Infinity;
  return () => {
    const card = first(), now = performance.now() / 1000;
    if (!card) return card;
    if (before && card !== before && now - seen < LEFT) card.mustBeRead?.("has come first");
    before = card;
    seen = now;
    return card;
  };
}
