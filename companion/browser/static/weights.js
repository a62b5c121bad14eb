// Proposes a word's weight, and says which words an answer turns. `companion/wire/weights.py` says the same. Pure.

import { capital, signed } from "./wording.js";

// A word as the rover stores it.
export const plain = (word) => word.trim().replace(/\s+/g, " ").toLowerCase().normalize("NFC");

// Word -> its own weight: in force, else as it was given last. rover: {words, given, names}, as cards have it.
export function ownWeights({ words, given = {}, names = [] }) {
  const used = words.filter(({ weight }) => weight !== null).map(({ word, weight }) => [word, weight]);
  return new Map([...[...names].reverse(), ...Object.entries(given), ...used]);
}

// typed: the weight that somebody chose, null for none. own: as of `ownWeights`. thing: whether the word is for a thing.
export function propose(word, typed, own, thing) {
  const was = own.get(plain(word)) ?? null;
  const weight = typed ?? was ?? (thing ? -1 : 1);
  return { weight, was, turns: was !== null && Math.sign(was) !== Math.sign(weight) };
}

// The words among these changes that turn their sign, each with what it was and what then becomes drivable or not.
export function turned(changes, own) {
  return changes.filter(({ weight }) => weight !== undefined).map(({ word, tap, weight }) => ({ word: word ?? tap, ...propose(word ?? tap, weight, own) }))
    .filter(({ turns }) => turns);
}

export const turnText = ({ word, was, weight }) => `${capital(word)} was ${signed(was)}. All that fits it becomes ${becomes(weight)}.`;

const becomes = (weight) => (weight > 0 ? "drivable" : weight < 0 ? "not drivable" : "neither drivable nor not");
